"""Containers of a run, by each runtime that works here."""

import os
import signal
import subprocess
import sys
import time

import pytest
from container_runtimes import RUNTIMES, containers_left, in_containers, made_root, missing, refused
from table import each_row

from vastflow.sim.model.faults import ScenarioError
from vastflow.sim.model.scenario import ProcessSetup, Scenario, setup_of
from vastflow.sim.reading.abstract import abstract_content
from vastflow.sim.run import execute
from vastflow.sim.scenario.programs import cgroup as cgroup_module
from vastflow.sim.scenario.programs.cgroup import Cgroup
from vastflow.sim.scenario.programs.folders import files_matching
from vastflow.sim.scenario.programs.guard import marked

pytestmark = pytest.mark.timeout(900)
EAT = "x=a; while :; do x=$x$x; done"
SERVE = "mkdir /tmp/www; echo answer >/tmp/www/index.html; exec busybox httpd -f -p 8080 -h /tmp/www"


@pytest.fixture(scope="module", params=RUNTIMES)
def runtime(request):
    if reason := missing(request.param):
        pytest.skip(reason)
    return request.param


@pytest.fixture(scope="module")
def root(runtime, tmp_path_factory):
    made = made_root(runtime, tmp_path_factory.mktemp("made"))
    if reason := refused(runtime):
        pytest.skip(reason)
    return made


@pytest.fixture
def begun(runtime, root, tmp_path):
    """Begins a run with containers; each has the test's root file system and shell commands."""

    def begin(containers, **setup):
        filled = {
            name: {**root, **each, **({"command": ["sh", "-c", each["command"]]} if "command" in each else {})}
            for name, each in containers.items()
        }
        return in_containers(runtime, tmp_path, filled, **setup)

    return begin


def said(run, script):
    """The output of a shell script in the main container, and its failure."""
    group = run.start(["sh", "-c", script])
    failure = group.wait(60)
    group.log.complete.wait(10)
    return group.log.read().decode().strip(), failure


def waited(run, for_s=30):
    """Wait as a scenario does, until a container breaks the run."""
    until_s = time.monotonic() + for_s
    while time.monotonic() < until_s:
        run.wait(0.1)
        time.sleep(0.02)


def test_containers_of_a_run_meet_on_a_loopback_of_its_own(begun, runtime):
    server = {"command": SERVE, "health": {"port": 8080}}
    with begun({"server": server, "main": {}}) as run, begun({"server": server, "main": {}}) as other:
        assert said(run, "wget -qO- http://127.0.0.1:8080") == ("answer", "")
        assert said(other, "wget -qO- http://127.0.0.1:8080") == ("answer", "")
        assert "lo" in said(run, "cat /proc/net/dev")[0] and "eth" not in said(run, "cat /proc/net/dev")[0]
        record = run.close()
    assert record.note == f"containers run by {runtime}: server, main"
    assert record.logs[0].label == "server"


def test_container_without_network_meets_nobody(begun):
    with begun({"server": {"command": SERVE, "health": {"port": 8080}}, "main": {"network": "none"}}) as run:
        assert "refused" in said(run, "wget -qO- http://127.0.0.1:8080")[0]


def test_containers_see_the_runs_folders_and_their_mounts(begun, tmp_path):
    (tmp_path / "data").mkdir()
    (tmp_path / "data/given").write_text("given")
    mounts = [
        {"source": str(tmp_path / "data"), "target": "/data"},
        {"source": str(tmp_path / "data"), "target": "/there/data", "writable": True},
    ]
    with begun({"main": {"mounts": mounts}}) as run:
        assert said(run, "cat /data/given; pwd") == ("given/out", "")
        assert "Read-only" in said(run, "touch /data/new")[0]
        assert "Read-only" in said(run, "touch /config/new")[0]
        assert said(run, "echo 1 >here; touch /there/data/new /channel/new /dev/shm/new") == ("", "")
        assert (run.folders.out.parent / "channel/new").exists()
        record = run.close()
    assert record.outputs.files == {"here": b"1\n"}
    assert (tmp_path / "data/new").stat().st_uid == os.getuid()


def test_container_has_the_campaigns_variables_and_none_of_this_process(begun, monkeypatch):
    monkeypatch.setenv("OF_THIS_PROCESS", "1")
    with begun({"main": {"env": {"OWN": "2"}}}, environment={"SHARED": "3"}) as run:
        assert said(run, "echo $OF_THIS_PROCESS/$OWN/$SHARED") == ("/2/3", "")


def test_container_is_asked_to_end_before_it_is_killed(begun):
    with begun({"main": {}}) as run:
        script = "trap 'sleep 0.2; echo bye >/out/bye; exit' TERM; echo up; while :; do sleep 0.05; done"
        group = run.start(["sh", "-c", script])
        while b"up" not in group.log.read():
            time.sleep(0.01)
        group.stop(timeout_s=30)
        assert (run.folders.out / "bye").exists()


def test_containers_start_after_those_that_they_need(begun):
    early = {"command": "sleep 0.3; echo early >>/out/order; echo ready; sleep 60", "health": {"log": "ready"}}
    late = {"command": "echo late >>/out/order; touch /tmp/there; sleep 60", "after": ["early"]}
    check = {"health": {"command": ["test", "-e", "/tmp/there"]}}
    with begun({"late": {**late, **check}, "early": early}) as run:
        assert (run.folders.out / "order").read_text() == "early\nlate\n"


@each_row(
    ("container", "reason"),
    [
        (
            {"command": "echo hm; sleep 60", "health": {"port": 9, "timeout": 1.0}},
            "has not listened on port 9 within 1 s: hm",
        ),
        ({"command": "sleep 60", "health": {"log": "x", "timeout": 1.0}}, "has not printed 'x' within 1 s"),
        ({"command": "echo no; exit 3", "health": {"log": "x"}}, "exited with code 3: no, before it was healthy"),
        ({"mounts": [{"source": "/not/there", "target": "/x"}], "command": "true"}, "there is no such file or folder"),
        (
            {"mounts": [{"source": "a.txt", "target": "/x"}], "command": "true"},
            "no file that execution.run_files matches",
        ),
    ],
)
def test_container_that_never_gets_healthy_is_a_fault(begun, container, reason):
    with pytest.raises(ScenarioError, match=reason), begun({"server": container}):
        pass


def test_program_that_eats_memory_is_a_fault_with_its_reason(begun, runtime):
    with (
        pytest.raises(
            ScenarioError, match=r"container 'main' by \w+: its memory of 32 MiB was full, and the kernel killed"
        ),
        begun({"main": {"memory": 32 << 20}}) as run,
    ):
        # The program itself goes on, and says nothing of it; Podman tells only of the program itself.
        run.start(["sh", "-c", EAT if runtime == "podman" else f"({EAT}); exit 4"])
        waited(run)


def test_missing_program_is_a_fault_and_not_a_failure(begun):
    with (
        pytest.raises(ScenarioError, match=r"container 'main' by .*(no-such-program|No such file)"),
        begun({"main": {}}) as run,
    ):
        run.start(["no-such-program"])
        waited(run)


def test_client_that_is_killed_is_a_fault_and_not_a_failure(begun):
    with (
        pytest.raises(
            ScenarioError, match=r"'main' by .*(client was ended by SIGKILL|lost the container, which was still)"
        ),
        begun({"main": {}}) as run,
    ):
        group = run.start(["sh", "-c", "echo up; sleep 600"])
        while b"up" not in group.log.read():
            time.sleep(0.01)
        os.kill(group.pid, signal.SIGKILL)
        waited(run)


def test_missing_root_file_system_is_a_fault(begun, runtime):
    missing_root = {"image": "vastflow-not-there:1"} if runtime in ("docker", "podman") else {"rootfs": "/not/there"}
    with (
        pytest.raises(ScenarioError, match=r"vastflow-not-there:1|/not/there"),
        begun({"server": {**missing_root, "command": "true"}}),
    ):
        pass


def test_processor_time_is_limited_and_sampled(begun):
    with begun({"main": {"cpu": 0.2}}) as run:
        group = run.start(["sh", "-c", "while :; do :; done"])
        while len(run.resources) < 4:
            time.sleep(0.05)
        group.stop(timeout_s=0)
        rows = run.close().resources
    used = (rows[3].cpu_s - rows[2].cpu_s) / (rows[3].t_s - rows[2].t_s)
    assert used == pytest.approx(0.2, abs=0.1)
    assert 0 < rows[3].rss_bytes < 10 << 20
    assert 1 <= rows[3].processes <= 4


def test_forks_are_limited_and_end_with_the_run(begun):
    with begun({"main": {"processes": 20}}) as run:
        group = run.start(["sh", "-c", "i=0; while [ $i -lt 200 ]; do sleep 600 & i=$((i+1)); done; wait"])
        while b"fork" not in group.log.read():
            time.sleep(0.05)
        assert len(run.pids()) <= 22
        run.close()
        assert run.pids() == set()


def test_killed_process_leaves_no_container(runtime, root, tmp_path):
    mark = f"{runtime}{time.time_ns()}."
    containers = {"server": {**root, "command": ["sh", "-c", SERVE], "health": {"port": 8080}}, "main": root}
    script = f"""
import time
from vastflow.sim.model.scenario import ProcessSetup
from vastflow.sim.scenario.programs.run import process_run
with process_run(ProcessSetup(containers={containers!r}, container_runtime={runtime!r})) as run:
    run.start(["sleep", "600"])
    print(run._mark.split(".")[-2], flush=True)
    time.sleep(600)
"""
    environment = {**os.environ, "VASTFLOW_RUN": mark, "TMPDIR": str(tmp_path)}
    parent = subprocess.Popen([sys.executable, "-c", script], stdout=subprocess.PIPE, env=environment)
    run = parent.stdout.readline().decode().strip()
    assert len(run) == 32 and containers_left(runtime, run)
    assert len(list(marked(mark))) >= 3
    parent.send_signal(signal.SIGKILL)
    parent.wait()
    until_s = time.monotonic() + 60
    while list(marked(mark)) or list(tmp_path.glob("vastflow-run-*")) or containers_left(runtime, run):
        assert time.monotonic() < until_s
        time.sleep(0.1)


@pytest.fixture
def without_cgroups(monkeypatch, tmp_path):
    """Bubblewrap on a machine where no control group can be made."""
    if reason := missing("bubblewrap"):
        pytest.skip(reason)
    (tmp_path / "none").write_text("a file, and no folder")
    monkeypatch.setattr(cgroup_module, "ROOT", tmp_path / "none")
    return made_root("bubblewrap", tmp_path)


def test_memory_of_a_process_is_limited_without_control_groups(without_cgroups, tmp_path):
    with in_containers("bubblewrap", tmp_path, {"main": {**without_cgroups, "memory": 32 << 20}}) as run:
        text, failure = said(run, EAT)
        assert "memory" in text.lower() and failure
        assert run.resources[0].t_s < 1.0


@each_row("limit", [{"cpu": 0.5}, {"processes": 10}])
def test_limit_that_needs_a_control_group_is_refused_without(without_cgroups, tmp_path, limit):
    with (
        in_containers("bubblewrap", tmp_path, {"main": {**without_cgroups, **limit}}) as run,
        pytest.raises(ScenarioError, match="can't limit cpu and processes here, where no control group can be made"),
    ):
        run.start(["true"])


def test_control_group_of_version_2_is_limited_and_read(tmp_path):
    (tmp_path / "cgroup.controllers").touch()
    group = Cgroup("mine", tmp_path)
    group.make(32 << 20, 0.5, 10)
    folder = tmp_path / "mine"
    assert [(folder / name).read_text() for name in ("memory.max", "cpu.max", "pids.max", "memory.swap.max")] == [
        *("33554432", "50000 100000", "10", "0"),
    ]
    (folder / "cpu.stat").write_text("usage_usec 1500000\nuser_usec 1\n")
    (folder / "memory.stat").write_text("anon 4096\nfile 1\n")
    (folder / "memory.events").write_text("oom 2\noom_kill 1\n")
    (folder / "cgroup.procs").write_text("12\n13\n")
    assert (group.usage(), group.killed(), group.pids()) == ((1.5, 4096), 1, {12, 13})


def test_runtime_that_does_not_work_is_named(tmp_path, monkeypatch):
    monkeypatch.setenv("PATH", str(tmp_path))
    code = (
        "from vastflow.sim.scenario.programs.runtimes import chosen\n"
        "from vastflow.sim.model.container import Container\n"
        "from vastflow.sim.model.faults import ScenarioError\n"
        "for name, root in (('', {'image': 'a'}), ('podman', {'image': 'a'}), ('', {'rootfs': '/'})):\n"
        "    try: chosen(name, [Container(**root)])\n"
        "    except ScenarioError as error: print(error)\n"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.splitlines() == [
        "containers need docker or podman, which does not work on this machine",
        "containers need podman, which does not work on this machine",
        "containers need runc or bubblewrap, which does not work on this machine",
    ]


def test_runs_without_containers_import_nothing_of_them():
    code = "import sys, vastflow.sim.run, vastflow.flows; print([name for name in sys.modules if name.endswith(('.cgroup', '.runtimes', 'programs.containers'))])"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "[]"


def test_setup_with_containers_is_read_from_its_content():
    setup = ProcessSetup(containers={"main": {"image": "a:1"}}, container_runtime="docker")
    assert setup_of(setup.content) == setup
    assert ProcessSetup().content.keys() == {"files", "environment", "pre_command", "post_command"}


@pytest.fixture
def host_root():
    """A container that sees this machine's own root folder, where bubblewrap works."""
    if reason := missing("bubblewrap"):
        pytest.skip(reason)
    return {"rootfs": "/"}


def test_exports_of_the_pre_command_reach_programs_of_the_main_container(host_root, tmp_path):
    (tmp_path / "pre.sh").write_text("export FOR_YOU=$'two\\nlines'\n")
    files = files_matching(tmp_path, ["pre.sh"])
    with in_containers("bubblewrap", tmp_path, {"main": host_root}, files=files, pre_command="pre.sh") as run:
        assert said(run, 'echo "$FOR_YOU"; ls -A') == ("two\nlines\npre.sh", "")
        record = run.close()
    assert not record.outputs.files


def test_scenario_starts_its_programs_in_the_main_container(host_root, tmp_path):
    (tmp_path / "go.osc").write_text(
        "import osc.helpers\nimport osc.os\nscenario go:\n    timeout(60s)\n    do serial:\n"
        '        process_log_check("server", ["up"])\n        run_process("sh -c \'echo $PPID >/out/asked\'")\n'
        '        check_process_running("sleep 600")\n'
    )
    server = {**host_root, "command": ["sh", "-c", "echo up; sleep 600"]}
    setup = ProcessSetup(containers={"server": server, "main": host_root}, container_runtime="bubblewrap")
    execution = execute(Scenario(abstract_content(tmp_path / "go.osc"), 60.0, {}, {}, {}, setup), 0)
    assert execution.recording.run.outcome == "succeeded"
    assert execution.recording.outputs.files == {"asked": b"1\n"}  # it has no process of this machine above it
    assert "containers run by bubblewrap: server, main" in execution.log.notes
