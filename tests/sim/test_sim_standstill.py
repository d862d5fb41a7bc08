"""Robots that were sent and never moved: how they are told from others, and what held them."""

import numpy as np
import pytest
from table import each_row

from vastflow.sim.loop.standstill import CAUSES, STOOD_STILL, standstill
from vastflow.sim.model.recording import Event
from vastflow.sim.run import run

AGAINST_THE_WALL = {"x": 1.0, "y": 0.4}
"""0.2 m from the wall; the padded footprint reaches 0.23 m."""
NEAR = {"x": 3.0, "y": 1.0}


def stood(recording):
    return [event.what for event in recording.run.events if event.kind == STOOD_STILL]


def columns(commanded, sent):
    """Columns with these commands before and after the monitor (mm/s, mrad/s)."""
    names = ("command_speed_mmps", "command_yaw_rate_mradps", "sent_speed_mmps", "sent_yaw_rate_mradps")
    rows = np.array([[*one, *other] for one, other in zip(commanded, sent, strict=True)], dtype=np.int32)
    return {**dict(zip(names, rows.T, strict=True)), "x_mm": np.array([1500]), "y_mm": np.array([2500])}


AT_REST = (Event(0.0, "stopped_by_monitor", 1.5, 2.5, "0"),)
LATER = (Event(3.0, "stopped_by_monitor", 1.5, 2.5, "0"),)
NONE, AHEAD, TURN = (0, 0), (200, 0), (0, -400)


@each_row(
    ("commanded", "sent", "events", "cause"),
    [
        ([NONE, AHEAD, TURN], [NONE, NONE, NONE], AT_REST, "points in footprint"),
        ([NONE, AHEAD, TURN], [NONE, NONE, NONE], LATER, "collision monitor"),
        ([AHEAD, AHEAD, TURN], [NONE, (30, 0), NONE], AT_REST, "collision monitor"),
        ([AHEAD, TURN, TURN], [NONE, TURN, TURN], AT_REST, "other"),
        ([AHEAD, AHEAD], [AHEAD, AHEAD], (), "other"),
        ([NONE, NONE], [NONE, NONE], AT_REST, "no command"),
    ],
)
def test_cause_follows_from_commanded_and_sent_velocities(commanded, sent, events, cause):
    assert standstill(columns(commanded, sent), events, 0.2) == Event(0.2, STOOD_STILL, 1.5, 2.5, cause)


@pytest.mark.parametrize("controller", ["mppi", "rpp"])
def test_start_against_a_wall_is_blamed_on_the_collision_monitor(scenario, controller):
    against = scenario(start_pose=AGAINST_THE_WALL, goal_pose=NEAR, controller=controller, timeout_s=30.0)
    recording = run(against, 0)
    assert stood(recording) == ["points in footprint"]
    assert recording.run.outcome == "timed_out"
    assert recording.run.reason.endswith(f"the robot stood still at the start: {CAUSES['points in footprint']}")
    commands = [recording.columns[f"command_{which}"] for which in ("speed_mmps", "yaw_rate_mradps")]
    assert np.any(commands, axis=0).mean() > 0.3  # the controller has valid commands


def test_why_it_stood_still_is_known_too_where_commands_are_not_recorded(staged):
    scenario = staged("bag_record(['/tf'])\nrobot.nav_to_pose(near)", start_pose=AGAINST_THE_WALL, timeout_s=20.0)
    recording = run(scenario, 0)
    assert "command_speed_mmps" not in recording.columns
    assert stood(recording) == ["points in footprint"]


def test_robot_with_refused_goal_stood_still(scenario):
    recording = run(scenario(goal_pose={"x": 90.0, "y": 1.0}, controller="rpp"), 0)
    assert (recording.run.outcome, stood(recording)) == ("aborted", ["no command"])
    assert recording.run.reason.startswith("the goal is outside the map")


@each_row(
    "text",
    [
        "robot.nav_to_pose(near)",
        "robot.nav_to_pose(start)",
        "wait elapsed(2s)\nemit fail",
        "parallel:\n    robot.nav_to_pose(beyond)\n    serial:\n        wait elapsed(3s)\n        emit fail",
    ],
)
def test_robots_without_a_goal_or_in_motion_have_not_stood_still(staged, text):
    assert stood(run(staged(text), 0)) == []
