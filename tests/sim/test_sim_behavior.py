"""Nav2's default trees: which failure is followed by which recovery, when a mission is given up, and with which code."""

import itertools
import math

import pytest

from vastflow.sim.model.recording import si
from vastflow.sim.run import run

ROUND = ["clear both costmaps", "spin", "wait", "back up", "clear both costmaps", "spin"]


def events(recording, *kinds):
    return [(event.kind, event.what) for event in recording.run.events if event.kind in kinds]


def times(recording, kind):
    return [event.t_s for event in recording.run.events if event.kind == kind]


def crate(x, y, length, width):
    size = f"length:={length}, width:={width}"
    return {"entity_name": f"{x}, {y}", "model": "box", "xacro_arguments": size, "spawn_pose": {"x": x, "y": y}}


CAGE = [*(crate(x, 1.0, 0.2, 0.92) for x in (0.64, 1.36)), *(crate(1.0, y, 0.52, 0.2) for y in (0.64, 1.36))]
"""Four crates round (1, 1), their faces 0.26 m away from it."""


@pytest.fixture(scope="module")
def hopeless(scenario, walled_off):
    """A mission to a goal that no path leads to."""
    return run(scenario(map_file=walled_off), 0)


def test_attempts_to_plan_have_one_clearing_and_six_recoveries_in_order(hopeless):
    one_attempt = [("plan_failed", "208"), ("recovery", "clear global costmap"), ("plan_failed", "208")]
    expected = list(one_attempt)
    for recovery in ROUND:
        expected += [("recovery", recovery), *one_attempt]
    assert events(hopeless, "plan_failed", "recovery") == expected
    assert (hopeless.run.outcome, hopeless.run.error_code) == ("aborted", 208)
    # Clearing both costmaps counts as two.
    assert hopeless.run.recoveries == 7 + len(ROUND) + ROUND.count("clear both costmaps")


def test_plan_after_clearing_waits_for_costmap_update(hopeless):
    failed = times(hopeless, "plan_failed")
    waits = [second - first for first, second in zip(failed[::2], failed[1::2], strict=True)]
    assert all(0.0 < wait <= 1.05 for wait in waits)


def test_spin_turns_a_quarter_and_the_backup_drives_thirty_centimeters(hopeless):
    t = hopeless.columns["t_ms"]
    recoveries = {event.what: event.t_s for event in reversed(hopeless.run.events) if event.kind == "recovery"}
    spin = (t > 1e3 * recoveries["spin"]) & (t < 1e3 * recoveries["spin"] + 4500)
    back = (t > 1e3 * recoveries["back up"]) & (t < 1e3 * recoveries["back up"] + 3000)
    assert si(hopeless.columns["yaw_rate_mradps"])[spin].sum() * 0.1 == pytest.approx(1.57, abs=0.25)
    assert si(hopeless.columns["speed_mmps"])[back].sum() * 0.1 == pytest.approx(-0.30, abs=0.06)
    assert si(hopeless.columns["command_speed_mmps"])[back].min() == -0.15


def test_robot_without_published_costmap_ends_its_moves_as_collisions(scenario, walled_off):
    blind = run(scenario(map_file=walled_off, **{"local_costmap.publish_frequency": 0.0}), 0)
    assert abs(si(blind.columns["yaw_rate_mradps"])).sum() * 0.1 < 0.4
    assert si(blind.columns["speed_mmps"]).sum() * 0.1 > -0.1
    assert (blind.run.outcome, blind.run.error_code) == ("aborted", 208)


def test_robot_without_free_move_fails_after_patience_and_clears_local_costmap_first(scenario):
    caged = run(scenario(obstacles=CAGE, controller="rpp"), 0)
    assert (caged.run.outcome, caged.run.error_code) == ("aborted", 104)
    assert 10.0 < caged.run.simulated_s < 60.0
    # The first scan localizes the robot, the next tick plans; patience lasts 0.3 s.
    assert times(caged, "control_failed")[0] - 0.1 == pytest.approx(0.35, abs=0.15)
    failed, cleared = ("control_failed", "104"), ("recovery", "clear local costmap")
    found = events(caged, "control_failed", "recovery")
    assert found[:4] == [failed, cleared, failed, ("recovery", "clear both costmaps")]


def test_robot_that_only_turns_makes_no_progress_and_gives_up_after_recoveries(scenario):
    """Ten seconds of allowance twice an attempt, seven attempts, and the recoveries between them."""
    only_turns = {"velocity_smoother.ros__parameters.max_velocity": [0.0, 0.0, 2.0]}
    stuck = run(scenario(controller="rpp", timeout_s=300.0, **only_turns), 0)
    assert times(stuck, "control_failed")[0] == pytest.approx(10.1, abs=0.3)
    assert (stuck.run.outcome, stuck.run.error_code) == ("aborted", 105)
    assert 140.0 < stuck.run.simulated_s < 190.0


@pytest.mark.parametrize(
    ("mission", "changes", "code"),
    [
        ("navigate_to_pose", {"start_pose": {"x": -3.0, "y": 2.0}}, 203),
        ("navigate_to_pose", {"goal_pose": {"x": 30.0, "y": 2.0}}, 204),
        ("navigate_through_poses", {"goal_poses": [{"x": 3.0, "y": 4.0}, {"x": 30.0, "y": 2.0}]}, 304),
    ],
)
def test_goal_outside_the_map_aborts_at_once_without_recovery(scenario, mission, changes, code):
    recording = run(scenario(mission, **changes), 0)
    assert (recording.run.outcome, recording.run.error_code, recording.run.recoveries) == ("aborted", code, 0)
    assert recording.run.simulated_s < 1.0


def test_navigate_through_poses_reports_planner_code(scenario, walled_off):
    goals = [{"x": 3.0, "y": 4.0}, {"x": 7.0, "y": 4.0}]
    recording = run(scenario("navigate_through_poses", map_file=walled_off, goal_poses=goals), 0)
    assert (recording.run.outcome, recording.run.error_code) == ("aborted", 308)


def test_missed_waypoint_ends_the_mission_where_the_follower_stops_on_failure(scenario, walled_off):
    goals = [{"x": 7.0, "y": 4.0}, {"x": 3.0, "y": 4.0}]
    stops = {"waypoint_follower.ros__parameters.stop_on_failure": True}
    recording = run(scenario("follow_waypoints", map_file=walled_off, goal_poses=goals, **stops), 0)
    assert (recording.run.outcome, recording.run.missed_goals) == ("aborted", 1)
    assert events(recording, "goal_reached") == []


def test_robot_pauses_at_waypoints_as_configured(scenario):
    goals = [{"x": 2.0, "y": 1.0}, {"x": 3.0, "y": 1.0}]
    pause = {"waypoint_pause_duration": 3000}
    short, long = (run(scenario("follow_waypoints", goal_poses=goals, **more), 0) for more in ({}, pause))
    gaps = [times(recording, "goal_reached")[1] - times(recording, "goal_reached")[0] for recording in (short, long)]
    assert gaps[1] - gaps[0] == pytest.approx(2.8, abs=0.3)


def test_smoother_lets_speed_grow_by_an_eighth_each_tick(scenario):
    recording = run(scenario(controller="rpp"), 0)
    sent = si(recording.columns["sent_speed_mmps"])
    assert max(abs(later - earlier) for earlier, later in itertools.pairwise(sent)) <= 2 * 0.125 + 1e-3


def test_goals_are_checked_for_position_once_and_then_for_heading(scenario):
    """The robot turns at the goal: while it does, its position may leave the tolerance again."""
    recording = run(scenario(goal_pose={"x": 7.0, "y": 4.0, "yaw": math.pi / 2}, controller="rpp"), 0)
    assert recording.run.outcome == "succeeded"
    assert abs(si(recording.columns["estimated_yaw_mrad"])[-1] - math.pi / 2) <= 0.251


SERVER = "{}_server.ros__parameters.costmap_update_timeout"
COSTMAP = "{0}_costmap.{0}_costmap.ros__parameters.update_frequency"


@pytest.mark.parametrize(
    ("update_hz", "timeout_s", "times_out"), [(1.0, 0.3, True), (1.0, 1.0, False), (4.0, 0.3, False), (4.0, 0.1, True)]
)
def test_controller_times_out_where_a_cleared_local_costmap_is_not_updated_in_time(
    scenario, update_hz, timeout_s, times_out
):
    """The update comes after anything up to a period of the costmap; Nav2's trees try no recovery for this timeout."""
    given = {COSTMAP.format("local"): update_hz, SERVER.format("controller"): timeout_s}
    found = []
    for k in range(8):
        caged = run(scenario(obstacles=CAGE, controller="rpp", **given), k)
        if caged.run.error_code == 107:
            assert events(caged, "control_failed", "recovery")[-2:] == [
                ("recovery", "clear local costmap"),
                ("control_failed", "107"),
            ]
            waited_s = times(caged, "control_failed")[-1] - times(caged, "recovery")[-1]
            assert waited_s == pytest.approx(timeout_s, abs=0.001)
            assert caged.run.outcome == "aborted"
        found.append(caged.run.error_code)
    assert (107 in found) == times_out


@pytest.mark.parametrize(("timeout_s", "times_out"), [(1.0, True), (5.0, False)])
def test_planner_times_out_and_recovers_if_cleared_costmap_is_updated_late(scenario, walled_off, timeout_s, times_out):
    given = {COSTMAP.format("global"): 0.2, SERVER.format("planner"): timeout_s}
    late = [run(scenario(map_file=walled_off, **given), k) for k in range(3)]
    codes = {what for recording in late for _, what in events(recording, "plan_failed")}
    assert codes == ({"207", "208"} if times_out else {"208"})
    for recording in late:
        first, second = times(recording, "plan_failed")[:2]
        assert second - first < timeout_s + 0.001
        assert events(recording, "recovery")[1] == ("recovery", "clear both costmaps")
        assert recording.run.recoveries > 7
