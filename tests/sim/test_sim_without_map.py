"""Navigation without a map: a global costmap in the odom frame, and a pose from odometry."""

import functools
import math

import numpy as np
import pytest
from driving import drive
from hypothesis import given, settings
from hypothesis import strategies as st
from table import each_row

from vastflow.sim.kernels.numeric import njit
from vastflow.sim.kernels.streams import streams_of
from vastflow.sim.loop.closed_loop import ClosedLoop
from vastflow.sim.model.faults import FileError
from vastflow.sim.model.pose import Pose, placed
from vastflow.sim.model.scenario import Mission
from vastflow.sim.model.shape import Disc
from vastflow.sim.nav2.costmaps.costmap import MARKED, UNSEEN
from vastflow.sim.nav2.costmaps.inflation import FREE, UNKNOWN
from vastflow.sim.nav2.navigator.mapping import update_global
from vastflow.sim.nav2.navigator.prepared import prepare
from vastflow.sim.nav2.navigator.state import new_stack, set_pose
from vastflow.sim.nav2.parameter_files.document import parse
from vastflow.sim.nav2.parameter_files.findings import findings
from vastflow.sim.nav2.parameter_files.interpretation import interpretation
from vastflow.sim.nav2.parameters.costmap import global_costmap
from vastflow.sim.nav2.parameters.stack import NavParameters
from vastflow.sim.replay import Box as Area
from vastflow.sim.replay import moment_of, published_by, snapshot_of
from vastflow.sim.system.robot import OdometryDrift
from vastflow.sim.world.bodies import Body
from vastflow.sim.world.occupancy import OccupancyMap
from vastflow.sim.world.robot_model import Lidar, Robot
from vastflow.sim.world.world import World

NODES = {
    "bt_navigator": "global_frame: odom",
    "local_costmap/local_costmap": "global_frame: odom, rolling_window: true, plugins: []",
    "global_costmap/global_costmap": "global_frame: odom, width: 20, height: 16, resolution: 0.1, origin_x: -4.0, origin_y: -8.0,"
    " static_map: true, plugins: [o, i], o: {plugin: 'nav2_costmap_2d::ObstacleLayer'}, i: {plugin: 'nav2_costmap_2d::InflationLayer'}",
}
START = Pose(-2.0, 3.0, 2.1)
"""Neither along an axis nor at the origin: odometry begins there."""


def read(**changed):
    """The file of a robot without a map, with other parameters of a node; None leaves the node out."""
    nodes = NODES | {name.replace("__", "/"): text for name, text in changed.items()}
    lines = [f"{name}: {{ros__parameters: {{{text}}}}}" for name, text in nodes.items() if text is not None]
    return interpretation(parse("\n".join(lines), "nav2.yaml"))


def window(**values):
    """The parameters of a global costmap without a map."""
    own = {"sized_by_map": False, "in_odom": True, "width": 12, "height": 9, "origin_x": -6.0, "origin_y": -4.5}
    return NavParameters(global_costmap=global_costmap().with_values(**own | values))


def ahead(x_m, y_m, yaw_rad=0.0):
    """A pose in the world that lies so before the robot's start."""
    return placed(Pose(x_m, y_m, yaw_rad), START)


@functools.cache
def columns():
    """A free world with three columns, the second beside the way, and a wall far off."""
    places = [ahead(2.0, 0.1), ahead(3.2, -0.8), ahead(-5.0, 0.0)]
    return World(None, bodies=tuple(Body(f"column {k}", Disc(0.15), at) for k, at in enumerate(places)))


def driven(parameters, goal, world=None, timeout_s=60.0, **watched):
    prepared = prepare(world or columns(), Lidar(), parameters)
    mission = Mission("navigate_to_pose", (goal,))
    return drive(prepared, parameters, Lidar(), Robot(), START, mission, (), (1, 2, 3), timeout_s, **watched)


def end_of(recording, prefix=""):
    return tuple(float(recording.columns[f"{prefix}{axis}_mm"][-1]) * 1e-3 for axis in ("x", "y"))


def test_file_in_odom_without_static_layer_is_modeled():
    found = read()
    costmap = found.parameters.global_costmap
    assert (costmap.in_odom, costmap.sized_by_map, costmap.rolling_window) == (True, False, False)
    assert (costmap.width, costmap.height, costmap.resolution) == (20, 16, 0.1)
    assert (costmap.origin_x, costmap.origin_y) == (-4.0, -8.0)
    said = {each.path[-1]: each for each in findings(found) if each.path[0] == "global_costmap"}
    modeled = {name for name, each in said.items() if each.status == "modeled"}
    assert {"global_frame", "width", "height", "resolution", "origin_x", "origin_y"} <= modeled
    assert said["static_map"].status == "no effect"  # no node of Nav2 reads it
    assert "amcl" in found.left_away and "amcl" not in found.absent
    grid = prepare(columns(), Lidar(), found.parameters).planning
    assert (grid.costs.shape, grid.resolution_m, grid.origin_xy_m) == ((160, 200), 0.1, (-4.0, -8.0))


@each_row(
    ("changed", "words"),
    [
        ({"bt_navigator": "global_frame: map"}, "bt_navigator.*Initial robot pose is not available"),
        ({"bt_navigator": None}, "bt_navigator.*Initial robot pose is not available"),
        (
            {"local_costmap__local_costmap": "global_frame: map, robot_base_frame: base, plugins: []"},
            "Failed to activate local_costmap because transform from base to map did not become available before timeout",
        ),
        (
            {"global_costmap__global_costmap": "global_frame: world, plugins: []"},
            "Failed to activate global_costmap because transform from base_link to world did not become available before timeout",
        ),
        (
            {
                "local_costmap__local_costmap": "global_frame: odom, rolling_window: true, plugins: [s],"
                " s: {plugin: 'nav2_costmap_2d::StaticLayer'}"
            },
            "Costmap timed out waiting for update",
        ),
        (
            {
                "global_costmap__global_costmap": "global_frame: odom, plugins: [], width: 100, height: 100, resolution: 0.01"
            },
            "expected a costmap of at most 25,000,000 cells, got .*100,000,000 cells",
        ),
    ],
)
def test_refusals_without_map_have_nav2s_words(changed, words):
    with pytest.raises(FileError, match=words):
        read(**changed)


@each_row(
    ("node", "text", "words"),
    [
        ("local", "global_frame: map", "A local_costmap in 'map' is not modeled on a map. Expected odom"),
        ("local", "global_frame: world", "local_costmap because transform from base_link to world did not become available"),
        ("local", "rolling_window: false, PLUGINS", "A local_costmap that stays and has a static layer is not modeled. Expected true"),
        ("global", "rolling_window: true, PLUGINS", "A global_costmap that rolls and has a static layer is not modeled. Expected false"),
        ("global", "global_frame: robot/odom, PLUGINS", "A global_costmap in 'robot/odom' is not modeled on a map. Expected map"),
        ("global", "global_frame: world, PLUGINS", "global_costmap because transform from base_link to world did not become available"),
    ],
)  # fmt: skip
def test_file_that_would_drive_otherwise_on_a_map_is_refused(node, text, words):
    nodes = dict.fromkeys(["bt_navigator", "local_costmap__local_costmap", "global_costmap__global_costmap"])
    nodes[f"{node}_costmap__{node}_costmap"] = text.replace(
        "PLUGINS", "plugins: [s], s: {plugin: 'nav2_costmap_2d::StaticLayer'}"
    )
    with pytest.raises(FileError, match=words):
        read(**nodes)


def test_amcl_of_a_file_has_no_effect_without_a_map():
    found = read(amcl="max_particles: 3000", bt_navigator="global_frame: map")
    assert [each.status for each in findings(found) if each.path[0] == "amcl"] == ["no effect"]
    assert any("as without AMCL" in consequence for _, consequence in found.reader.warnings.values())


def test_costmap_without_static_layer_has_its_own_size():
    plugins = (
        "global_frame: map, plugins: [o], o: {plugin: 'nav2_costmap_2d::ObstacleLayer'}, width: 7, rolling_window: true"
    )
    costmap = read(global_costmap__global_costmap=plugins).parameters.global_costmap
    assert (costmap.in_odom, costmap.sized_by_map, costmap.width, costmap.rolling_window) == (False, False, 7, True)


def test_disabled_static_layer_keeps_size_of_map():
    plugins = "global_frame: map, width: 7, plugins: [s], s: {plugin: 'nav2_costmap_2d::StaticLayer', enabled: false}"
    assert read(global_costmap__global_costmap=plugins).parameters.global_costmap.sized_by_map


@each_row("rolling", [False, True])
def test_robot_without_map_arrives_past_columns(rolling):
    found = driven(window(rolling_window=rolling), ahead(4.5, 0.5))
    assert found.run.outcome == "succeeded", found.run
    assert not [event for event in found.run.events if event.kind == "contact"]
    assert math.dist(end_of(found), end_of(found, "estimated_")) < 0.02
    goal = ahead(4.5, 0.5)
    assert math.dist(end_of(found), (goal.x_m, goal.y_m)) < 0.35
    assert not found.columns["localized"].any()


def test_goal_is_where_odometry_takes_it_to_be():
    drifting = window().with_values(odometry=OdometryDrift(rotation_std_per_meter=0.1, translation_std_per_meter=0.05))
    found, goal = driven(drifting, ahead(4.5, 0.5)), ahead(4.5, 0.5)
    assert found.run.outcome == "succeeded", found.run
    assert math.dist(end_of(found, "estimated_"), (goal.x_m, goal.y_m)) < 0.35
    assert math.dist(end_of(found), end_of(found, "estimated_")) > 0.05


@each_row(
    ("values", "code"),
    [
        ({}, 0),
        ({"planner": NavParameters().planner.with_values(allow_unknown=False)}, 208),
        ({"global_costmap": window(track_unknown_space=False).global_costmap}, 0),
        (
            {
                "global_costmap": window(track_unknown_space=False).global_costmap,
                "planner": NavParameters().planner.with_values(allow_unknown=False),
            },
            0,
        ),
        ({"global_costmap": window(width=6, origin_x=-3.0).global_costmap}, 204),
        ({"global_costmap": window(width=6, rolling_window=True).global_costmap}, 204),
        ({"global_costmap": window(origin_x=1.0).global_costmap}, 203),
    ],
)
def test_plan_leads_through_unknown_cells_where_it_may(values, code):
    found = driven(window().with_values(**values), ahead(4.5, 0.5), timeout_s=2.0)
    failed = [int(event.what) for event in found.run.events if event.kind == "plan_failed"]
    assert failed[:1] == [code][: bool(code)]


def test_pictures_lie_where_odometry_began():
    seen = []

    def watch(stack, tick):
        moment = moment_of(stack, tick)
        seen.append((published_by(stack, tick), moment, snapshot_of(stack, moment, Area(-20.0, -20.0, 20.0, 20.0))))

    driven(window(rolling_window=True), ahead(4.5, 0.5), watch=watch, watch_ticks=(100,))
    ((told, moment, shown),) = seen
    assert (told.map_odom.x_m, told.map_odom.y_m, told.map_odom.yaw_rad) == pytest.approx((-2.0, 3.0, 2.1))
    assert moment.error_m < 0.01
    goal = ahead(4.5, 0.5)
    np.testing.assert_allclose(shown.plan_xy_m[-1], (goal.x_m, goal.y_m), atol=1e-6)
    assert (
        shown.goals == (pytest.approx(goal),)
        or math.dist((shown.goals[0].x_m, shown.goals[0].y_m), (goal.x_m, goal.y_m)) < 1e-9
    )
    for patch in (shown.global_costs, shown.overview, shown.local_costs):
        assert patch.corner.yaw_rad == pytest.approx(2.1)
        rows, columns_ = np.nonzero(patch.lethal)
        centers = np.column_stack([columns_ + 0.5, rows + 0.5]) * patch.resolution_m
        c, s = math.cos(2.1), math.sin(2.1)
        placed_m = centers @ np.array([[c, s], [-s, c]]) + (patch.corner.x_m, patch.corner.y_m)
        column = ahead(2.0, 0.1)
        assert abs(np.hypot(*(placed_m - (column.x_m, column.y_m)).T) - 0.15).min() < 0.06


def test_first_scan_is_seen_where_robot_stands():
    """Before the first pose, nothing places odometry."""
    parameters = window()
    loop = ClosedLoop(prepare(columns(), Lidar(), parameters), parameters, Lidar(), Robot(), START, (), (1, 2, 3), 60.0)
    loop.advance(1)
    scan_xy_m = snapshot_of(loop.stack, moment_of(loop.stack, 0), Area(-20.0, -20.0, 20.0, 20.0)).scan_xy_m
    column = ahead(2.0, 0.1)
    assert len(scan_xy_m)
    assert abs(np.hypot(*(scan_xy_m - (column.x_m, column.y_m)).T) - 0.15).min() < 1e-3


@njit
def updated(parameters, memory, grids):
    update_global(parameters[0], memory[0], grids)


def scanning(parameters, world):
    """A step of a new stack: the robot is moved to a place of odometry, and scans there."""
    prepared = prepare(world, Lidar(), parameters)
    rows = np.zeros((0, 7))
    stack = new_stack(prepared, parameters, Lidar(), Robot(), Pose(0.0, 0.0), rows, streams_of([1]), 60.0)
    set_pose(stack, Pose(0.0, 0.0))

    def step(x_m, y_m, yaw_rad, ranges_m):
        m = stack.m[0]
        for prefix in ("odom_", "scan_odom_", ""):
            m[f"{prefix}x"], m[f"{prefix}y"], m[f"{prefix}yaw"] = x_m, y_m, yaw_rad
        m["ranges"][: len(ranges_m)] = ranges_m
        updated(stack.p, stack.m, stack.grids)
        return stack.grids

    return step


# Off the edges of cells, which two origins round to either side.
PLACES_M = st.integers(-90, 90).map(lambda cell: 0.1 * cell + 0.037)
POSES = st.tuples(PLACES_M, PLACES_M, st.floats(-3.2, 3.2), st.integers(0, 2**31))


@settings(max_examples=25, deadline=None)
@given(st.lists(POSES, min_size=1, max_size=8))
def test_rolling_window_equals_whole_costmap_inside(poses):
    """The whole one forgets what the window has left; near its edge it knows of more lethal cells."""
    rolls = scanning(
        window(rolling_window=True, width=6, height=5, resolution=0.1, origin_x=0.0, origin_y=0.0), columns()
    )
    stays = scanning(window(width=30, height=30, resolution=0.1, origin_x=-15.0, origin_y=-15.0), columns())
    for x_m, y_m, yaw_rad, seed in poses:
        ranges_m = np.random.default_rng(seed).uniform(0.2, 4.0, Lidar().beams)
        small, whole = rolls(x_m, y_m, yaw_rad, ranges_m), stays(x_m, y_m, yaw_rad, ranges_m)
        rows, columns_ = small.layer.shape
        column, row = np.rint((small.place[:2] - whole.place[:2]) / 0.1).astype(int)
        assert abs(small.place[0] + 0.5 * 5.95 - x_m) <= 0.1 and abs(small.place[1] + 0.5 * 4.95 - y_m) <= 0.1
        inside = slice(row, row + rows), slice(column, column + columns_)
        np.testing.assert_array_equal(small.layer, whole.layer[inside])
        margin = small.stamp.shape[0] // 2
        core = slice(margin, -margin), slice(margin, -margin)
        np.testing.assert_array_equal(small.costs[core], whole.costs[inside][core])
        outside = np.ones(whole.layer.shape, dtype=bool)
        outside[inside] = False
        whole.layer[outside], whole.costs[outside] = UNSEEN, UNKNOWN


@settings(max_examples=25, deadline=None)
@given(st.floats(-9.0, 9.0), st.floats(-9.0, 9.0), st.sampled_from([True, False]))
def test_cells_that_enter_rolling_window_are_unseen(x_m, y_m, tracked):
    step = scanning(window(rolling_window=True, track_unknown_space=tracked, width=6, height=6), columns())
    nothing = np.full(Lidar().beams, np.inf)
    grids = step(0.0, 0.0, 0.0, nothing)
    grids.layer[:], grids.costs[:] = MARKED, 17
    before = grids.place.copy()
    grids = step(x_m, y_m, 0.0, nothing)
    shift = np.rint((grids.place[:2] - before[:2]) / grids.place[2]).astype(int)
    rows, columns_ = grids.layer.shape
    stayed = np.zeros(grids.layer.shape, dtype=bool)
    low, high = np.maximum(-shift, 0), np.minimum((columns_ - shift[0], rows - shift[1]), (columns_, rows))
    stayed[low[1] : max(high[1], 0), low[0] : max(high[0], 0)] = True
    free = grids.layer == 1  # under the robot
    assert (grids.layer[~stayed & ~free] == UNSEEN).all() and (grids.layer[stayed & ~free] == MARKED).all()


def test_mission_stays_in_local_costmap_that_does_not_roll():
    local = NavParameters().local_costmap.with_values(
        rolling_window=False, width=3, height=3, origin_x=-1.5, origin_y=-1.5
    )
    found = driven(window().with_values(local_costmap=local), ahead(4.5, 0.5), timeout_s=20.0)
    assert found.run.outcome != "succeeded"
    assert 0.8 < math.dist(end_of(found), (START.x_m, START.y_m)) < 2.0


def test_initial_pose_has_no_effect_without_map():
    """Odometry begins where the robot stands, whatever a scenario says."""
    parameters = window()
    given = prepare(columns(), Lidar(), parameters), parameters, Lidar(), Robot(), START, (), (1, 2, 3), 60.0
    loop = ClosedLoop(*given)
    loop.localize(Pose(7.0, 7.0))
    assert loop.localized and loop.estimate == pytest.approx(START)
    loop.advance(5)
    assert math.dist((loop.estimate.x_m, loop.estimate.y_m), (START.x_m, START.y_m)) < 1e-9


def test_walls_of_map_are_unknown_without_map():
    """A campaign's map is the world's walls then."""
    cells = np.zeros((200, 200), dtype=np.int8)
    cells[:, 150:] = 100
    world = World(OccupancyMap(cells, 0.05, (-7.0, -2.0)))
    parameters = window()
    costs = prepare(world, Lidar(), parameters).planning.costs
    assert (costs == UNKNOWN).all()
    assert (prepare(world, Lidar(), window(track_unknown_space=False)).planning.costs == FREE).all()
    found = driven(parameters, ahead(1.0, 0.0), world)
    assert found.run.outcome == "succeeded"
