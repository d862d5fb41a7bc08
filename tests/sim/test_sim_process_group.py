"""Programs that behave badly: each ends in time, says why, and leaves nothing running."""

import os
import signal
import subprocess
import sys
import time
import uuid
from dataclasses import replace

import psutil
import pytest
from table import each_row

from vastflow.sim.model.faults import ScenarioError
from vastflow.sim.scenario.programs.folders import RunFolders
from vastflow.sim.scenario.programs.guard import marked
from vastflow.sim.scenario.programs.process import ProcessGroup

pytestmark = pytest.mark.timeout(900)

STUBBORN = """
import signal, sys, time
signal.signal(signal.SIGTERM, signal.SIG_IGN)
print("ready", flush=True)
time.sleep(600)
"""
FORKS = """
import os, subprocess, sys, time
for session in (True, False):
    subprocess.Popen([sys.executable, "-c", "import time; time.sleep(600)"], start_new_session=session)
print("ready", flush=True)
if "stay" in sys.argv:
    time.sleep(600)
"""
HIDES = """
import os, subprocess, sys, time
subprocess.Popen([sys.executable, "-c", "import time; time.sleep(600)"], start_new_session=True, env={})
print("ready", flush=True)
time.sleep(600)
"""


@pytest.fixture
def mark():
    """A mark whose processes must be gone when the test is over."""
    mark = f"{uuid.uuid4().hex}."
    yield mark
    assert list(marked(mark)) == []


@pytest.fixture
def started(tmp_path, mark):
    """Starts a Python script, or a command, as a process group."""
    groups = []

    def start(script="", *arguments, command=None, **options):
        group = ProcessGroup(
            command or [sys.executable, "-c", script, *arguments],
            folders=replace(RunFolders.below(tmp_path), out=tmp_path),
            environment=os.environ,
            log_file=tmp_path / f"{len(groups)}.log",
            mark=f"{mark}{len(groups)}.",
            **options,
        )
        groups.append(group)
        return group

    yield start
    for group in groups:
        group.release()


def until_printed(group, text=b"ready"):
    while text not in group.log.read():
        assert group.failure is None, group.log.read()
        time.sleep(0.005)


def until_marked(mark, number):
    until_s = time.monotonic() + 60
    while len(set(marked(mark))) != number:  # one that becomes another program just now has no environment to read
        assert time.monotonic() < until_s
        time.sleep(0.01)


@each_row(
    ("script", "failure"),
    [
        ("print('hello')", ""),
        ("raise SystemExit(3)", "exited with code 3"),
        ("import os, signal; os.kill(os.getpid(), signal.SIGSEGV)", "was ended by SIGSEGV"),
    ],
)
def test_failure_of_a_program_has_its_code_or_signal(started, script, failure):
    assert started(script).wait(120) == failure


def test_log_has_standard_output_and_error(started):
    group = started("import sys; print('out', flush=True); print('err', file=sys.stderr)")
    group.wait(120)
    group.stop()
    assert group.log.read() == b"out\nerr\n"
    assert group.log.last_line() == "err"


@pytest.fixture
def interruptible():
    """Tests that a shell started in its background ignore SIGINT, and what they start would, too."""
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    yield
    signal.signal(signal.SIGINT, before)


@pytest.mark.usefixtures("interruptible")
def test_program_that_sleeps_for_ever_ends_by_the_signal_it_is_sent(started):
    group = started("import time; print('ready', flush=True); time.sleep(600)")
    until_printed(group)  # earlier Python ends with code 1
    assert group.wait(0.05) is None
    group.stop(signal.SIGINT, 20)
    assert group.failure in {"was ended by SIGINT", "exited with code 130"}


def test_program_that_ignores_sigterm_is_killed_after_its_time(started):
    group = started(STUBBORN)
    until_printed(group)
    group.stop(timeout_s=0.3)
    assert group.failure == "did not end within 0.3 s of SIGTERM and was killed"


def test_children_in_sessions_of_their_own_end_with_a_program_or_after_it(started, mark):
    stays = started(FORKS, "stay")
    until_marked(mark, 3)
    stays.stop(timeout_s=5)
    assert list(marked(mark)) == []
    leaves = started(FORKS)
    assert leaves.wait(120) == ""
    until_marked(mark, 2)
    leaves.stop()
    assert (leaves.failure, list(marked(mark))) == ("", [])


def test_unmarked_child_is_found_by_parent(started):
    group = started(HIDES)
    until_printed(group)
    (child,) = psutil.Process(group.pid).children()
    group.stop(timeout_s=5)
    assert not child.is_running() or child.status() == psutil.STATUS_ZOMBIE


def test_children_in_the_group_have_time_to_end_in_order(started, tmp_path):
    child = (
        "import pathlib, signal, sys, time\n"
        "def end(*_):\n    time.sleep(0.2); pathlib.Path('saved').touch(); sys.exit()\n"
        "signal.signal(signal.SIGTERM, end)\nprint('ready', flush=True)\ntime.sleep(600)"
    )
    group = started(f"import subprocess, sys; subprocess.run([sys.executable, '-c', {child!r}])")
    until_printed(group)
    group.stop(timeout_s=60)
    assert (tmp_path / "saved").exists()


def test_flood_is_cut_and_the_program_never_waits_for_its_reader(started):
    group = started("import os\nfor _ in range(1700): os.write(1, b'x' * 65536)", max_log_bytes=1 << 20)
    assert group.wait(120) == ""
    group.stop()
    size = group.log.path.stat().st_size
    assert group.log.cut
    assert 1 << 20 < size < (1 << 20) + 200
    assert group.log.last_line() == "[the log was cut here: more than 1048576 bytes]"


@each_row(
    ("program", "content", "mode", "message"),
    [
        ("no-such-program", None, 0, "no program of this name in PATH"),
        ("./gone", None, 0, "there is no such file, seen from the run's folder"),
        ("./data", "#!/bin/sh\n", 0o644, "it is not executable"),
        ("./script", "exit 0\n", 0o755, "neither a binary of this machine nor a script with a #! line"),
        ("./lost", "#!/no/such/interpreter\n", 0o755, "the interpreter its first line names was not found"),
    ],
)
def test_unstartable_program_has_reason(started, tmp_path, program, content, mode, message):
    folder = tmp_path.parent  # of the program, beside the rows' own
    if content is not None:
        (folder / program).write_text(content)
        (folder / program).chmod(mode)
    with pytest.raises(ScenarioError, match=f"'{program}' could not be started: {message}"):
        started(command=[program])


def test_programs_and_folder_are_gone_with_whoever_started_them_even_by_sigkill(tmp_path, mark):
    script = f"""
import os, pathlib, sys, time
from vastflow.sim.scenario.programs.run import process_run
from vastflow.sim.model.scenario import ProcessSetup
with process_run(ProcessSetup()) as run:
    group = run.start([sys.executable, "-c", {FORKS!r}, "stay"])
    while b"ready" not in group.log.read():
        time.sleep(0.005)
    print("ready", flush=True)
    time.sleep(600)
"""
    parent = subprocess.Popen(
        [sys.executable, "-c", script],
        stdout=subprocess.PIPE,
        env={**os.environ, "VASTFLOW_RUN": mark, "TMPDIR": str(tmp_path)},
    )
    assert parent.stdout.readline() == b"ready\n"
    until_marked(mark, 4)
    assert len(list(tmp_path.glob("vastflow-run-*"))) == 1
    parent.kill()
    parent.wait()
    until_s = time.monotonic() + 60
    while list(marked(mark)) or list(tmp_path.glob("vastflow-run-*")):
        assert time.monotonic() < until_s
        time.sleep(0.01)


@each_row("function", ["copy_in", "stamps", "remove_folder"])
def test_run_that_is_killed_while_it_begins_or_ends_leaves_no_folder(tmp_path, function):
    script = f"""
import os, signal
from vastflow.sim.scenario.programs import run
from vastflow.sim.model.scenario import ProcessSetup
run.{function} = lambda *_: os.kill(os.getpid(), signal.SIGKILL)
with run.process_run(ProcessSetup()):
    pass
"""
    done = subprocess.run([sys.executable, "-c", script], env={**os.environ, "TMPDIR": str(tmp_path)}, check=False)
    assert done.returncode == -signal.SIGKILL
    until_s = time.monotonic() + 60
    while list(tmp_path.iterdir()):
        assert time.monotonic() < until_s
        time.sleep(0.01)
