"""Tracks of obstacles, observation of hand-built recordings on small maps, and blocks of these."""

import math
from dataclasses import replace

import numpy as np
import pytest
import shapely
from hypothesis import given
from hypothesis import strategies as st
from table import each_row

from vastflow.oracles.judgment.judge import judge_block
from vastflow.oracles.judgment.registry import oracles_of
from vastflow.oracles.observation.observe import ScenarioObserver, distances_to, observe_block
from vastflow.oracles.observation.obstacle_tracks import obstacle_tracks_of
from vastflow.oracles.observation.situation import Situation, situation_of
from vastflow.oracles.observation.trace import NoReference, Reference, signals_of, trace_of
from vastflow.sim.model.blocks import read_block, write_recordings
from vastflow.sim.model.digest import FileContent
from vastflow.sim.model.obstacle import Obstacle, Trigger
from vastflow.sim.model.pose import Pose
from vastflow.sim.model.recording import Event, Run
from vastflow.sim.model.scenario import Scenario
from vastflow.sim.model.shape import Box, Disc
from vastflow.sim.reading.movers import mover_shapes
from vastflow.sim.world.map_file import load_map
from vastflow.sim.world.world import world_content


def poses(start=(1.0, 2.0), goal=(5.0, 2.0)):
    return {f"{end}_pose": {"x": x, "y": y} for end, (x, y) in (("start", start), ("goal", goal))}


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


def test_wall_clearance_ignores_unknown_cells(tmp_path, build):
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


def spawned(t_s):
    return Event(t_s, "spawned", 3.0, 2.0, BOX)


APPEARED = spawned(0.2)
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
            (APPEARED, PUSHED),
            {SMALL: [np.inf, np.inf, 0.8, 0.7, 0.7], "static_clearance_m": None},
        ),
        (
            [(3.0, 2.0, 0.5), (2.0, 3.0, 0.5)],
            [(2.0, 2), (2.1, 2), (2.8, 2)],
            (spawned(0.1),),
            {
                "static_clearance_m": [0.75, 0.75, (0.55**2 + 0.75**2) ** 0.5],
                "appearing_clearance_m": [np.inf, 0.65, 0.0],
            },
        ),
        # A box that has not appeared yet hides none of its class.
        ([(3.0, 2.0, 0.5), (5.0, 2.0, 0.5)], [(2, 2), (3, 2)], (spawned(9.0),), {SMALL: [3.0, 2.0]}),
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
        build.a_recording([(1, 2), (2, 2)], run_index=k, events=events) for k, events in enumerate([(), (APPEARED,)])
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


def test_run_is_observed_equally_alone_and_in_block(room, build):
    runs = [build.a_recording([(1, 2), (2, 2 + 0.1 * i)], run_index=i) for i in range(3)]
    together, alone = (
        read_block(observe_block(scenario_on(room), write_recordings(some))) for some in (runs, runs[1:2])
    )
    assert together[1][0] == alone[0][0]
    np.testing.assert_equal(together[1][1], alone[0][1])


SHIFTS = """\
from vastflow.oracles.judgment.oracle import Oracle, Parameters

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
    assert [(v.run_index, v.oracle, v.judgment) for v in verdicts] == [
        (run, oracle, judgment)
        for run, success in ((0, "pass"), (1, "fail"))
        for oracle, judgment in (("success", success), ("performance", "pass"), ("safety", "fail"))
    ]
    (tmp_path / "shifts.py").write_text(SHIFTS)
    with pytest.raises(ValueError, match="read-only"):
        judge_block(scenario, block, traces, oracles_of([("shifts.py:Shifts", {})], tmp_path))
    blocks = [write_recordings([build.a_recording([(1, 2), (2, 2)], run_index=i)]) for i in (0, 1)]
    with pytest.raises(ValueError, match=r"runs \[0\] and traces of runs \[1\] do not belong together"):
        judge_block(scenario, blocks[0], observe_block(scenario, blocks[1]), oracles_of([]))


AWAY = (math.inf, math.inf)
HERE = (3.0, 0.0)


def carton(name="carton", x_m=3.0, *, appears=True):
    return Obstacle(name, Box(0.5, 0.5), Pose(x_m, 0.0), Trigger(x_m, 0.0, 1.0) if appears else None)


def event(t_s, kind, x_m=3.0, y_m=0.0, what="carton", value=0.0):
    return Event(t_s, kind, x_m, y_m, what, value)


def found(obstacles, *events):
    run = Run(0, "1", "succeeded", 0, "", 10.0, 5.0, 0, 0, events)
    return obstacle_tracks_of(Situation(None, (), tuple(obstacles)), run)


def places(track, t_s):
    return [tuple(xy) for xy in track.at(np.array([round(t * 1000) for t in t_s], dtype=np.int32)).tolist()]


STANDS, APPEARS, SPAWNED = carton(appears=False), carton(), event(2.0, "spawned")
TWICE = [SPAWNED, event(3.1, "obstacle_moved", 3.05), event(3.2, "obstacle_moved", 3.1)]
GONE = [event(1.0, "deleted"), event(4.0, "spawned", 1.0, 1.0), event(5.0, "deleted", 1.0, 1.0)]


@each_row(
    ("obstacle", "events", "t_s", "at", "appears_s"),
    [
        (STANDS, [], (0.0, 9.0), [HERE, HERE], None),
        (APPEARS, [SPAWNED], (0.0, 1.9, 2.0, 9.0), [AWAY, AWAY, HERE, HERE], 2.0),
        (APPEARS, [event(0.0, "spawned")], (0.0,), [HERE], None),  # from the start
        (APPEARS, [event(2.0, "contact", value=0.2)], (0.0, 9.0), [AWAY, AWAY], None),  # never appeared
        (APPEARS, TWICE, (3.0, 3.1, 3.2, 8.0), [HERE, (3.05, 0.0), (3.1, 0.0), (3.1, 0.0)], 2.0),
        (STANDS, GONE, (0.9, 1.0, 4.0, 5.0), [HERE, AWAY, (1.0, 1.0), AWAY], None),
        (APPEARS, [SPAWNED, event(2.0, "obstacle_moved", 3.2)], (1.9, 2.0), [AWAY, (3.2, 0.0)], 2.0),  # at one time
    ],
)
def test_track_follows_events(obstacle, events, t_s, at, appears_s):
    (track,) = found([obstacle], *events)
    assert (places(track, t_s), track.appears_s) == (at, appears_s)
    assert track.was_there == any(place != AWAY for place in at)


def test_events_mean_obstacle_of_their_name_or_nearest_one():
    other = [event(1.0, "spawned", 6.0, what="other"), event(2.0, "obstacle_moved", 6.5, what="other")]
    first, second = found([STANDS, carton("other", 6.0)], *other)
    assert (places(first, [3.0]), places(second, [3.0])) == ([HERE], [(6.5, 0.0)])
    events = event(1.0, "spawned", 6.0), SPAWNED, event(3.0, "obstacle_moved", 5.9)
    first, second = found([APPEARS, carton(x_m=6.0)], *events)
    assert places(first, (1.0, 2.0, 3.0)) == [AWAY, HERE, HERE]
    assert places(second, (1.0, 2.0, 3.0)) == [(6.0, 0.0), (6.0, 0.0), (5.9, 0.0)]
    with pytest.raises(ValueError, match=r"'spawned' at 2 s: expected .* \('carton'\), got 'crate'"):
        found([APPEARS], event(2.0, "spawned", what="crate"))


@given(st.lists(st.tuples(st.integers(0, 200), st.integers(-50, 50), st.booleans()), max_size=30))
def test_obstacle_is_where_last_event_puts_it(moves):
    moves.sort(key=lambda move: move[0])
    kinds = {True: "deleted", False: "obstacle_moved"}
    events = [event(k * 0.05, kinds[gone], x * 0.1) for k, x, gone in moves]
    (track,) = found([STANDS], *events)
    rows_s = np.arange(100) * 0.1
    for t_s, xy_m in zip(rows_s, places(track, rows_s), strict=True):
        before = [event for event in events if event.t_s <= t_s + 1e-9]
        last = before[-1] if before else event(0.0, "obstacle_moved")
        assert xy_m == (AWAY if last.kind == "deleted" else (last.x_m, last.y_m))


def clearances(obstacle, *events, at, t_s=1.0):
    (track,) = found([obstacle], *events)
    return track.clearance_m(np.full(len(at), round(t_s * 1000), dtype=np.int32), np.array(at)).tolist()


PUSHED = event(1.0, "spawned"), event(2.0, "obstacle_moved", 3.5, value=math.pi / 4)


@given(st.floats(-math.pi, math.pi), st.floats(-3, 3), st.floats(-3, 3), st.sampled_from([Box(0.8, 0.4), Disc(0.4)]))
def test_clearance_agrees_with_shapely(yaw_rad, x_m, y_m, shape):
    obstacle = Obstacle("it", shape, Pose(0.5, -0.5, yaw_rad))
    (clearance_m,) = clearances(obstacle, at=[(x_m, y_m)])
    assert clearance_m == pytest.approx(obstacle.footprint().distance(shapely.Point(x_m, y_m)), abs=1e-3)


def test_clearance_follows_pushed_and_turned_obstacle():
    for t_s, clearance_m in ((0.5, math.inf), (1.0, 0.75), (2.0, 1.5 - 0.25 * math.sqrt(2))):
        assert clearances(APPEARS, *PUSHED, at=[(2.0, 0.0)], t_s=t_s) == pytest.approx([clearance_m])


@each_row("kept", ["map and world", "world"])
def test_run_is_observed_in_world_without_map(tmp_path, room, build, kept):
    """A wall of posts at x = 3 m, around which the reference path leads."""
    (tmp_path / "posts.csv").write_text("".join(f"3.0,{k / 5},0.15\n" for k in range(20)))
    recording = build.a_recording([(1, 2), (2, 2), (2.5, 2)])
    scenario = scenario_on(room if kept == "map and world" else None, poses(goal=(4.0, 2.0)))
    world = {**scenario.environment, "world": world_content(tmp_path / "posts.csv")}
    trace = observed(replace(scenario, environment=world), recording)
    np.testing.assert_allclose(trace["wall_clearance_m"], [1.85, 0.85, 0.35], atol=0.03)
    if kept == "world":
        assert trace.reference.points_xy_m[:, 1].max() > 4.0


# Movers


CART = {"name": "cart", "shape": {"length_m": 1.0, "width_m": 0.5}, "waypoints": [[0.0, 2.0], [9.0, 2.0]]}


def test_mover_has_separation_and_clearance_at_each_row():
    situation = Situation(None, (), (), movers=mover_shapes({"movers": [CART]}))
    t_ms = np.array([0, 100, 200], dtype=np.int32)
    moved = {"mover_x_mm/cart": [0, 100, 200], "mover_y_mm/cart": [2000] * 3, "mover_yaw_mrad/cart": [0, 0, 1571]}
    columns = {"t_ms": t_ms, **{name: np.array(column, dtype=np.int32) for name, column in moved.items()}}
    run = Run(0, "0", "succeeded", 0, "", 1.0, 1.0, 0, 0)
    (track,) = obstacle_tracks_of(situation, run, signals_of(columns))
    assert (track.moves, track.group, track.appears_s, obstacle_tracks_of(situation, run)) == (True, "cart", None, ())
    found = distances_to([track], t_ms, np.zeros((3, 2)))
    assert found["separation_mm/cart"].tolist() == [2000, 2002, 2010]
    # Half a width away while it points along x, half a length once it has turned.
    assert found["moving_clearance_mm"].tolist() == [1750, 1750, 1500]
    assert set(found) == {"separation_mm/cart", "moving_clearance_mm"}
    assert track.outline_m(200).max(axis=0) == pytest.approx((0.2 + 0.25, 2.5), abs=1e-3)
