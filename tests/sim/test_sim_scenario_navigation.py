"""Scenario files that send the robot about: goals, their ends, and what comes between."""

import math

import numpy as np
import pytest
from recorded import ends, final, happened
from table import each_row

from vastflow.sim.model.faults import ScenarioError
from vastflow.sim.model.recording import si
from vastflow.sim.run import run


def at(recording, t_s, name):
    return si(recording.columns[name])[np.searchsorted(recording.columns["t_ms"], round(t_s * 1000))]


def test_goal_succeeds_within_a_tenth_of_a_second_of_arrival(staged):
    recording = run(staged("robot.nav_to_pose(near)"), 0)
    (reached,) = [event.t_s for event in recording.run.events if event.kind == "goal_reached"]
    ((ended_s, status, _),) = ends(recording, "nav_to_pose")
    assert (recording.run.outcome, recording.run.reason, status) == ("succeeded", "", "SUCCESS")
    assert 0.0 < ended_s - reached <= 0.1 + 1e-9
    assert recording.run.simulated_s == ended_s


TAKEN = """
    parallel:
        serial:
            failure_is_success()
            robot.nav_to_pose(near)
        serial:
            wait elapsed(1s)
            robot.nav_to_pose(above)
"""
TOLD_AGAIN = """
    parallel:
        robot.nav_to_pose(near)
        serial:
            robot.tf_close_to(0.5m, reference_point: position_3d(2.0m, 1.0m))
            robot.init_nav2(pose_3d(position_3d(1.5m, 1.0m)))
"""
LOST = "robot.init_nav2(pose_3d(position_3d(1.0m, 4.0m)))\nrobot.nav_to_pose(above)"
ELSEWHERE = "serial:\n    failure_is_success()\n    robot.nav_to_pose(beyond)\nrobot.nav_to_pose(above)"


@each_row(
    ("text", "start_xy", "walled", "reached", "final_xy"),
    [
        ("robot.nav_to_pose(near)\nrobot.nav_to_pose(above)\nrobot.nav_to_pose(start)", (1, 1), False, "000", (1, 1)),
        ("serial:\n    repeat(2)\n    robot.nav_to_pose(near)", (1, 1), False, "00", (3, 1)),
        (TAKEN, (1, 1), False, "0", (3, 4)),
        ("robot.follow_waypoints([near, start], loop_count: 1)", (1, 1), False, "0101", (1, 1)),
        (LOST, (1, 4), False, "0", (3, 4)),
        (TOLD_AGAIN, (1, 1), False, "0", None),
        (ELSEWHERE, (1, 1), True, "0", (3, 4)),
        ("robot.follow_waypoints([beyond, above], allow_missed_waypoints: true)", (1, 1), True, "1", (3, 4)),
    ],
)
def test_robot_reaches_its_goals(staged, two_rooms, walled_off, text, start_xy, walled, reached, final_xy):
    start = {"x": float(start_xy[0]), "y": float(start_xy[1])}
    recording = run(staged(text, start_pose=start, map_file=walled_off if walled else two_rooms), 0)
    assert (recording.run.outcome, recording.run.error_code, recording.run.reason) == ("succeeded", 0, "")
    assert "".join(event.what for event in happened(recording, "goal_reached")) == reached
    assert final_xy is None or math.dist(final(recording), final_xy) < 0.4


def test_timeout_cancels_mission_and_robot_brakes(staged):
    text = """
        serial:
            failure_is_success()
            timeout(2s)
            robot.nav_to_pose(near)
        wait elapsed(3s)
        robot.nav_to_pose(above)
    """
    recording = run(staged(text), 0)
    cancelled, reached = ends(recording, "nav_to_pose")
    assert cancelled[2] == "cancelled"
    assert at(recording, cancelled[0], "speed_mmps") > 0.3
    assert at(recording, cancelled[0] + 2.0, "speed_mmps") == at(recording, cancelled[0] + 2.5, "speed_mmps") == 0.0
    assert at(recording, cancelled[0] + 0.1, "command_speed_mmps") == 0.0
    assert (reached[1], recording.run.outcome) == ("SUCCESS", "succeeded")
    assert math.dist(final(recording), (3.0, 4.0)) < 0.4


def test_canceled_robot_brakes_within_smoother_limits(staged):
    braked = run(staged("one_of:\n    robot.nav_to_pose(near)\n    wait elapsed(1.5s)\nwait elapsed(1s)"), 0)
    sent = si(braked.columns["sent_speed_mmps"])
    slowing = np.diff(sent)[np.argmax(sent) :]
    assert slowing.min() >= -0.25 - 1e-9  # 2.5 m/s² at most, a tenth of a second
    assert (slowing <= 0.0).all() and sent[-1] == 0.0


def test_success_on_acceptance_keeps_robot_driving(staged):
    recording = run(staged("robot.nav_to_pose(near, success_on_acceptance: true)\nwait elapsed(5s)"), 0)
    assert recording.run.outcome == "succeeded"
    assert ends(recording, "nav_to_pose")[0][:2] == (0.2, "SUCCESS")
    assert [e.what for e in happened(recording, "goal_reached")] == ["0"]
    assert recording.run.simulated_s == 5.2


START = {"x": 1.0, "y": 1.0}
REPLACED = (
    "parallel:\n    robot.nav_to_pose(near)\n    serial:\n        wait elapsed(1s)\n        robot.nav_to_pose(above)"
)
GIVEN_UP = "no path to the goal (NO_VALID_PATH), after 15 recoveries; nav_to_pose at trial.osc:"
MISSED = "1 of the waypoints could not be reached; follow_waypoints at trial.osc:"


@each_row(
    ("text", "end", "counts", "reason"),
    [
        (REPLACED, ("failed", 0), (0, 0), "another goal took its place; nav_to_pose at trial.osc:"),
        ("robot.follow_waypoints([beyond, above])", ("failed", 0), (1, 15), MISSED),
        ("robot.nav_to_pose(beyond)", ("aborted", 208), (0, 15), GIVEN_UP),
        ("serial:\n    retry(2)\n    robot.nav_to_pose(beyond)", ("aborted", 208), (0, 30), GIVEN_UP),
    ],
)
def test_incomplete_mission_has_reason(staged, walled_off, text, end, counts, reason):
    found = run(staged(text, map_file=walled_off), 0).run
    assert (found.outcome, found.error_code) == end
    assert (found.missed_goals, found.recoveries) == counts
    assert found.reason.startswith(reason)


@each_row("action", ["nav_through_poses", "follow_waypoints"])
def test_mission_without_goals_can_not_work(staged, action):
    with pytest.raises(ScenarioError, match=rf"expected one goal or more, got none; {action} at trial\.osc:"):
        run(staged(f"none: list of pose_3d\ndo serial:\n    robot.{action}(none)", none=[], start_pose=START), 0)


ELSEWHERE_TOLD = """
    do parallel:
        told: robot.init_nav2(start, wait_for_initial_pose: true)
        serial:
            wait elapsed(1s)
            robot.init_nav2(start)
"""


@each_row(
    ("text", "name", "end_s"),
    [
        ("do told: robot.init_nav2(start)", "told", (0.2, 0.2)),
        ("do told: robot.init_nav2(start, use_initial_pose: false)", "told", None),
        (ELSEWHERE_TOLD, "told", (1.0, 1.5)),
    ],
)
def test_init_nav2_ends_with_first_amcl_pose(staged, text, name, end_s):
    recording = run(staged(text, timeout_s=3.0), 0)
    found = ends(recording, name)
    assert recording.run.outcome == ("succeeded" if end_s else "timed_out")
    assert recording.columns["localized"].any() == bool(end_s)
    assert not end_s or (found[0][1] == "SUCCESS" and end_s[0] <= found[0][0] <= end_s[1])


def test_kidnapped_robot_believes_initial_pose(staged):
    """`start_pose` is where it stands, the argument of init_nav2 what it is told."""
    told_wrong = staged("wait elapsed(1s)", start_pose={"x": 1.0, "y": 4.0})
    columns = run(told_wrong, 0).columns
    true = np.array([si(columns["x_mm"])[-1], si(columns["y_mm"])[-1]])
    estimate = np.array([si(columns["estimated_x_mm"])[-1], si(columns["estimated_y_mm"])[-1]])
    assert true.tolist() == [1.0, 4.0]
    assert np.hypot(*(estimate - true)) > 1.0
