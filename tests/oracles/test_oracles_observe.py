"""Observation of hand-built recordings on small maps."""

from collections.abc import Callable, Mapping
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
import shapely

from vastflow.oracles.judgement.judge import judge_block
from vastflow.oracles.judgement.oracle import oracles_of
from vastflow.oracles.observation.observe import observe_block, observer_of
from vastflow.oracles.observation.situation import situation_of
from vastflow.oracles.observation.trace import MaybeReference, NoReference, Reference, Trace, trace_of
from vastflow.sim.model.blocks import read_block, read_recordings, write_recordings
from vastflow.sim.model.digest import FileContent
from vastflow.sim.model.recording import Event, Recording
from vastflow.sim.model.scenario import Scenario
from vastflow.sim.world.map_file import load_map

TASK = {"start_pose": {"x": 1.0, "y": 2.0}, "goal_pose": {"x": 5.0, "y": 2.0}}
ScenarioOn = Callable[..., Scenario]


@pytest.fixture
def room(tmp_path: Path, build: SimpleNamespace) -> Path:
    """6 m × 4 m with walls one cell (0.05 m) thick."""
    return build.write_map(tmp_path / "room", build.walled_room(6.0, 4.0))


@pytest.fixture
def scenario_on() -> ScenarioOn:
    def make(
        map_file: Path | None,
        task: Mapping[str, Any] = TASK,
        *,
        obstacles: Any = (),
        abstract: str = "builtin:navigate_to_pose",
        **system: Any,
    ) -> Scenario:
        environment: dict[str, Any] = {"static_objects": list(obstacles)}
        if map_file is not None:
            environment["map_file"] = FileContent(str(map_file), load_map(map_file).digest)
        return Scenario(abstract, 60.0, environment, task, system)

    return make


def observed(scenario: Scenario, recording: Recording) -> Trace:
    ((row, columns),) = read_block(observe_block(scenario, write_recordings([recording])))
    return trace_of(recording, row, columns)


def reference_of(scenario: Scenario) -> MaybeReference:
    return observer_of(scenario).references(situation_of(scenario).obstacles)


def test_localization_error_is_the_distance_of_estimate_and_truth(scenario_on, room, build) -> None:
    trace = observed(scenario_on(room), build.a_recording([(1, 2), (2, 2)], error_xy_m=(0.3, 0.4)))
    np.testing.assert_allclose(trace["localization_error_m"], [0.5, 0.5])


@pytest.mark.parametrize(
    ("xy_m", "clearance_m"),
    [
        ((1.0, 2.0), 0.95),  # the wall's inner face is at x = 0.05
        ((3.0, 3.95), 0.0),  # touching the face
        ((3.0, 3.97), 0.0),  # inside the wall
        ((3.017, 3.5), 0.45),  # not on a cell's center: straight up all the same
        ((3.0, 2.0), 1.95),
    ],
)
def test_wall_clearance_is_exact_to_the_millimeter(scenario_on, room, build, xy_m, clearance_m) -> None:
    trace = observed(scenario_on(room), build.a_recording([xy_m, xy_m]))
    np.testing.assert_allclose(trace["wall_clearance_m"], clearance_m, atol=5e-4)


def test_wall_clearance_to_a_single_cell_goes_to_its_corner(scenario_on, tmp_path, build) -> None:
    cells = np.zeros((80, 120), dtype=np.int8)
    cells[40, 60] = 100  # x 3.0..3.05, y 2.0..2.05
    lonely = build.write_map(tmp_path / "lonely", cells)
    trace = observed(scenario_on(lonely), build.a_recording([(2.7, 1.6), (2.7, 1.6)]))
    np.testing.assert_allclose(trace["wall_clearance_m"], 0.5)


def test_unknown_cells_are_no_walls(scenario_on, tmp_path, build) -> None:
    cells = build.walled_room(6.0, 4.0)
    cells[:, 60:] = -1
    half = build.write_map(tmp_path / "half", cells)
    trace = observed(scenario_on(half), build.a_recording([(2.9, 2.0), (2.9, 2.0)]))
    assert trace["wall_clearance_m"][0] > 1.9


def test_map_without_walls_has_no_clearance(scenario_on, tmp_path, build) -> None:
    field = build.write_map(tmp_path / "field", np.zeros((80, 120), dtype=np.int8))
    assert "wall_clearance_m" not in observed(scenario_on(field), build.a_recording([(1, 2), (2, 2)])).columns


def test_separation_is_from_center_to_nearest_center_of_a_size_class(scenario_on, room, build) -> None:
    obstacles = [build.box_at(2.0, 3.0), build.box_at(4.0, 3.0), build.box_at(3.0, 0.8, edge_m=0.8)]
    trace = observed(scenario_on(room, obstacles=obstacles), build.a_recording([(2, 2), (4, 1.6), (3, 2)]))
    np.testing.assert_allclose(trace["separation_m/box 0.5 x 0.5 m"], [1.0, 1.4, 2**0.5], atol=5e-4)
    np.testing.assert_allclose(trace["separation_m/box 0.8 x 0.8 m"], [2.44**0.5, 1.64**0.5, 1.2], atol=5e-4)


def appearing(box: Mapping[str, Any]) -> dict[str, Any]:
    """`box` as one that the robot sets off within a meter."""
    return {**box, "spawn_trigger": {"point": {"x": 3.0, "y": 2.0}, "threshold": 1.0}}


def test_obstacle_that_appears_and_is_pushed_is_separated_from_where_it_is_then(scenario_on, room, build) -> None:
    box = build.box_at(3.0, 2.0)
    events = (
        Event(0.2, "spawned", 3.0, 2.0, box["entity_name"]),
        Event(0.4, "obstacle_moved", 3.1, 2.0, box["entity_name"], 0.1),
    )
    recording = build.a_recording([(2.0, 2), (2.1, 2), (2.2, 2), (2.3, 2), (2.4, 2)], events=events)
    trace = observed(scenario_on(room, obstacles=[appearing(box)]), recording)
    np.testing.assert_allclose(trace["separation_m/box 0.5 x 0.5 m"], [np.inf, np.inf, 0.8, 0.7, 0.7], atol=5e-4)


def test_clearance_is_told_apart_for_what_stands_and_for_what_appears(scenario_on, room, build) -> None:
    appears, stands = build.box_at(3.0, 2.0), build.box_at(2.0, 3.0)
    events = (Event(0.1, "spawned", 3.0, 2.0, appears["entity_name"]),)
    recording = build.a_recording([(2.0, 2), (2.1, 2), (2.8, 2)], events=events)
    trace = observed(scenario_on(room, obstacles=[appearing(appears), stands]), recording)
    np.testing.assert_allclose(trace["static_clearance_m"], [0.75, 0.75, (0.55**2 + 0.75**2) ** 0.5], atol=5e-4)
    np.testing.assert_allclose(trace["appearing_clearance_m"], [np.inf, 0.65, 0.0], atol=5e-4)


def test_without_obstacles_of_a_kind_there_is_no_clearance_from_them(scenario_on, room, build) -> None:
    trace = observed(scenario_on(room, obstacles=[build.box_at(3.0, 3.0)]), build.a_recording([(2, 2), (3, 2)]))
    assert "static_clearance_m" in trace.columns
    assert "appearing_clearance_m" not in trace.columns


def test_error_at_each_update_is_that_of_its_row(scenario_on, room, build) -> None:
    recording = build.a_recording([(1, 2), (2, 2), (3, 2)], error_xy_m=(0.3, 0.4))
    recording.columns["localized"][1] = 0
    np.testing.assert_allclose(observed(scenario_on(room), recording).update_errors_m, [0.5, 0.5])


def test_robot_is_stopped_where_it_neither_drives_nor_turns(scenario_on, room, build) -> None:
    recording = build.a_recording([(1, 2), (1, 2), (1, 2), (1, 2)])
    recording.columns["speed_mmps"][:] = [0, 10, 9, 0]
    recording.columns["yaw_rate_mradps"][:] = [0, 0, -9, -10]
    np.testing.assert_array_equal(observed(scenario_on(room), recording)["stopped"], [1, 0, 1, 0])


def test_events_of_a_kind_are_told_in_order(scenario_on, room, build) -> None:
    events = (
        Event(0.1, "contact", 0, 0, "wall"),
        Event(0.2, "recovery", 0, 0, "spin"),
        Event(0.3, "contact", 0, 0, "x"),
    )
    trace = observed(scenario_on(room), build.a_recording([(1, 2), (2, 2)], events=events))
    assert [event.what for event in trace.events("contact")] == ["wall", "x"]


def test_what_has_not_appeared_yet_hides_no_obstacle_of_its_class_that_stands(scenario_on, room, build) -> None:
    obstacles = [appearing(build.box_at(3.0, 2.0)), build.box_at(5.0, 2.0)]
    trace = observed(scenario_on(room, obstacles=obstacles), build.a_recording([(2, 2), (3, 2)]))
    np.testing.assert_allclose(trace["separation_m/box 0.5 x 0.5 m"], [3.0, 2.0], atol=5e-4)


def test_obstacle_that_is_deleted_is_infinitely_far_from_then_on(scenario_on, room, build) -> None:
    box = build.box_at(3.0, 2.0)
    deleted = Event(0.1, "deleted", 3.0, 2.0, box["entity_name"])
    trace = observed(scenario_on(room, obstacles=[box]), build.a_recording([(2, 2), (2, 2)], events=(deleted,)))
    np.testing.assert_allclose(trace["separation_m/box 0.5 x 0.5 m"], [1.0, np.inf])


def test_reference_goes_round_what_appeared_and_through_what_did_not(scenario_on, room, build) -> None:
    box = build.box_at(3.0, 2.0)
    scenario = scenario_on(room, obstacles=[appearing(box)])
    spawned = Event(0.1, "spawned", 3.0, 2.0, box["entity_name"])
    block = write_recordings(
        [build.a_recording([(1, 2), (2, 2)], run_index=k, events=events) for k, events in enumerate([(), (spawned,)])]
    )
    without, around = (
        trace_of(recording, row, columns).reference
        for recording, (row, columns) in zip(
            read_recordings(block), read_block(observe_block(scenario, block)), strict=True
        )
    )
    assert isinstance(without, Reference) and isinstance(around, Reference)
    assert without.length_m == pytest.approx(4.0)
    assert around.length_m > 4.2


def test_runs_with_a_reference_and_without_one_make_one_block(scenario_on, tmp_path, build) -> None:
    cells = build.walled_room(6.0, 4.0)
    cells[:, 60] = 100
    cells[34:46, 60] = 0  # a door of 0.6 m
    box = build.box_at(3.0, 2.0)
    scenario = scenario_on(build.write_map(tmp_path / "door", cells), obstacles=[appearing(box)])
    spawned = Event(0.1, "spawned", 3.0, 2.0, box["entity_name"])
    runs = [
        build.a_recording([(1, 2), (2, 2)], run_index=k, events=events) for k, events in enumerate([(), (spawned,)])
    ]
    observations = read_block(observe_block(scenario, write_recordings(runs)))
    free, blocked = (trace_of(run, row, columns) for run, (row, columns) in zip(runs, observations, strict=True))
    assert isinstance(free.reference, Reference) and "deviation_m" in free.columns
    assert isinstance(blocked.reference, NoReference) and "deviation_m" not in blocked.columns


def test_deviation_is_the_distance_to_the_nearest_point_of_the_reference(scenario_on, room, build) -> None:
    trace = observed(scenario_on(room), build.a_recording([(1.025, 2.025), (3, 2.325), (5.325, 2.025)]))
    np.testing.assert_allclose(trace["deviation_m"], [0.0, 0.3, 0.3], atol=5e-4)


def test_free_straight_way_has_its_ends_as_reference(scenario_on, room, build) -> None:
    reference = reference_of(scenario_on(room))
    assert isinstance(reference, Reference)
    np.testing.assert_allclose(reference.points_xy_m, [[1.025, 2.025], [5.025, 2.025]])
    assert reference.length_m == pytest.approx(4.0)


def test_reference_is_octile_and_keeps_its_corners_alone(scenario_on, room) -> None:
    task = {"start_pose": {"x": 1.0, "y": 1.0}, "goal_pose": {"x": 3.0, "y": 2.0}}
    reference = reference_of(scenario_on(room, task))
    assert isinstance(reference, Reference)
    assert reference.length_m == pytest.approx(1.0 + 2**0.5, abs=1e-3)
    assert np.hypot(*np.diff(reference.points_xy_m, axis=0).T).sum() == pytest.approx(reference.length_m, abs=2e-3)
    assert len(reference.points_xy_m) < 10  # of 41 cells


def test_reference_goes_round_obstacles_by_the_robots_radius(scenario_on, room) -> None:
    # Box 2.75..3.25 × 1.75..2.25: the way passes at least 0.22 m beyond its side.
    wall = {"entity_name": "b", "model": "box", "spawn_pose": {"x": 3.0, "y": 2.0}, "xacro_arguments": "width:=0.5"}
    reference = reference_of(scenario_on(room, obstacles=[wall]))
    assert isinstance(reference, Reference)
    clearance_m = shapely.distance(shapely.box(2.75, 1.75, 3.25, 2.25), shapely.linestrings(reference.points_xy_m))
    assert 0.22 - 0.05 < clearance_m < 0.22 + 0.1


def test_loops_repeat_the_goals(scenario_on, room) -> None:
    task = {"start_pose": {"x": 1, "y": 2}, "goal_poses": [{"x": 5, "y": 2}, {"x": 1, "y": 2}], "number_of_loops": 1}
    reference = reference_of(scenario_on(room, task, abstract="builtin:follow_waypoints"))
    assert isinstance(reference, Reference)
    assert reference.length_m == pytest.approx(16.0)


def test_there_is_no_reference_through_a_gap_too_narrow_for_the_robot(scenario_on, tmp_path, build) -> None:
    cells = build.walled_room(6.0, 4.0)
    cells[:, 60] = 100
    cells[36:44, 60] = 0  # a door of 0.4 m
    door = build.write_map(tmp_path / "door", cells)
    wide, slim = reference_of(scenario_on(door)), reference_of(scenario_on(door, robot_radius=0.15))
    assert isinstance(wide, NoReference)
    assert "no path for a robot of radius 0.22 m from start to goal 1" in wide.reason
    assert isinstance(slim, Reference)


def test_start_nearer_to_the_wall_than_the_radius_is_moved_to_where_the_robot_fits(scenario_on, room) -> None:
    task = {"start_pose": {"x": 0.23, "y": 2.0}, "goal_pose": {"x": 5.0, "y": 2.0}}
    reference = reference_of(scenario_on(room, task))
    assert isinstance(reference, Reference)
    assert reference.points_xy_m[0, 0] == pytest.approx(0.275)


def test_goal_outside_the_map_has_no_reference(scenario_on, room) -> None:
    task = {"start_pose": {"x": 1.0, "y": 2.0}, "goal_pose": {"x": 50.0, "y": 2.0}}
    reference = reference_of(scenario_on(room, task))
    assert isinstance(reference, NoReference)
    assert reference.reason.startswith("goal 1 at (50.00, 2.00) m is more than 0.22 m from any place")


def test_scenario_without_a_map_is_observed_without_walls_and_reference(scenario_on, build) -> None:
    trace = observed(scenario_on(None), build.a_recording([(1, 2), (2, 2)]))
    assert isinstance(trace.reference, NoReference)
    assert {"wall_clearance_m", "deviation_m"}.isdisjoint(trace.columns)


def test_trace_has_the_recordings_signals_in_si_units(scenario_on, room, build) -> None:
    trace = observed(scenario_on(room), build.a_recording([(1, 2), (2, 2.5)]))
    np.testing.assert_allclose(trace.xy_m, [(1, 2), (2, 2.5)])
    np.testing.assert_allclose(trace["t_s"], [0.0, 0.1])
    np.testing.assert_allclose(trace["localized"], [1, 1])


def test_block_stores_the_derived_columns_alone(scenario_on, room, build) -> None:
    block = observe_block(scenario_on(room), write_recordings([build.a_recording([(1, 2), (2, 2)])]))
    ((_, columns),) = read_block(block)
    assert set(columns) == {"localization_error_mm", "stopped", "wall_clearance_mm", "deviation_mm"}


def test_run_is_observed_alike_alone_and_in_a_block(scenario_on, room, build) -> None:
    runs = [build.a_recording([(1, 2), (2, 2 + 0.1 * i)], run_index=i) for i in range(3)]
    together = observe_block(scenario_on(room), write_recordings(runs))
    alone = observe_block(scenario_on(room), write_recordings(runs[1:2]))
    (row, columns), ((row_alone, columns_alone),) = read_block(together)[1], read_block(alone)
    assert row == row_alone
    np.testing.assert_equal(columns, columns_alone)


def test_recording_without_rows_is_observed(scenario_on, room, build) -> None:
    assert len(observed(scenario_on(room, obstacles=[build.box_at(3, 3)]), build.a_recording([]))) == 0


def test_block_is_judged_run_by_run_in_the_order_of_the_oracles(scenario_on, room, build) -> None:
    scenario = scenario_on(room, obstacles=[build.box_at(3.0, 2.5)])
    way = [(1.0, 2.0), (3.0, 2.0), (5.0, 2.0)]
    runs = [build.a_recording(way, run_index=i, outcome=o) for i, o in enumerate(("succeeded", "timed_out"))]
    block = write_recordings(runs)
    verdicts = judge_block(
        scenario, block, observe_block(scenario, block), oracles_of([("performance", {}), ("safety", {})])
    ).verdicts
    assert [(v.run_index, v.oracle, v.judgement) for v in verdicts] == [
        (0, "success", "pass"),
        (0, "performance", "pass"),
        (0, "safety", "fail"),
        (1, "success", "fail"),
        (1, "performance", "pass"),
        (1, "safety", "fail"),
    ]


def test_oracle_that_changes_a_column_fails_there_and_the_next_one_reads_what_was_recorded(
    scenario_on, room, build, tmp_path
) -> None:
    (tmp_path / "shifts.py").write_text(SHIFTS)
    block = write_recordings([build.a_recording([(1.0, 2.0), (5.0, 2.0)])])
    oracles = oracles_of([("shifts.py:Shifts", {})], tmp_path)
    with pytest.raises(ValueError, match="read-only"):
        judge_block(scenario_on(room), block, observe_block(scenario_on(room), block), oracles)


SHIFTS = """\
from vastflow.oracles.judgement.oracle import Oracle, Parameters

class Shifts(Oracle[Parameters]):
    Parameters = Parameters

    def judge(self, trace, situation):
        trace["x_m"][:] -= trace["x_m"][0]
        return self.passed(trace)
"""


def test_recordings_and_traces_of_different_runs_are_not_judged_together(scenario_on, room, build) -> None:
    blocks = [write_recordings([build.a_recording([(1, 2), (2, 2)], run_index=i)]) for i in (0, 1)]
    with pytest.raises(ValueError, match=r"runs \[0\] and traces of runs \[1\] do not belong together"):
        judge_block(scenario_on(room), blocks[0], observe_block(scenario_on(room), blocks[1]), oracles_of([]))
