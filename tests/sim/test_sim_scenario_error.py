"""Scenarios that can't work, unlike those whose robot or program fails."""

import pytest
from table import each_row

from vastflow.sim.model.faults import ScenarioError
from vastflow.sim.run import run

REFUSED = "Nav2 takes no goal before the robot was told where it is; init_nav2 first; nav_to_pose at trial.osc:"


@each_row(
    ("text", "why"),
    [
        (
            "wait 1 == 2\nrobot.nav_to_pose(near)",
            "the scenario did not end within its time, waiting for wait condition",
        ),
        ("compare(1, '==', 2)\nrobot.nav_to_pose(near)", "1 == 2 does not hold; compare at trial.osc:"),
        ("run_process('false')\nrobot.nav_to_pose(near)", "false exited with code 1; run_process at trial.osc:"),
        ("serial:\n    timeout(1s)\n    wait 1 == 2\nrobot.follow_waypoints([near])", "timeout(1 s) at trial.osc:"),
        (
            "parallel:\n    serial:\n        wait 1 == 2\n        robot.nav_to_pose(near)\n    emit end",
            "the scenario ended",
        ),
        ("do serial:\n    robot.nav_to_pose(near)\n    robot.init_nav2(start)", REFUSED),
        (
            "do serial:\n    serial:\n        inverter()\n        robot.nav_to_pose(near)\n    robot.init_nav2(start)",
            "",
        ),
    ],
)
def test_robot_that_a_scenario_never_gave_a_goal_has_not_failed(staged, text, why):
    with pytest.raises(ScenarioError) as raised:
        run(staged(text, start_pose={"x": 1.0, "y": 1.0}, timeout_s=3.0), 0)
    assert str(raised.value).startswith(f"the robot was never given a goal: {why}")


def test_campaign_whose_time_is_over_before_the_mission_begins_says_so(staged):
    with pytest.raises(ScenarioError, match="never given a goal: the scenario did not end within its time"):
        run(staged("robot.nav_to_pose(near)", timeout_s=0.04), 0)


@each_row(
    ("text", "outcome"),
    [
        ("wait elapsed(1s)", "succeeded"),
        ("emit fail", "failed"),
        ("wait 1 == 2", "timed_out"),
    ],
)
def test_scenario_that_sends_its_robot_nowhere_on_purpose_ends_as_it_says(staged, text, outcome):
    assert run(staged(text, timeout_s=3.0), 0).run.outcome == outcome


def test_mission_that_is_taken_back_at_once_was_given(staged):
    text = "parallel:\n    robot.nav_to_pose(near)\n    serial:\n        wait elapsed(0.2s)\n        emit fail"
    assert run(staged(text), 0).run.outcome == "failed"


def test_mission_before_an_expression_without_a_value_is_not_judged(staged):
    text = "parallel:\n    robot.nav_to_pose(near)\n    serial:\n        wait elapsed(1s)\n        log(1 / 0)"
    with pytest.raises(ScenarioError, match=r"trial\.osc:.*zero"):
        run(staged(text), 0)
