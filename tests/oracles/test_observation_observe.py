"""Observation of hand-built recordings on small maps, and judging of blocks."""

import numpy as np
import pytest
import shapely
from table import each_row

from vastflow.oracles.judgement.judge import judge_block
from vastflow.oracles.judgement.oracle import oracles_of
from vastflow.oracles.observation.observe import ScenarioObserver, observe_block
from vastflow.oracles.observation.situation import situation_of
from vastflow.oracles.observation.trace import NoReference, Reference, trace_of
from vastflow.sim.model.blocks import read_block, write_recordings
from vastflow.sim.model.digest import FileContent
from vastflow.sim.model.recording import Event
from vastflow.sim.model.scenario import Scenario
from vastflow.sim.world.map_file import load_map


def poses(start=(1.0, 2.0), goal=(5.0, 2.0)):
    return {f"{end}_pose": {"x": x, "y": y} for end, (x, y) in (("start", start), ("goal", goal))}


@pytest.fixture
def room(tmp_path, build):
    """6 m × 4 m with walls one cell (0.05 m) thick."""
    return build.write_map(tmp_path / "room", build.walled_room(6.0, 4.0))


@pytest.fixture
def door(tmp_path, build):
    """A function that writes a map of two rooms with a door of some cells."""

    def make(cells_wide):
        cells = build.walled_room(6.0, 4.0)
        cells[:, 60] = 100
        cells[40 - cells_wide // 2 : 40 + cells_wide // 2, 60] = 0
        return build.write_map(tmp_path / f"door{cells_wide}", cells)

    return make


def scenario_on(map_file, task=None, *, obstacles=(), abstract="builtin:navigate_to_pose", **system):
    environment = {"static_objects": list(obstacles)}
    if map_file is not None:
        environment["map_file"] = FileContent(str(map_file), load_map(map_file).digest)
    return Scenario(abstract, 60.0, environment, task or poses(), system)


def observed(scenario, *recordings):
    observations = read_block(observe_block(scenario, write_recordings(recordings)))
    traces = [trace_of(each, *observation) for each, observation in zip(recordings, observations, strict=True)]
    return traces[0] if len(traces) == 1 else traces


def reference_of(scenario):
    return ScenarioObserver(scenario).references(situation_of(scenario).obstacles)


def test_trace_has_recorded_and_derived_signals_in_si_units(room, build):
    events = tuple(Event(0.1 * k, kind, 0, 0, kind) for k, kind in enumerate(("contact", "recovery", "contact")))
    recording = build.a_recording([(1, 2), (2, 2.5), (3, 2), (3, 2)], error_xy_m=(0.3, 0.4), events=events)
    recording.columns["localized"][1] = 0
    recording.columns["speed_mmps"][:] = [0, 10, 9, 0]
    recording.columns["yaw_rate_mradps"][:] = [0, 0, -9, -10]
    trace = observed(scenario_on(room), recording)
    np.testing.assert_allclose(trace.xy_m, [(1, 2), (2, 2.5), (3, 2), (3, 2)])
    np.testing.assert_allclose(trace["t_s"], [0.0, 0.1, 0.2, 0.3])
    np.testing.assert_allclose(trace["localization_error_m"], 0.5)
    np.testing.assert_allclose(trace.update_errors_m, [0.5] * 3)
    np.testing.assert_array_equal(trace["stopped"], [1, 0, 1, 0])
    assert [event.t_s for event in trace.events("contact")] == [0.0, 0.2]
    ((_, columns),) = read_block(observe_block(scenario_on(room), write_recordings([recording])))
    assert set(columns) == {"localization_error_mm", "stopped", "wall_clearance_mm", "deviation_mm"}


@each_row(
    ("xy_m", "clearance_m"),
    [
        ((1.0, 2.0), 0.95),  # the wall's inner face is at x = 0.05
        ((3.0, 3.95), 0.0),  # touching the face
        ((3.0, 3.97), 0.0),  # inside the wall
        ((3.017, 3.5), 0.45),  # not on a cell's center: straight up all the same
        ((3.0, 2.0), 1.95),
    ],
)
def test_wall_clearance_is_exact_to_millimeter(room, build, xy_m, clearance_m):
    trace = observed(scenario_on(room), build.a_recording([xy_m, xy_m]))
    np.testing.assert_allclose(trace["wall_clearance_m"], clearance_m, atol=5e-4)


def test_wall_clearance_is_to_occupied_cells_alone(tmp_path, build):
    lonely, half = np.zeros((80, 120), dtype=np.int8), build.walled_room(6.0, 4.0)
    lonely[40, 60] = 100  # x 3.0..3.05, y 2.0..2.05: 0.5 m from its corner
    half[:, 60:] = -1
    for name, cells, xy_m, low, high in (
        ("lonely", lonely, (2.7, 1.6), 0.5, 0.5),
        ("half", half, (2.9, 2.0), 1.9, 2.0),
    ):
        trace = observed(scenario_on(build.write_map(tmp_path / name, cells)), build.a_recording([xy_m]))
        assert low - 1e-9 <= trace["wall_clearance_m"][0] <= high + 1e-9
    field = build.write_map(tmp_path / "field", np.zeros((80, 120), dtype=np.int8))
    assert "wall_clearance_m" not in observed(scenario_on(field), build.a_recording([(1, 2), (2, 2)])).columns
    trace = observed(scenario_on(None), build.a_recording([(1, 2), (2, 2)]))
    assert isinstance(trace.reference, NoReference)
    assert {"wall_clearance_m", "deviation_m"}.isdisjoint(trace.columns)


def appearing(box):
    """The box as one that the robot triggers within a meter."""
    return {**box, "spawn_trigger": {"point": {"x": 3.0, "y": 2.0}, "threshold": 1.0}}


SMALL, LARGE = "separation_m/box 0.5 x 0.5 m", "separation_m/box 0.8 x 0.8 m"
BOX = "box_3_2"
SPAWNED = Event(0.2, "spawned", 3.0, 2.0, BOX)
PUSHED = Event(0.4, "obstacle_moved", 3.1, 2.0, BOX, 0.1)


@each_row(
    ("boxes", "xy_m", "events", "signals"),
    [
        # Standing boxes as (x, y, edge); the one at (3, 2) appears where it has an event.
        (
            [(2.0, 3.0, 0.5), (4.0, 3.0, 0.5), (3.0, 0.8, 0.8)],
            [(2, 2), (4, 1.6), (3, 2)],
            (),
            {SMALL: [1.0, 1.4, 2**0.5], LARGE: [2.44**0.5, 1.64**0.5, 1.2], "appearing_clearance_m": None},
        ),
        (
            [(3.0, 2.0, 0.5)],
            [(2.0 + 0.1 * k, 2) for k in range(5)],
            (SPAWNED, PUSHED),
            {SMALL: [np.inf, np.inf, 0.8, 0.7, 0.7], "static_clearance_m": None},
        ),
        (
            [(3.0, 2.0, 0.5), (2.0, 3.0, 0.5)],
            [(2.0, 2), (2.1, 2), (2.8, 2)],
            (Event(0.1, "spawned", 3.0, 2.0, BOX),),
            {
                "static_clearance_m": [0.75, 0.75, (0.55**2 + 0.75**2) ** 0.5],
                "appearing_clearance_m": [np.inf, 0.65, 0.0],
            },
        ),
        # A box that has not appeared yet hides none of its class.
        (
            [(3.0, 2.0, 0.5), (5.0, 2.0, 0.5)],
            [(2, 2), (3, 2)],
            (Event(9.0, "spawned", 3.0, 2.0, BOX),),
            {SMALL: [3.0, 2.0]},
        ),
        ([(3.0, 3.0, 0.5)], [(3, 2), (3, 2)], (Event(0.1, "deleted", 3.0, 3.0, "box_3_3"),), {SMALL: [1.0, np.inf]}),
        ([(3.0, 3.0, 0.5)], [], (), {SMALL: []}),
    ],
)
def test_distances_to_obstacles_follow_events(room, build, boxes, xy_m, events, signals):
    obstacles = [build.box_at(*box) for box in boxes]
    obstacles = [appearing(box) if box["entity_name"] == BOX else box for box in obstacles]
    trace = observed(scenario_on(room, obstacles=obstacles), build.a_recording(xy_m, events=events))
    for name, values in signals.items():
        assert (name in trace.columns) == (values is not None)
        if values is not None:
            np.testing.assert_allclose(trace[name], values, atol=5e-4)


def test_reference_leads_around_obstacles_of_its_run(room, door, build):
    box = appearing(build.box_at(3.0, 2.0))
    runs = [
        build.a_recording([(1, 2), (2, 2)], run_index=k, events=events) for k, events in enumerate([(), (SPAWNED,)])
    ]
    without, around = observed(scenario_on(room, obstacles=[box]), *runs)
    assert without.reference.length_m == pytest.approx(4.0)
    assert around.reference.length_m > 4.2
    free, blocked = observed(scenario_on(door(12), obstacles=[box]), *runs)  # a door of 0.6 m
    assert isinstance(free.reference, Reference) and "deviation_m" in free.columns
    assert isinstance(blocked.reference, NoReference) and "deviation_m" not in blocked.columns


def test_reference_is_shortest_octile_path(room, build):
    reference = reference_of(scenario_on(room))
    np.testing.assert_allclose(reference.points_xy_m, [[1.025, 2.025], [5.025, 2.025]])
    assert reference.length_m == pytest.approx(4.0)
    trace = observed(scenario_on(room), build.a_recording([(1.025, 2.025), (3, 2.325), (5.325, 2.025)]))
    np.testing.assert_allclose(trace["deviation_m"], [0.0, 0.3, 0.3], atol=5e-4)
    reference = reference_of(scenario_on(room, poses((1.0, 1.0), (3.0, 2.0))))
    assert reference.length_m == pytest.approx(1.0 + 2**0.5, abs=1e-3)
    assert np.hypot(*np.diff(reference.points_xy_m, axis=0).T).sum() == pytest.approx(reference.length_m, abs=2e-3)
    assert len(reference.points_xy_m) < 10  # of 41 cells
    loop = {"start_pose": {"x": 1, "y": 2}, "goal_poses": [{"x": 5, "y": 2}, {"x": 1, "y": 2}], "number_of_loops": 1}
    reference = reference_of(scenario_on(room, loop, abstract="builtin:follow_waypoints"))
    assert reference.length_m == pytest.approx(16.0)


def test_reference_keeps_radius_of_robot(room, door, build):
    # Box 2.75..3.25 × 1.75..2.25: the path passes at least 0.22 m beyond its side.
    reference = reference_of(scenario_on(room, obstacles=[build.box_at(3.0, 2.0)]))
    clearance_m = shapely.distance(shapely.box(2.75, 1.75, 3.25, 2.25), shapely.linestrings(reference.points_xy_m))
    assert 0.22 - 0.05 < clearance_m < 0.22 + 0.1
    narrow = door(8)  # 0.4 m
    assert "no path for a robot of radius 0.22 m from start to goal 1" in reference_of(scenario_on(narrow)).reason
    assert isinstance(reference_of(scenario_on(narrow, robot_radius=0.15)), Reference)
    moved = reference_of(scenario_on(room, poses(start=(0.23, 2.0))))  # nearer to the wall than the radius
    assert moved.points_xy_m[0, 0] == pytest.approx(0.275)
    outside = reference_of(scenario_on(room, poses(goal=(50.0, 2.0))))
    assert outside.reason.startswith("goal 1 at (50.00, 2.00) m is more than 0.22 m from any place")


def test_run_is_observed_alike_alone_and_in_block(room, build):
    runs = [build.a_recording([(1, 2), (2, 2 + 0.1 * i)], run_index=i) for i in range(3)]
    together, alone = (
        read_block(observe_block(scenario_on(room), write_recordings(some))) for some in (runs, runs[1:2])
    )
    assert together[1][0] == alone[0][0]
    np.testing.assert_equal(together[1][1], alone[0][1])


SHIFTS = """\
from vastflow.oracles.judgement.oracle import Oracle, Parameters

class Shifts(Oracle[Parameters]):
    Parameters = Parameters

    def judge(self, trace, situation):
        trace["x_m"][:] -= trace["x_m"][0]
        return self.passed(trace)
"""


def test_block_is_judged_run_by_run_in_order_of_oracles(room, build, tmp_path):
    scenario = scenario_on(room, obstacles=[build.box_at(3.0, 2.5)])
    path = [(1.0, 2.0), (3.0, 2.0), (5.0, 2.0)]
    runs = [build.a_recording(path, run_index=i, outcome=o) for i, o in enumerate(("succeeded", "timed_out"))]
    block = write_recordings(runs)
    traces = observe_block(scenario, block)
    verdicts = judge_block(scenario, block, traces, oracles_of([("performance", {}), ("safety", {})])).verdicts
    assert [(v.run_index, v.oracle, v.judgement) for v in verdicts] == [
        (run, oracle, judgement)
        for run, success in ((0, "pass"), (1, "fail"))
        for oracle, judgement in (("success", success), ("performance", "pass"), ("safety", "fail"))
    ]
    (tmp_path / "shifts.py").write_text(SHIFTS)
    with pytest.raises(ValueError, match="read-only"):
        judge_block(scenario, block, traces, oracles_of([("shifts.py:Shifts", {})], tmp_path))
    blocks = [write_recordings([build.a_recording([(1, 2), (2, 2)], run_index=i)]) for i in (0, 1)]
    with pytest.raises(ValueError, match=r"runs \[0\] and traces of runs \[1\] do not belong together"):
        judge_block(scenario, blocks[0], observe_block(scenario, blocks[1]), oracles_of([]))
