"""Runs that nodes of ROS 2 drive: time, commands, missions, faults, failures, and domains, by a stand-in for the bridge."""

import json
import os
import pickle
import re
import signal
import socket
import subprocess
import sys
import tempfile
import time
from dataclasses import replace
from pathlib import Path

import numpy as np
import psutil
import pytest
from recorded import happened
from repeated import BRIDGE as REPEATING
from repeated import repeated
from table import each_row

from vastflow.sim.model.faults import ScenarioError
from vastflow.sim.model.nodes import NodeProcess, Nodes, nodes_of
from vastflow.sim.model.scenario import ProcessSetup, setup_of
from vastflow.sim.nodes import domain
from vastflow.sim.nodes.domain import own_domain
from vastflow.sim.run import execute
from vastflow.sim.scenario.programs import guard as guarding
from vastflow.sim.scenario.programs.resources import waits
from vastflow.sim.scenario.programs.run import process_run

BRIDGE = str(Path(__file__).parents[1] / "support" / "false_bridge.py")
AHEAD = {"x": 2.5, "y": 1.0}

pytestmark = pytest.mark.timeout(300)


@pytest.fixture
def driven(scenario):
    """Executes a run along x, 1.5 m to the goal, by nodes that behave as the test says."""

    def run(
        behavior="",
        timeout_s=20.0,
        goal=AHEAD,
        processes=(),
        start_x_m=1.0,
        mission_kind="navigate_to_pose",
        goals=(),
        **nodes,
    ):
        given = {"mission": "topic", "python": BRIDGE, "answer_within_s": 5.0, **nodes}
        setup = ProcessSetup(environment={"BEHAVIOR": behavior}, nodes=Nodes(tuple(processes), **given))
        sent = {"goal_poses": goals} if goals else {"goal_pose": goal}
        found = scenario(mission_kind, timeout_s=timeout_s, **sent, start_pose={"x": start_x_m, "y": 1.0})
        return execute(replace(found, programs=setup), 0)

    return run


def heard(execution):
    """The messages of each tick that the bridge got."""
    return [json.loads(line) for line in execution.recording.outputs.files["heard.jsonl"].splitlines()]


def test_robot_goes_by_the_commands_of_nodes_to_its_goal(driven):
    execution = driven()
    run, columns = execution.recording.run, execution.recording.columns
    assert (run.outcome, run.reason, run.recoveries) == ("succeeded", "", 2)
    assert [event.what for event in happened(execution.recording, "goal_reached")] == ["0"]
    assert run.distance_m == pytest.approx(1.42, abs=0.05)
    assert set(columns["command_speed_mmps"][1:].tolist()) == {0, 300}
    assert columns["localized"].sum() == 1
    assert "health: lock step by /cmd_vel" in execution.log.lines[-2]
    assert execution.log.lines[-2].endswith("1 control loops missed by the nodes' own words")
    assert "WARN controller_server: Control loop missed" in execution.log.lines[-1]


def test_command_counts_from_the_tick_after_the_scan_that_it_answers(driven):
    told = heard(driven())
    moved = next(each for each in told if each["odom"][3] > 0.0)
    first = next(each for each in told if each["bytes"])
    assert (first["t_ns"], first["scan_ns"]) == (50_000_000, 0)
    assert moved["t_ns"] - first["t_ns"] == 50_000_000


def test_nodes_that_repeat_the_commands_of_the_built_in_robot_give_its_recording(scenario, tmp_path):
    plain = scenario("navigate_to_pose", timeout_s=30.0, goal_pose=AHEAD, start_pose={"x": 1.0, "y": 1.0})
    scan, said, built_in = repeated(plain, 0, 0)
    # The stand-in finds its commands by the bytes of the first scan, so that scans are equal too.
    (tmp_path / "runs.json").write_text(json.dumps({scan: said}))
    nodes = Nodes(python=REPEATING, localization="ideal")
    setup = ProcessSetup(environment={"REPEATED": str(tmp_path / "runs.json")}, nodes=nodes)
    driven = execute(replace(plain, programs=setup), 0).recording
    assert (driven.run.outcome, driven.run.simulated_s) == ("succeeded", built_in.run.simulated_s)
    for name in ("x_mm", "y_mm", "yaw_mrad", "speed_mmps", "sent_speed_mmps", "sent_yaw_rate_mradps"):
        assert np.array_equal(driven.columns[name], built_in.columns[name]), name


def test_robot_turns_left_by_a_positive_yaw_rate(driven):
    columns = driven("turns", timeout_s=2.0).recording.columns
    assert columns["yaw_mrad"][-1] == pytest.approx(900, abs=150) and columns["y_mm"][-1] > 1000


def test_commands_reach_the_wheels_unchanged_up_to_the_wall(driven):
    recording = driven(start_x_m=2.7, goal={"x": 3.9, "y": 3.0}).recording
    assert {*recording.columns["sent_speed_mmps"].tolist()} == {0, 300}
    assert [event.what for event in happened(recording, "contact")] == ["wall"]


def test_nodes_hold_up_no_simulated_time(driven):
    execution = driven(goal={"x": 3.9, "y": 3.0})
    assert execution.recording.run.simulated_s == 20.0
    assert execution.log.wall_s < 16.0  # of which most is starts; by the host's clock it would be 20 s and more


def test_nodes_get_the_scans_odometry_and_map_of_the_simulated_robot(driven):
    execution = driven()
    setup = json.loads(execution.recording.outputs.files["setup.json"])
    assert setup["map"] == {"resolution": 0.05, "width": 168, "height": 108, "origin": [0.0, 0.0, 0.0]}
    assert setup["cells"] == 168 * 108
    told = heard(execution)
    assert [each["t_ns"] for each in told if each.get("mission") is None] == [
        k * 50_000_000 for k in range(1, len(told))
    ]
    ages = {each["t_ns"] - each["scan_ns"] for each in told if each["bytes"]}
    assert ages == {50_000_000}
    assert told[-1]["odom"][0] == pytest.approx(execution.recording.run.distance_m, abs=0.02)


def test_start_is_told_each_second_until_nodes_know_where_they_are(driven):
    told = [each["t_ns"] / 1e9 for each in heard(driven("deaf")) if each.get("localize")]
    assert len(told) == 3 and np.diff(told).tolist() == pytest.approx([1.0, 1.0])


def test_start_is_told_with_the_mission_where_the_estimate_is_ideal(driven):
    told = [
        (each["localize"], "mission" in each) for each in heard(driven(localization="ideal")) if each.get("localize")
    ]
    assert told == [([1.0, 1.0, 0.0], True)]


def test_programs_of_a_scenario_do_not_hold_up_a_paced_run(staged):
    trial = staged("""
        do parallel:
            run_process('sleep 60')
            serial:
                robot.init_nav2(start)
                robot.nav_to_pose(goal_pose: pose_3d(position_3d(2.5m, 1.0m)))
                emit end
    """)
    nodes = Nodes(python=BRIDGE, mission="topic", time="paced", real_time_factor=2.0, most_late=1.0)
    execution = execute(replace(trial, programs=ProcessSetup(nodes=nodes)), 0)
    assert execution.recording.run.outcome == "succeeded"
    found = re.search(r"(\d+) of (\d+) ticks late", "".join(execution.log.lines))
    assert found is not None and int(found[1]) < 0.8 * int(
        found[2]
    )  # all of them at the pace of programs, 0.1 s for two ticks


def test_equal_answers_give_equal_bytes(driven):
    assert driven().recording.digest == driven().recording.digest


def test_scan_without_an_answer_breaks_the_run(driven):
    with pytest.raises(
        ScenarioError, match=r"/cmd_vel did not answer the scan of 0\.\d\d s within 5 s of the host's time"
    ):
        driven("silent")


@each_row(
    ("behavior", "why"),
    [
        ("problem", "ROS 2: tf2_msgs is missing"),
        ("garbage", "wrote something that is no message of its own"),
        ("dies", "the bridge to ROS 2 exited with code 1: no memory left"),
    ],
)
def test_bridge_that_fails_breaks_the_run(driven, behavior, why):
    with pytest.raises(ScenarioError, match=why):
        driven(behavior)


def test_run_may_lie_in_a_folder_whose_path_is_longer_than_a_sockets(driven, monkeypatch, tmp_path):
    folder = tmp_path / ("long" * 30)
    folder.mkdir()
    monkeypatch.setattr(tempfile, "tempdir", str(folder))
    assert driven().recording.run.outcome == "succeeded"


def test_command_that_is_no_number_fails_the_run(driven):
    run = driven("nan").recording.run
    assert (run.outcome, run.error_code) == ("failed", 0)
    assert "/cmd_vel: expected numbers, got [0.3, 0.0, nan] at" in run.reason


def test_node_that_ends_in_mid_run_fails_the_run(driven):
    text = "import time; print('ready', flush=True); time.sleep(1); raise SystemExit('wheels fell off')"
    process = NodeProcess("planner", (sys.executable, "-c", text), ready="log", ready_at="ready")
    run = driven("slow", processes=[process], goal={"x": 3.9, "y": 1.0}).recording.run
    assert run.outcome == "failed"
    assert "node 'planner' exited with code 1: wheels fell off" in run.reason


@each_row(
    ("behavior", "outcome", "code", "reason"),
    [("succeeded", "succeeded", 0, ""), ("aborted", "aborted", 105, "the mission was aborted")],
)
def test_mission_ends_as_its_action_says(driven, behavior, outcome, code, reason):
    run = driven(behavior, mission="action").recording.run
    assert (run.outcome, run.error_code, run.reason.partition(";")[0]) == (outcome, code, reason)


def test_goal_on_a_topic_stands_for_no_mission_of_several(driven):
    with pytest.raises(
        ScenarioError, match="navigate_through_poses: expected mission: action, as /goal_pose has one goal"
    ):
        driven(mission_kind="navigate_through_poses", goals=[AHEAD, {"x": 3.0, "y": 1.0}])


def test_node_may_be_called_like_the_bridge_and_ends_as_a_node(driven):
    text = "import time; print('ready', flush=True); time.sleep(1); raise SystemExit('fell in')"
    process = NodeProcess("bridge", (sys.executable, "-c", text), ready="log", ready_at="ready")
    run = driven("slow", processes=[process], goal={"x": 3.9, "y": 1.0}).recording.run
    assert run.outcome == "failed" and "node 'bridge' exited with code 1: fell in" in run.reason


def test_estimate_is_what_nodes_say_or_the_truth_where_it_is_ideal(driven):
    said = driven().recording.columns
    assert set(said["estimated_x_mm"][1:].tolist()) == {1000}  # AMCL's pose, which the stand-in leaves at the start
    ideal = driven(localization="ideal").recording.columns
    assert np.abs(ideal["estimated_x_mm"] - ideal["x_mm"]).max() <= 16  # of the tick before


def test_recorded_messages_are_outputs_of_the_run(driven):
    outputs = driven().recording.outputs
    assert outputs.files["ros2/messages.cdr"] == b"path"
    table = outputs.tables["ros2/messages"]
    assert [list(column) for column in table.values()][1:] == [["/plan"], ["nav_msgs/msg/Path"], [4]]


PACED = {"time": "paced", "most_waiting": 1.0, "goal": {"x": 3.9, "y": 1.0}}
"""Time by the clock, whatever else this machine does."""


def test_paced_run_that_the_host_made_late_is_broken(driven):
    with pytest.raises(
        ScenarioError,
        match=r"^the host was late in .* 2% may be\. Use fewer workers, or a lower real_time_factor\.$",
    ):
        driven("slow", **PACED, timeout_s=3.0)


def test_late_run_is_broken_although_its_nodes_failed(driven):
    with pytest.raises(ScenarioError, match="the host was late in"):
        driven("slow nan", **PACED, timeout_s=3.0)


class JumpingClock:
    """A clock that only sleeps move; the tenth jumps ahead."""

    def __init__(self, jump_s):
        self.now_s, self.jump_s, self.sleeps = 100.0, jump_s, 0

    def monotonic(self):
        return self.now_s

    def sleep(self, for_s):
        self.sleeps += 1
        self.now_s += for_s + (self.jump_s if self.sleeps == 10 else 0.0)


@each_row(("jump_s", "late_ticks"), [(0.07, 0), (0.08, 1), (0.31, 5)])
def test_paced_ticks_count_as_late_from_half_a_tick_on(driven, monkeypatch, jump_s, late_ticks):
    monkeypatch.setattr("vastflow.sim.nodes.driven.time", JumpingClock(jump_s))
    log = driven(**PACED, most_late=1.0, timeout_s=2.0).log
    assert (log.health["ticks"], log.health["late_ticks"]) == (40, late_ticks)
    assert log.health["late_s"] == pytest.approx(jump_s - 0.05 if late_ticks else 0.0)
    assert f"health: paced at 1: {late_ticks} of 40 ticks late, {1e3 * log.health['late_s']:.0f} ms" in log.lines[-2]


def test_paced_run_takes_the_time_of_its_clock(driven):
    began_s = time.monotonic()
    execution = driven(**PACED, real_time_factor=2.0, most_late=1.0, timeout_s=2.0)
    assert time.monotonic() - began_s >= 1.0
    assert (execution.recording.run.outcome, execution.recording.run.simulated_s) == ("timed_out", 2.0)
    assert "health: paced at 2: " in execution.log.lines[-2]


@pytest.fixture
def waited(monkeypatch):
    """Set for how long each thread waits for a CPU while a run is paced."""

    def set_waits(**after_s):
        told = iter([{"ended": 9.0, "node": 5.0}, {name: 5.0 + waited_s for name, waited_s in after_s.items()}])
        monkeypatch.setattr("vastflow.sim.nodes.driven.waits", lambda pids: next(told))
        monkeypatch.setattr("vastflow.sim.nodes.driven.time", JumpingClock(0.0))

    return set_waits


def test_paced_run_with_a_long_wait_for_a_cpu_is_broken(driven, waited):
    waited(bridge=-4.9, node=0.9)
    with pytest.raises(
        ScenarioError, match=r"the host was late as a thread waited 47% of the time for a CPU\. 40% may be"
    ):
        driven(**{**PACED, "most_waiting": 0.4}, timeout_s=2.0)


def test_health_tells_longest_wait_of_paced_time(driven, waited):
    waited(bridge=-4.9, node=0.9)
    paced = driven(**PACED, timeout_s=2.0).log
    assert paced.health["waited"] == pytest.approx(0.9 / 1.9)
    assert f"a thread waited {paced.health['waited']:.0%} of the time for a CPU" in paced.lines[-2]
    stepped = driven().log
    assert stepped.health["waited"] == 0.0 and "CPU" not in stepped.lines[-2]


@pytest.mark.skipif(not Path("/proc/thread-self/schedstat").exists(), reason="this system does not count waits")
def test_waits_grow_while_others_have_the_cpu():
    text = "import os; os.sched_setaffinity(0, {min(os.sched_getaffinity(0))})\nwhile True: pass"
    busy = [subprocess.Popen([sys.executable, "-c", text]) for _ in range(2)]
    try:
        pid = busy[0].pid
        until_s, before_s = time.monotonic() + 20.0, waits([pid])[f"/proc/{pid}/task/{pid}"]
        while (now_s := waits([pid, 0])[f"/proc/{pid}/task/{pid}"]) < before_s + 0.3 and time.monotonic() < until_s:
            time.sleep(0.1)
        assert now_s >= before_s + 0.3
    finally:
        for each in busy:
            each.kill()
            each.wait()


@each_row(
    ("ready", "at", "why"),
    [
        ("log", "here I am", "node 'late': no log 'here I am' within 0.5 s of its start"),
        ("port", "1", "node 'late': no port '1' within 0.5 s of its start"),
        ("topic", "/odometry", "node 'late': no topic '/odometry' within 0.5 s of its start"),
    ],
)
def test_node_that_never_gets_ready_breaks_the_run(driven, ready, at, why):
    sleeps = (sys.executable, "-c", "import time; time.sleep(60)")
    with pytest.raises(ScenarioError, match=why):
        driven(processes=[NodeProcess("late", sleeps, ready=ready, ready_at=at, ready_within_s=0.5)])


def test_node_that_can_not_be_started_breaks_the_run(driven):
    with pytest.raises(ScenarioError, match="'no-such-program' could not be started: no program of this name in PATH"):
        driven(processes=[NodeProcess("absent", ("no-such-program",))])


def test_domain_is_one_runs_own_until_it_ends(monkeypatch):
    monkeypatch.setattr(domain, "DOMAINS", range(90, 92))
    with own_domain() as (first, _), own_domain() as (second, _):
        assert {first, second} == {90, 91}
        with pytest.raises(ScenarioError, match="all 2 domains of ROS 2 on this machine are taken"), own_domain():
            pass
    with own_domain() as (third, _):
        assert third == first


KILLED = """
import sys
from pathlib import Path
from vastflow.sim.model.nodes import NodeProcess, Nodes
from vastflow.sim.model.scenario import ProcessSetup
from vastflow.sim.nodes.domain import own_domain
from vastflow.sim.nodes.starting import started
from vastflow.sim.scenario.programs.run import process_run
from vastflow.sim.world.robot_model import Lidar

sleeps = NodeProcess("sleeps", (sys.executable, "-c", "import time; time.sleep(600)"))
nodes = Nodes((sleeps,), python=sys.argv[1])
with own_domain() as (number, held), process_run(ProcessSetup(nodes=nodes), holds=[held]) as programs:
    with started(programs, nodes, number, Lidar(), None):
        print(number, programs.folders.out.parent, *sorted(programs.pids()), flush=True)
        sys.stdin.read()
"""


def test_killed_worker_leaves_no_process_folder_or_domain():
    with tempfile.TemporaryDirectory() as folder:  # a socket's path must be short
        environment = {**os.environ, "TMPDIR": folder}
        pipe = subprocess.PIPE
        command = [sys.executable, "-c", KILLED, BRIDGE]
        worker = subprocess.Popen(command, stdin=pipe, stdout=pipe, text=True, env=environment)
        assert worker.stdout is not None
        number, run, *pids = worker.stdout.readline().split()
        assert len(pids) >= 2  # of the bridge and of the node
        os.kill(worker.pid, signal.SIGKILL)
        worker.communicate()
        until_s = time.monotonic() + 30.0
        while not (is_over := _is_over(number, run, pids)) and time.monotonic() < until_s:
            time.sleep(0.05)
        assert is_over


def _is_over(number, run, pids):
    return not Path(run).exists() and not any(psutil.pid_exists(int(pid)) for pid in pids) and not _is_taken(number)


def _is_taken(number):
    with socket.socket(socket.AF_UNIX) as other:
        try:
            other.bind(domain.NAME.format(number))
        except OSError:
            return True
    return False


def test_domain_is_held_until_the_guard_of_a_run_has_ended():
    own = f"of-test-{os.getpid()}"
    held = socket.socket(socket.AF_UNIX)
    held.bind(domain.NAME.format(own))
    with process_run(ProcessSetup(), holds=[held.fileno()]) as programs:
        programs.start([sys.executable, "-c", "import time; time.sleep(60)"])
        held.close()
        assert _is_taken(own)
    assert not _is_taken(own)


LAUNCHES = """#!/usr/bin/env python3
import subprocess, sys, time

assert sys.argv[1:] == ["launch", "bringup.launch.py", "use_sim_time:=true"]
nodes = [subprocess.Popen(["sleep", "600"], start_new_session=each) for each in (False, True)]
print("started", *(node.pid for node in nodes), flush=True)
time.sleep(600)
"""


def test_launched_nodes_end_with_the_run(driven, tmp_path, monkeypatch):
    (tmp_path / "ros2").write_text(LAUNCHES)
    (tmp_path / "ros2").chmod(0o755)
    monkeypatch.setenv("PATH", f"{tmp_path}:{os.environ['PATH']}")
    command = ("ros2", "launch", "bringup.launch.py", "use_sim_time:=true")
    execution = driven(processes=[NodeProcess("bringup", command, ready="log", ready_at="started")])
    assert execution.recording.run.outcome == "succeeded"
    (text,) = [log.text for log in execution.log.texts if log.label == "bringup"]
    pids = [int(pid) for pid in text.split()[1:]]
    assert len(pids) == 2
    until_s = time.monotonic() + 10.0
    while any(map(psutil.pid_exists, pids)):  # they have been killed, and their new parent may not know it yet
        assert time.monotonic() < until_s


EXECUTED = "import pickle, sys; from vastflow.sim.run import execute; execute(pickle.load(open(sys.argv[1], 'rb')), 0)"


def test_driven_run_holds_its_domain_when_its_worker_is_killed(scenario, tmp_path):
    begun = tmp_path / "begun"
    text = f"import os, time; open({str(begun)!r}, 'w').write(os.environ['ROS_DOMAIN_ID']); time.sleep(600)"
    nodes = Nodes((NodeProcess("sleeps", (sys.executable, "-c", text)),), python=BRIDGE, mission="topic")
    setup = ProcessSetup(environment={"BEHAVIOR": "slow"}, nodes=nodes)
    sent = {"goal_pose": {"x": 3.9, "y": 1.0}, "start_pose": {"x": 1.0, "y": 1.0}}
    (tmp_path / "scenario").write_bytes(pickle.dumps(replace(scenario("navigate_to_pose", **sent), programs=setup)))
    command = [sys.executable, "-c", EXECUTED, str(tmp_path / "scenario")]
    worker = subprocess.Popen(command, env={**os.environ, "TMPDIR": str(tmp_path)})
    until_s = time.monotonic() + 60.0
    while not (begun.exists() and begun.read_text()) and time.monotonic() < until_s:
        time.sleep(0.05)
    (guard,) = [each for each in psutil.Process(worker.pid).children() if guarding.__file__ in each.cmdline()]
    guard.suspend()
    worker.kill()
    worker.wait()
    assert _is_taken(begun.read_text())
    guard.resume()
    guard.wait(30.0)
    until_s = time.monotonic() + 30.0
    while (is_taken := _is_taken(begun.read_text())) and time.monotonic() < until_s:  # perhaps by another test's run
        time.sleep(0.1)
    assert not is_taken


def test_run_without_nodes_and_containers_imports_nothing_of_them(scenario, tmp_path):
    sent = {"goal_pose": {"x": 1.3, "y": 1.0}, "start_pose": {"x": 1.0, "y": 1.0}}
    (tmp_path / "scenario").write_bytes(pickle.dumps(scenario("navigate_to_pose", **sent)))
    seen = "print(*(name for name in sys.modules if re.match(r'vastflow.sim.(nodes|.*programs.(containers|runtimes|cgroup))', name)))"
    script = f"import re, vastflow.flows.campaign, vastflow.tasks.engine.work; {EXECUTED}; {seen}"
    command = [sys.executable, "-c", script, str(tmp_path / "scenario")]
    assert subprocess.run(command, capture_output=True, text=True, check=True).stdout.split() == []


def test_setup_with_nodes_is_read_back_from_its_content():
    nodes = Nodes((NodeProcess("a", ("b", "c"), {"d": "e"}, "port", "1", 2.0),), record=("/plan",), time="paced")
    setup = ProcessSetup(nodes=nodes)
    assert setup_of(json.loads(json.dumps(setup.content))) == setup
    assert nodes_of(json.loads(json.dumps(nodes.content))) == nodes
