"""Ends of a scenario file's runs, its variables and draws, and what is recorded."""

import numpy as np
import pytest
from table import each_row

from vastflow.sim.model.blocks import read_recordings, write_recordings
from vastflow.sim.model.faults import ScenarioError
from vastflow.sim.model.scenario import Scenario
from vastflow.sim.nav2.navigator.state import COLUMNS
from vastflow.sim.reading.script import script_of
from vastflow.sim.run import execute, run
from vastflow.sim.scenario.tree.tree import StatusChange


def test_end_of_a_scenario_has_an_outcome_and_a_reason(golden, staged):
    """A robot that was never given a goal has not failed: such a run is none."""

    def told(text):
        try:
            found = run(staged(text, start_pose={"x": 1.0, "y": 1.0}, timeout_s=3.0), 0).run
        except ScenarioError as error:
            return [f"no run: {error}"]
        assert found.error_code == 0
        return [f"{found.outcome}: {found.reason}" if found.reason else found.outcome]

    golden("scenarios", "outcomes", told, key="told")


@each_row(
    ("text", "message"),
    [
        ("robot.nav_to_pose(near)", "never given a goal: the scenario did not end within its time"),
        ("do serial:\n    log(1 / 0)\n    robot.nav_to_pose(near)", r"trial\.osc:.*zero"),
    ],
)
def test_scenario_that_breaks_or_has_no_time_is_no_run(staged, text, message):
    with pytest.raises(ScenarioError, match=message):
        run(staged(text, start_pose={"x": 1.0, "y": 1.0}, timeout_s=0.04 if "do" not in text else 9.0), 0)


BEYOND = "robot.nav_to_pose(beyond)"


@each_row(
    ("text", "outcome", "reason"),
    [
        (f"timeout(2s)\ndo parallel:\n    robot.init_nav2(start)\n    {BEYOND}", "timed_out", "timeout(2 s)"),
        (f"parallel:\n    {BEYOND}\n    serial:\n        wait elapsed(2s)\n        emit end", "succeeded", ""),
    ],
)
def test_scenario_ends_while_the_robot_drives(staged, text, outcome, reason):
    recording = run(staged(text), 0)
    assert (recording.run.outcome, recording.run.simulated_s) == (outcome, 2.2)
    assert recording.run.reason.startswith(reason)


@each_row("timeout_s", [2.0, 2.05, 2.1])
def test_campaign_timeout_ends_a_run_at_a_whole_tenth_of_a_second(staged, timeout_s):
    recording = run(staged(BEYOND, timeout_s=timeout_s), 0, watch=lambda *_: None, watch_ticks=range(99))
    assert recording.run.outcome == "timed_out"
    assert recording.run.simulated_s == int(timeout_s * 10) / 10
    assert recording.columns["t_ms"][-1] == round(recording.run.simulated_s * 1000)


def test_scenario_without_motion_is_a_run(staged):
    recording = run(staged("do serial:\n    wait elapsed(2s)", start_pose={"x": 2.0, "y": 2.0}), 0)
    assert (recording.run.outcome, recording.run.simulated_s, recording.run.distance_m) == ("succeeded", 2.1, 0.0)
    assert set(recording.columns["x_mm"].tolist()) == {2000}


SECOND = (
    "other: differential_drive_robot\ndo serial:\n    robot.init_nav2(start)\n    other.nav_to_pose(near)\n"
    "    robot.nav_to_pose(near)"
)


@each_row(
    ("text", "given", "message"),
    [
        ("do serial:\n    robot.nav_to_pose(near)", {}, "start_pose: expected a start_pose or init_nav2, got neither"),
        (SECOND, {}, r"trial.osc:17:9: expected one robot, 'robot', got 'other' too"),
    ],
)
def test_scenario_that_can_not_work_is_refused_before_the_run(staged, text, given, message):
    with pytest.raises(ValueError, match=message):
        run(staged(text, **given), 0)


def test_map_for_programs_creates_no_world(staged):
    recording = run(staged("map_file: string = ''\ndo serial:\n    compare(map_file, '!=', '')"), 0)
    assert (recording.run.outcome, recording.columns) == ("succeeded", {})


def test_log_lines_carry_the_simulated_time(staged):
    text = "log('begun')\nwait elapsed(1.5s)\nlog('later')\nrobot.nav_to_pose(near)\nlog('there')"
    execution = execute(staged(text), 0)
    began, later, there = execution.log.lines
    assert (began, later) == ("0.2 s: begun", "1.7 s: later")
    assert there == f"{execution.recording.run.simulated_s:.1f} s: there"


def test_numbers_drawn_in_a_run_follow_from_seed_and_index(staged):
    text = "var x: float = random.get_float(0.0, 1.0)\ndo serial:\n    robot.init_nav2(start)\n    log(x)\n    log(random.get_int(0, 1000000))"
    scenario = staged(text)
    lines = [execute(scenario, run_index, seed).log.lines for run_index, seed in ((0, 0), (1, 0), (0, 7))]
    assert len(set(lines)) == 3
    assert execute(scenario, 1).log.lines == lines[1]


def test_scenario_draws_do_not_change_robot_noise(staged):
    drawing = run(staged("wait random.get_int(0, 9) >= 0\nrobot.nav_to_pose(near)"), 0)
    plain = run(staged("wait 1 == 1\nrobot.nav_to_pose(near)"), 0)
    assert all((drawing.columns[name] == column).all() for name, column in plain.columns.items())


def test_behaviors_are_a_table_of_every_change_of_status(staged):
    b = run(staged("wait elapsed(1s)\nrobot.nav_to_pose(near)"), 0).behaviors
    assert tuple(b) == StatusChange._fields
    first = b["t_s"] == 0.0
    assert b["name"][first].tolist() == ["trial", "serial", "init_nav2", "wait elapsed", "nav_to_pose"]
    assert b["class_name"][first].tolist() == ["Sequence", "Sequence", "InitNav2", "Waiting", "Navigate"]
    assert b["parent"][first].tolist() == [-1, 0, 1, 1, 1]
    assert b["child_index"][first].tolist() == [0, 0, 0, 1, 2]
    assert set(b["status"][first]) == {"INVALID"}
    assert (np.diff(b["t_s"]) >= 0).all()
    wait = b["name"] == "wait elapsed"
    assert (b["t_s"][wait].tolist(), [*b["status"][wait]]) == ([0.0, 0.2, 1.2], ["INVALID", "RUNNING", "SUCCESS"])
    assert set(b["line"][b["name"] == "nav_to_pose"]) == {17}


KEPT_ALWAYS = {"t_ms", "x_mm", "estimated_x_mm", "speed_mmps", "localized"}


@each_row(
    ("topics", "kept", "left_out"),
    [
        ("'/tf'", KEPT_ALWAYS, ("covariance_", "sent_", "command_")),
        ("'/cmd_vel', '/scan'", {"sent_speed_mmps"}, ("covariance_", "command_")),
        ("'/amcl_pose', '/cmd_vel_nav'", {"covariance_xx_mm2", "command_yaw_rate_mradps"}, ("sent_",)),
    ],
)
def test_bag_keeps_the_columns_of_its_topics_and_those_that_judge_a_run(staged, topics, kept, left_out):
    body = f"do parallel:\n    bag_record([{topics}])\n    serial:\n        robot.init_nav2(start)\n        emit end"
    execution = execute(staged(body), 0)
    columns = execution.recording.columns
    assert kept | KEPT_ALWAYS <= set(columns)
    assert not [name for name in columns if name.startswith(left_out)]
    assert any("recordings hold no /scan" in line for line in execution.log.lines) == ("/scan" in topics)


@each_row("text", ["emit end", "bag_record([random.get_random_string(['/tf', '/cmd_vel'])])"])
def test_bag_with_unknown_topics_keeps_recording(staged, text):
    scenario = staged(text, timeout_s=1.0)
    assert script_of(scenario).topics is None
    assert tuple(run(scenario, 0).columns) == COLUMNS


def test_runs_with_and_without_their_bag_fit_into_one_block(staged):
    text = "compare(random.get_int(0, 1), '==', 1)\nbag_record(['/tf'])"
    recordings = [run(staged(text, timeout_s=2.0), k) for k in range(6)]
    assert {recording.run.outcome for recording in recordings} == {"failed", "succeeded"}
    assert [r.run for r in read_recordings(write_recordings(recordings))] == [r.run for r in recordings]


def test_bag_alone_needs_no_robot(staged):
    scenario = staged("do serial:\n    bag_record(['/tf'])\n    wait elapsed(1s)")
    recording = run(Scenario(scenario.abstract, 9.0, {}, {}, {}), 0)
    assert (recording.run.outcome, recording.run.simulated_s, recording.columns) == ("succeeded", 1.1, {})
