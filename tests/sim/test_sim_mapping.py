"""Window and global map after one tick of the stack at rest."""

from types import SimpleNamespace

import numpy as np
import pytest

from vastflow.sim.kernels.numeric import njit
from vastflow.sim.kernels.streams import streams_of
from vastflow.sim.model.obstacle import obstacle_of
from vastflow.sim.model.pose import Pose, pose_of
from vastflow.sim.model.scenario import Mission
from vastflow.sim.nav2.costmaps.costmap import MARKED, SEEN_FREE, UNSEEN
from vastflow.sim.nav2.navigator.mapping import clear_local, update_global, update_local
from vastflow.sim.nav2.navigator.prepared import prepare
from vastflow.sim.nav2.navigator.state import give, new_stack, set_pose
from vastflow.sim.nav2.navigator.tick import advance
from vastflow.sim.nav2.parameters.costmap import Costmap, StaticLayer, global_costmap
from vastflow.sim.nav2.parameters.stack import NavParameters
from vastflow.sim.world.map_file import load_map
from vastflow.sim.world.motion import FREE, Body
from vastflow.sim.world.obstacle_rows import obstacle_rows, trigger_rows
from vastflow.sim.world.robot_model import Lidar, Robot
from vastflow.sim.world.world import World

START = {"x": 2.98, "y": 2.42}
CRATE = {"model": "box", "xacro_arguments": "length:=0.16, width:=0.8", "spawn_pose": {"x": 4.0, "y": 2.42}}
"""Its face is at x 3.92, 0.98 m ahead of the sensor, which sits at x 2.94."""


@pytest.fixture(scope="module")
def prepared(two_rooms):
    return prepare(World(load_map(two_rooms.path)), Lidar(), NavParameters())


@pytest.fixture
def after_a_tick(prepared, scenario):
    """The stack after its first tick, its layers filled with `before`; the robot stands before the door, facing it."""

    def tick(before=UNSEEN, obstacles=(CRATE,), parameters=NavParameters(), **start):  # noqa: B008
        here = pose_of({**START, **start})
        standing = tuple(obstacle_of(entry) for entry in obstacles)
        rows = obstacle_rows(standing)
        stack = new_stack(prepared, parameters, Lidar(), Robot(), here, rows, streams_of([1]), 60.0)
        set_pose(stack, here)
        stack = give(stack, Mission("navigate_to_pose", (Pose(7.0, 4.0),)))
        stack.local.layer[:] = before
        stack.grids.layer[:] = before
        body = Body(
            np.array([here.x_m, here.y_m, here.yaw_rad]),
            Robot().radius_m,
            rows,
            trigger_rows(standing),
            np.zeros((2, 0, 3)),
        )
        state = stack.p, stack.m, stack.grids, stack.local, stack.cloud, stack.route
        advance(*state, stack.controller.bound, stack.noise.bound, stack.rows, body, FREE, 1)
        return stack

    return tick


def test_marks_are_cleared_up_to_the_scan(after_a_tick):
    stack = after_a_tick(MARKED)
    window, everywhere = stack.local.layer[30], stack.grids.layer[48]
    assert (window[29:47] == SEEN_FREE).all() and (window[47:49] == MARKED).all()
    assert (everywhere[58:78] == SEEN_FREE).all() and everywhere[78] == MARKED


def test_window_has_the_frame_of_odometry_and_the_size_of_its_parameters(after_a_tick):
    local = after_a_tick(yaw=1.0).local
    np.testing.assert_allclose(local.window.place, (-1.5, -1.5, 0.05))
    assert local.layer[30, 30] == SEEN_FREE
    wide = after_a_tick(parameters=NavParameters(local_costmap=Costmap(width=4, height=5, resolution=0.1))).local.window
    assert wide.costs.shape == (50, 40)
    np.testing.assert_allclose(wide.place, (-2.0, -2.5, 0.1))
    broken = NavParameters(
        local_costmap=Costmap(width=4, height=5, resolution=0.06)
    )  # 66.7 and 83.3 cells: Nav2 has whole ones
    assert after_a_tick(parameters=broken).local.layer.shape == (83, 66)


def test_obstacle_ahead_is_ahead_in_window_at_any_heading(after_a_tick):
    """Odometry begins at zero; the global map keeps the directions of the map."""
    ahead = {**CRATE, "spawn_pose": {"x": 2.98, "y": 3.44, "yaw": np.pi / 2}}
    stack = after_a_tick(obstacles=(ahead,), yaw=np.pi / 2)
    assert stack.local.layer[30, 48] == MARKED
    assert stack.grids.layer[67, 59] == MARKED


def test_static_layer_puts_the_map_s_walls_into_the_window(after_a_tick):
    """TurtleBot 4's own file has one: its error then makes phantom walls (here there is none)."""
    with_walls = NavParameters(local_costmap=Costmap(static_layer=StaticLayer(enabled=True)))
    costs = after_a_tick(parameters=with_walls).local.window.costs
    # The wall's near face is at x 4.1 m, 1.12 m ahead of the robot; beside the door (y 1.8..3.0 m) it is seen nowhere.
    assert costs[50, 53] == 254
    plain = after_a_tick().local
    assert plain.window.costs[50, 53] < 254
    assert (plain.layer[30, 52:55] == UNSEEN).all()  # the wall's place behind the crate


def test_global_costs_join_walls_and_obstacle_in_a_copy(after_a_tick, prepared, two_rooms):
    unused = NavParameters(global_costmap=global_costmap().with_values(static_layer=StaticLayer(enabled=False)))
    assert not prepare(World(load_map(two_rooms.path)), Lidar(), unused).planning.costs.any()
    shared = prepared.planning.costs, prepared.planning.free_costs, prepared.static
    before = [each.copy() for each in shared]
    costs = after_a_tick(MARKED).grids.costs
    np.testing.assert_array_equal(before, shared)
    assert costs[48, 78] == 254  # the crate
    assert prepared.planning.costs[48, 78] < 253
    assert costs[70, 83] == 254  # the wall beside the door


@njit
def updated(parameters, memory, grids, local):
    update_local(parameters[0], memory[0], grids, local)
    update_global(parameters[0], memory[0], grids)


def test_scan_is_put_where_it_was_taken_although_the_robot_has_turned_since(after_a_tick):
    """A costmap updates between two scans: with the turn the marks would lie 10 cm off."""
    stack = after_a_tick()
    layers = stack.local.layer, stack.grids.layer
    once = [layer == MARKED for layer in layers]
    for layer in layers:
        layer[:] = UNSEEN
    for yaw in ("odom_yaw", "yaw"):
        stack.m[0][yaw] += 0.1
    updated(stack.p, stack.m, stack.grids, stack.local)
    for layer, marked in zip(layers, once, strict=True):
        np.testing.assert_array_equal(layer == MARKED, marked)


def test_cells_under_the_robot_are_not_marked(after_a_tick):
    """The outline of the footprint reaches 4.6 cells; a crate is put over the robot itself."""
    over = {**CRATE, "xacro_arguments": "width:=0.3, length:=0.3", "spawn_pose": {"x": 2.98, "y": 2.42}}
    stack = after_a_tick(obstacles=(over,))
    assert not (stack.local.layer[26:35, 26:35] == MARKED).any()
    assert not (stack.grids.layer[44:53, 55:64] == MARKED).any()


def test_clearing_local_costmap_reaches_its_lowest_row():
    layer, costs = np.full((3, 4), MARKED, np.uint8), np.full((3, 4), MARKED, np.uint8)
    local = SimpleNamespace(layer=layer, window=SimpleNamespace(costs=costs))
    clear_local.py_func(SimpleNamespace(), local)
    assert (layer == UNSEEN).all() and not costs.any()
