import os
import sys
import time
from pathlib import Path

import psutil
import pytest
from table import each_row

from vastflow.sim.model.faults import ScenarioError
from vastflow.sim.model.scenario import ProcessSetup
from vastflow.sim.scenario.programs import run as run_module
from vastflow.sim.scenario.programs.folders import files_matching
from vastflow.sim.scenario.programs.guard import VARIABLE
from vastflow.sim.scenario.programs.run import process_run

pytestmark = pytest.mark.timeout(900)


@pytest.fixture
def campaign(tmp_path):
    folder = tmp_path / "campaign"
    folder.mkdir()
    (folder / "given.txt").write_text("given")
    return folder


@pytest.fixture
def begun(campaign, tmp_path):
    """Begins a run of this campaign, with what the test gives it."""

    def begin(**setup):
        return process_run(ProcessSetup(files_matching(campaign, ["given.txt", "*.sh"]), **setup), where=tmp_path)

    return begin


def script(text):
    return [sys.executable, "-c", text]


def said(run, text):
    """The output of a script of this run."""
    group = run.start(script(text))
    group.wait(120)
    group.stop()
    return group.log.read().decode().strip()


def test_run_works_in_private_folder_with_run_files(begun, tmp_path):
    with begun() as run:
        assert said(run, "import os; print(os.getcwd(), sorted(os.listdir()))") == f"{run.folders.out} ['given.txt']"
        folder = run.folders.out
    assert not folder.exists()
    assert [path.name for path in tmp_path.iterdir()] == ["campaign"]


def test_program_has_the_environment_of_the_campaign_and_of_this_process(begun, monkeypatch):
    monkeypatch.setenv("FROM_HERE", "1")
    monkeypatch.setenv(VARIABLE, "outer.")
    with begun(environment={"FROM_THE_CAMPAIGN": "2"}) as run:
        names = ("FROM_HERE", "FROM_THE_CAMPAIGN", VARIABLE)
        assert said(run, f"import os; print(*(os.environ[name] for name in {names}))").startswith("1 2 outer.")


def test_record_has_files_and_prints_of_a_run(begun):
    with begun() as run:
        run.start(script("print('hello'); open('x.csv', 'w').write('a\\n1\\n')"), "writer").wait(120)
        record = run.close()
    assert record.outputs.tables["x"]["a"].tolist() == [1]
    assert not record.outputs.files
    assert [(log.label, log.text, log.cut) for log in record.logs] == [("writer", "hello\n", False)]
    assert record.usage.cpu_s > 0


def test_exports_of_the_pre_command_reach_the_programs(begun, campaign):
    (campaign / "pre.sh").write_text("echo sourcing $FROM\nexport FOR_YOU=$'two\\nlines'\nhelper() { :; }\n")
    with begun(pre_command="pre.sh", environment={"FROM": "here"}) as run:
        told = said(run, "import os; print(repr(os.environ['FOR_YOU']), os.getcwd())")
        assert told == rf"'two\nlines' {run.folders.out}"
        record = run.close()
    assert (record.logs[0].label, record.logs[0].text) == ("pre_command", "sourcing here\n")


def test_background_process_of_the_pre_command_runs_until_the_end(begun, campaign):
    (campaign / "pre.sh").write_text("sleep 600 &\n")
    with begun(pre_command="pre.sh") as run:
        while len(run.pids()) != 1:  # a process that is just executing `sleep` has no environment for a moment
            time.sleep(0.005)
        run.close()
        assert run.pids() == set()


@each_row(
    ("text", "reason"),
    [
        (None, r": there is no file 'pre\.sh'"),
        ("echo no licence; false", r" 'pre\.sh' exited with code 1: no licence"),
        ("exit 0", r" 'pre\.sh' left the shell that sources it. It must not call exit"),
        ("kill -9 $$", r" 'pre\.sh' was ended by SIGKILL"),
    ],
)
def test_pre_command_that_fails_ends_the_run_with_its_reason(begun, campaign, text, reason):
    if text is not None:
        (campaign / "pre.sh").write_text(text)
    with pytest.raises(ScenarioError, match=f"pre_command{reason}"), begun(pre_command="pre.sh"):
        pass


def test_post_command_gets_the_runs_folder_and_may_add_to_it(begun, campaign):
    (campaign / "post.sh").write_text('#!/bin/sh\necho "$1" > "$2/after.txt"; echo done; exit 4\n')
    (campaign / "post.sh").chmod(0o755)
    with begun(post_command="post.sh 'two words'") as run:
        record = run.close()
    assert record.outputs.files["after.txt"] == b"two words\n"
    assert record.post_command == "exited with code 4"
    assert record.logs[-1].text == "done\n"


def test_post_command_that_does_not_end_or_begin_is_noted(begun, monkeypatch):
    monkeypatch.setattr(run_module, "COMMAND_TIMEOUT_S", 0.2)
    with begun(post_command="sh -c 'sleep 600'") as run:
        assert run.close().post_command == "took longer than 0.2 s and was killed"
    with begun(post_command="no-such-program") as run:
        assert "no program of this name in PATH" in run.close().post_command


def test_waiting_ends_with_program_or_timeout(begun):
    with begun() as run:
        run.wait(600)
        run.start(["sh", "-c", "until [ -e end ]; do sleep 0.01; done"])
        assert run.waiting
        (run.folders.out / "end").touch()
        run.wait(600)
        assert not run.waiting
        run.start(script("import time; time.sleep(600)"))
        run.wait(0.05)
        assert run.waiting


def test_abandoned_run_leaves_no_process(begun):
    with pytest.raises(KeyError), begun() as run:
        run.start(script("import time; time.sleep(600)"))
        run.start(script("import subprocess; subprocess.Popen(['sleep', '600'], start_new_session=True)")).wait(120)
        raise KeyError
    assert run.pids() == set()


def test_known_daemon_is_ended_with_run(begun):
    text = (
        "import os, subprocess, sys, time\n"
        "subprocess.Popen(['sleep', '600'], start_new_session=True, env={})\n"
        "while not os.path.exists('seen'): time.sleep(0.01)"
    )
    with begun() as run:
        group = run.start(script(text))
        while len(run.pids()) < 2 or run.resources[-1].processes < 2:
            time.sleep(0.01)
        (daemon,) = run.pids() - {group.pid}
        (run.folders.out / "seen").touch()
        group.wait(120)
        assert psutil.pid_exists(daemon)
        run.close()
    assert not psutil.pid_exists(daemon) or psutil.Process(daemon).status() == psutil.STATUS_ZOMBIE


def test_runs_side_by_side_do_not_touch_each_other(begun):
    with begun() as one, begun() as other:
        survivor = other.start(script("import time; open('mine', 'w'); time.sleep(600)"))
        one.start(script("import time; time.sleep(600)"))
        assert one.pids().isdisjoint(other.pids())
        assert not one.close().outputs.files
        assert one.pids() == set()
        assert survivor.failure is None
        assert survivor.pid in other.pids()


def test_resources_count_all_processes_of_a_run(begun):
    busy = "import time\nwhile time.process_time() < 0.3: pass\nprint('ready', flush=True); time.sleep(600)"
    with begun() as run:
        group = run.start(script(f"import subprocess, sys; subprocess.run([sys.executable, '-c', {busy!r}])"))
        while b"ready" not in group.log.read():
            time.sleep(0.01)
        while (last := run.resources[-1]).cpu_s < 0.25:  # counted in ticks of 10 ms; until the next sample
            time.sleep(0.01)
        record = run.close()
    assert last in record.resources
    assert last.processes == 2
    assert last.rss_bytes > 1 << 20
    assert record.usage.cpu_s >= 0.25


def test_locked_program_folder_is_removed(begun):
    with begun() as run:
        said(run, "import os; os.mkdir('a'); open('a/b', 'w'); os.chmod('a', 0)")
        folder = Path(run.folders.out)
    assert not os.path.lexists(folder)


def test_log_that_finds_the_disk_full_is_a_fault_of_the_machine(begun):
    with pytest.raises(OSError, match=r"No space left on device: '.*vastflow-run-"), begun() as run:
        (run.folders.logs / "0.log").symlink_to("/dev/full")
        run.start(script("print('hello')")).wait(60)
