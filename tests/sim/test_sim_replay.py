"""Replays: the run they repeat, what is seen in it, and where two recordings of a run part."""

from dataclasses import replace

import numpy as np
import pytest

from vastflow.sim.model.rates import TICK_S
from vastflow.sim.model.recording import Recording, Run
from vastflow.sim.model.scenario import Scenario
from vastflow.sim.nav2.costmaps.inflation import LETHAL, UNKNOWN
from vastflow.sim.replay import Box, first_difference, replay
from vastflow.sim.run import run

TIMEOUT_S = 5.0
ROOM = Box(0.5, 0.5, 3.5, 2.0)
BOX = {"entity_name": "carton", "spawn_pose": {"x": 3.0, "y": 3.6, "yaw": 0.3}}


@pytest.fixture(scope="module")
def short(two_rooms):
    """Five seconds from one room towards the other, past a box."""
    return Scenario(
        "builtin:navigate_to_pose",
        TIMEOUT_S,
        {"map_file": two_rooms, "boxes": [BOX]},
        {"start_pose": {"x": 1.5, "y": 2.0}, "goal_pose": {"x": 7.0, "y": 4.0, "yaw": 0.5}},
        {"laserscan_gaussian_noise_std_deviation": 0.02},
    )


@pytest.fixture(scope="module")
def replayed(short):
    """Looked at as it wakes, as it sets out, in its third second, at its end, and after it."""
    return replay(short, 3, 7, {2: ROOM, 5: ROOM, 50: ROOM, 99: ROOM, 100: ROOM})


def test_watching_a_run_keeps_its_bytes(short, replayed):
    everywhere = replay(short, 3, 7, {tick: ROOM for tick in range(100)}).recording
    assert replayed.recording.digest == run(short, 3, 7).digest == everywhere.digest


def test_moments_of_all_ticks_agree_with_the_recording(replayed):
    assert [moment.tick for moment in replayed.moments] == list(range(round(TIMEOUT_S / TICK_S)))
    columns = replayed.recording.columns
    assert [round(m.t_s * 1e3) for m in replayed.moments[::2]] == columns["t_ms"].tolist()[:-1]
    assert [round(m.true.x_m * 1e3) for m in replayed.moments[::2]] == columns["x_mm"].tolist()[:-1]
    assert [round(m.estimate.y_m * 1e3) for m in replayed.moments[::2]] == columns["estimated_y_mm"].tolist()[:-1]

    activities = [moment.activity for moment in replayed.moments]
    assert list(dict.fromkeys(activities)) == ["resting", "following"]


def test_snapshots_have_the_requested_ticks_and_costs(short, replayed):
    assert [snapshot.moment.tick for snapshot in replayed.snapshots] == [2, 5, 50, 99]
    first, patch, later = replayed.snapshots[0], replayed.snapshots[2].global_costs, replayed.snapshots[2]
    assert (patch.corner.x_m, patch.corner.y_m) == pytest.approx((ROOM.x0, ROOM.y0))
    assert patch.costs.shape == (30, 60)
    assert not np.array_equal(first.scan_xy_m, later.scan_xy_m)
    assert (first.moment.recoveries, first.moment.error_m < 0.01) == (0, True)
    (outside,) = replay(short, 3, 7, {0: Box(20.0, 20.0, 21.0, 21.0)}).snapshots
    assert outside.global_costs.costs.size == 0


def test_scan_ends_on_walls_and_box_and_is_marked(replayed):
    scan = replayed.snapshots[0].scan_xy_m
    walls = np.abs(scan[:, [0]] - [0.2, 8.2]).min(axis=1) < 0.1
    walls |= np.abs(scan[:, [1]] - [0.2, 5.2]).min(axis=1) < 0.1
    walls |= (scan[:, 0] > 4.0) & (scan[:, 0] < 4.4)
    box = np.hypot(scan[:, 0] - 3.0, scan[:, 1] - 3.6) < 0.45
    assert len(scan) > 300
    assert (walls | box).all()
    assert box.sum() > 5
    patch = replayed.snapshots[0].local_costs
    marks = np.argwhere(patch.costs == LETHAL)[:, ::-1]
    at = (patch.corner.x_m, patch.corner.y_m) + (marks + 0.5) * patch.resolution_m  # the start's yaw is 0
    assert len(at) > 10
    away = np.hypot(*(at[:, None] - scan).transpose(2, 0, 1)).min(axis=1)
    assert away.max() < 0.06


def test_plan_leads_to_goal_and_local_plan_is_its_start(replayed):
    snapshot = replayed.snapshots[1]
    assert np.hypot(*(snapshot.plan_xy_m[-1] - (7.0, 4.0))) < 0.1
    ahead = snapshot.ahead_xy_m
    assert 0 < len(ahead) < len(snapshot.plan_xy_m)
    np.testing.assert_array_equal(ahead, snapshot.plan_xy_m[: len(ahead)])
    assert np.abs(ahead[-1] - (1.5, 2.0)).max() <= 1.6  # the local costmap is 3 m wide
    assert [(goal.x_m, goal.y_m, goal.yaw_rad) for goal in snapshot.goals] == [(7.0, 4.0, 0.5)]
    np.testing.assert_allclose([outline.mean(axis=0) for outline in snapshot.obstacles], [[3.0, 3.6]])


def test_trajectory_of_mppi_begins_at_the_estimate(replayed):
    snapshot = replayed.snapshots[2]
    estimate = snapshot.moment.estimate
    assert snapshot.moment.activity == "following" and snapshot.moment.no_command_s == 0.0
    intended = snapshot.intended_xy_m
    assert intended.shape == (57, 2)
    assert tuple(intended[0]) == (estimate.x_m, estimate.y_m)
    assert 0.1 < np.hypot(*(intended[-1] - intended[0])) <= 56 * 0.05 * 0.5


def test_behaviors_alone_may_differ(replayed):
    recording = replayed.recording
    told = recording.behaviors["message"].copy()
    told[-1] = "else"
    changed = replace(recording, behaviors={**recording.behaviors, "message": told})
    difference = first_difference(changed, recording)
    assert difference.what == "behaviors" and "else" in str(difference.recorded)


def test_overview_of_a_large_map_keeps_walls(drawn, saved):
    rows = ["#" * 90, "#" + "." * 44 + "?" * 45, "#" + "." * 44 + "?" * 45, "#" + "." * 44 + "?" * 45, "#" * 90]
    scenario = Scenario(
        "builtin:navigate_to_pose",
        5.0,  # long enough for the goal to be given
        {"map_file": saved(drawn(*rows, cells=15))},
        {"start_pose": {"x": 2.0, "y": 1.9}, "goal_pose": {"x": 6.0, "y": 1.9}},
        {},
    )
    (snapshot,) = replay(scenario, 0, 0, {0: ROOM}).snapshots
    overview, costs = snapshot.overview, snapshot.global_costs
    assert overview.resolution_m == pytest.approx(4 * costs.resolution_m)
    assert overview.costs.shape == (19, 338)
    assert overview.costs[0, 100] == LETHAL
    assert overview.costs[10, 40] == 0
    assert overview.costs[10, -20] == UNKNOWN


def a_recording(**changes):
    samples = np.arange(20, dtype=np.int32)
    columns = {"t_ms": samples * 100, "x_mm": samples * 7, "y_mm": samples * 3}
    run = Run(0, "1:2:0", "succeeded", 0, "", 2.0, 1.0, 0, 0)
    return Recording(replace(run, **changes), columns)


def changed(**columns):
    """The recording with other columns; None leaves one out, and a row number changes its value by one."""
    recording, made = a_recording(), {}
    for name, column in recording.columns.items():
        row = columns.get(name, -1)
        if row is not None:
            made[name] = column + (np.arange(len(column)) == row).astype(np.int32)
    return Recording(recording.run, made)


SHORTER = Recording(a_recording().run, {name: column[:15] for name, column in a_recording().columns.items()})


@pytest.mark.parametrize(
    ("recorded", "executed", "told"),
    [
        (a_recording(), a_recording(), "None"),
        (a_recording(), changed(x_mm=12), "row 12 (1.20 s), x_mm: recorded 84, executed 85"),
        (a_recording(), changed(x_mm=12, y_mm=5), "row 5 (0.50 s), y_mm: recorded 15, executed 16"),
        (a_recording(), SHORTER, "row 15 (1.50 s), t_ms: recorded 1500, executed nothing"),
        (SHORTER, a_recording(), "row 15 (1.50 s), t_ms: recorded nothing, executed 1500"),
        (changed(y_mm=None), a_recording(), "row 0 (0.00 s), y_mm: recorded nothing, executed 0"),
        (a_recording(), a_recording(recoveries=2), "recoveries of the run: recorded 0, executed 2"),
    ],
)
def test_first_difference_is_the_earliest_row_then_the_run_s_row(recorded, executed, told):
    assert str(first_difference(recorded, executed)) == told
