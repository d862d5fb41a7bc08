"""The global plan beside what NavFn finds afresh: the short form of docs/studies/path_cost.py, and the planner at its desk."""

from pathlib import Path

import numpy as np
import path_cost as proof
import pytest
from navfn_paths import path
from table import each_row

from vastflow.sim.kernels.numeric import njit
from vastflow.sim.kernels.streams import streams_of
from vastflow.sim.model.pose import Pose
from vastflow.sim.model.scenario import Mission
from vastflow.sim.nav2.navigator.behavior import plan
from vastflow.sim.nav2.navigator.prepared import prepare
from vastflow.sim.nav2.navigator.state import give, new_stack, set_pose
from vastflow.sim.nav2.parameters.servers import NavFn
from vastflow.sim.nav2.parameters.stack import NavParameters
from vastflow.sim.nav2.planners.navfn import travel_costs
from vastflow.sim.nav2.planners.planner import NO_VALID_PATH
from vastflow.sim.world.occupancy import OccupancyMap
from vastflow.sim.world.robot_model import Lidar, Robot
from vastflow.sim.world.world import World

OFFICE = Path(__file__).parents[2] / "campaigns" / "quickstart" / "maps" / "office.yaml"
RESOLUTION_M = 0.05


@each_row("condition", ["nothing else", "boxes", "noise 0.1 m"])
def test_path_in_closed_loop_costs_as_much_as_a_fresh_one(condition):
    configurations = proof.instantiated(OFFICE, condition, 7.0, 3).configurations
    excess = np.concatenate([proof.excesses(configuration.scenario, 0) for configuration in configurations])
    assert len(excess) > 30
    assert np.median(excess) == pytest.approx(0.0, abs=1e-4)
    assert np.percentile(excess, 95) <= 0.01
    assert excess.max() <= 0.05


@njit
def planned(parameters, memory, grids, route):
    return plan(parameters[0], memory[0], grids, route)


class Desk:
    """A planner whose costs and place are set by hand; points are (x, y) in meters."""

    def __init__(self, cells, *goals, kind="navigate_to_pose", start=(1.0, 3.0), use_astar=False):
        parameters = NavParameters(planner=NavFn(use_astar=use_astar))
        prepared = prepare(World(OccupancyMap(cells, RESOLUTION_M, (0.0, 0.0))), Lidar(), parameters)
        here, mission = Pose(*start, 0.0), Mission(kind, tuple(Pose(x, y, 0.0) for x, y in goals))
        obstacles = np.zeros((0, 7))
        stack = new_stack(prepared, parameters, Lidar(), Robot(), here, obstacles, streams_of([1]), 60.0)
        set_pose(stack, here)
        self.take(give(stack, mission))

    def take(self, stack):
        self.stack, self.m, self.grids, self.route = stack, stack.m[0], stack.grids, stack.route
        self.memory = stack.planner.memory

    def cost(self, rows, columns, value):
        """Set a part of the costmap."""
        self.grids.costs[rows, columns] = value
        self.memory.travel[:] = travel_costs(self.grids.costs)

    def plan(self, x, y):
        self.m["x"], self.m["y"] = x, y
        return planned(self.stack.p, self.stack.m, self.grids, self.route)

    @property
    def path(self):
        """The path in use, in cells."""
        return self.route.path[: self.m["path_n"], :2] / RESOLUTION_M

    def fresh(self, start, goal, use_astar=False):
        """NavFn's path between two points on the present costs, in cells."""
        return path(self.grids.costs, tuple(cells_of(start)), tuple(cells_of(goal)), use_astar=use_astar)


def cells_of(point):
    return np.floor(np.array(point) / RESOLUTION_M + 0.5).astype(int).tolist()


def two_doors():
    """Return two rooms of 4 m × 6 m with doors at y 1..2 m and 4..5 m."""
    cells = np.zeros((120, 162), dtype=np.int8)
    cells[:2], cells[-2:], cells[:, :2], cells[:, -2:] = 100, 100, 100, 100
    cells[:, 80:82] = 100
    cells[20:40, 80:82], cells[80:100, 80:82] = 0, 0
    return cells


LOWER, UPPER = (slice(20, 40), slice(80, 82)), (slice(80, 100), slice(80, 82))


def at_the_wall(way):
    """y in meters where a path passes the wall between the rooms."""
    return float(way[np.argmax(way[:, 0] > 80.0), 1] * RESOLUTION_M)


def test_replanned_paths_match_navfn():
    desk = Desk(two_doors(), (7.0, 1.5))
    for start in [(1.0, 3.0), (2.0, 2.3), (3.2, 1.7), (4.5, 1.5), (6.0, 1.5)]:
        assert desk.plan(*start) == 0
        fresh = desk.fresh(start, (7.0, 1.5))
        assert desk.path[:-1] == pytest.approx(fresh[: len(desk.path) - 1], abs=0.3)


def test_plan_with_astar_matches_navfn():
    desk = Desk(two_doors(), (7.0, 1.5), use_astar=True)
    desk.cost(slice(40, 75), slice(30, 60), 254)
    assert desk.plan(1.0, 3.0) == 0
    fresh = desk.fresh((1.0, 3.0), (7.0, 1.5), use_astar=True)
    np.testing.assert_allclose(desk.path[: len(fresh) - 1], fresh[:-1], atol=1e-6)
    assert len(fresh) != len(desk.fresh((1.0, 3.0), (7.0, 1.5)))


def test_closed_door_is_left_and_reused_when_open():
    desk = Desk(two_doors(), (7.0, 1.5))
    ways = []
    for closed in (False, True, False):
        desk.cost(*LOWER, 254 if closed else 0)
        assert desk.plan(1.0, 3.0) == 0
        ways.append(at_the_wall(desk.path))
        fresh = desk.fresh((1.0, 3.0), (7.0, 1.5))
        assert desk.path[:-1] == pytest.approx(fresh[: len(desk.path) - 1], abs=0.3)
    assert [1.0 < ways[0] < 2.0, 4.0 < ways[1] < 5.0, 1.0 < ways[2] < 2.0] == [True] * 3


def test_next_mission_plans_on_costs_that_changed_during_the_one_before():
    desk = Desk(two_doors(), (7.0, 1.5))
    assert desk.plan(1.0, 3.0) == 0
    desk.grids.costs[LOWER] = 254  # and what the mission before knows of it is gone with its memory
    desk.take(give(desk.stack, Mission("navigate_to_pose", (Pose(7.0, 1.5, 0.0),))))
    assert desk.plan(1.0, 3.0) == 0
    assert 4.0 < at_the_wall(desk.path) < 5.0


def test_missions_share_costs_of_map_but_not_their_own_changes():
    one = Desk(two_doors(), (7.0, 1.5)).stack
    other = give(one, Mission("navigate_to_pose", (Pose(7.0, 4.5, 0.0),)))
    assert one.planner.memory.least is other.planner.memory.least
    assert not np.shares_memory(one.planner.memory.travel, other.planner.memory.travel)


def test_path_much_longer_than_that_of_map_is_found():
    cells = two_doors()
    desk = Desk(cells, (7.0, 1.5))
    desk.cost(slice(2, 112), slice(40, 42), 254)
    desk.cost(slice(8, 118), slice(60, 62), 254)
    assert desk.plan(1.0, 1.5) == 0
    assert len(desk.path) > 2 * len(Desk(cells, (7.0, 1.5)).fresh((1.0, 1.5), (7.0, 1.5)))


def test_path_crosses_unknown_ground_once_seen_free():
    cells = two_doors()
    cells[20:40, 70:92] = -1
    desk = Desk(cells, (7.0, 1.5))
    desk.plan(1.0, 3.0)
    assert 4.0 < at_the_wall(desk.path) < 5.0
    desk.cost(slice(25, 35), slice(70, 92), 0)
    desk.plan(1.0, 3.0)
    assert 1.0 < at_the_wall(desk.path) < 2.0


def test_moved_goal_keeps_offset_within_cell():
    """NavFn looks for another in steps of a cell from the goal, and not at the cells' own points."""
    desk = Desk(two_doors(), (7.013, 1.489))
    desk.cost(slice(25, 36), slice(136, 145), 254)
    assert desk.plan(1.0, 3.0) == 0
    moved = (np.array([desk.m["goal_x"], desk.m["goal_y"]]) - (7.013, 1.489)) / RESOLUTION_M
    assert np.abs(moved).max() > 3.0
    np.testing.assert_allclose(moved, np.rint(moved), atol=1e-9)
    assert desk.path[-1] * RESOLUTION_M == pytest.approx((desk.m["goal_x"], desk.m["goal_y"]))


def test_goal_is_not_moved_to_walled_in_free_cell():
    desk = Desk(two_doors(), (7.0, 1.5))
    desk.cost(slice(26, 35), slice(136, 145), 254)
    desk.cost(slice(29, 32), slice(139, 142), 0)
    assert desk.plan(1.0, 3.0) == 0
    row, column = np.rint(desk.path[-1][::-1]).astype(int)
    assert desk.memory.travel[row, column] < 254
    assert 4 < np.hypot(column - 140, row - 30) <= 6


def test_path_is_kept_when_goal_is_unreachable():
    desk = Desk(two_doors(), (7.0, 1.5))
    desk.plan(1.0, 3.0)
    before = desk.path.copy()
    desk.cost(*LOWER, 254)
    desk.cost(*UPPER, 254)
    assert desk.plan(2.0, 2.0) == NO_VALID_PATH
    np.testing.assert_array_equal(desk.path, before)


def test_path_through_goals_matches_navfn_leg_by_leg():
    goals = (7.0, 1.5), (7.0, 5.0), (1.0, 5.0)
    desk = Desk(two_doors(), *goals, kind="navigate_through_poses")
    for _ in range(2):  # the second time with lower bounds at hand
        assert desk.plan(1.0, 3.0) == 0
        legs = [desk.fresh(a, b) for a, b in zip([(1.0, 3.0), *goals], goals, strict=False)]
        # Where NavFn leaves the goal's own cell out, it puts the goal behind its last point.
        assert len(desk.path) == pytest.approx(sum(map(len, legs)), abs=4)
        for leg in legs:
            assert np.hypot(*(desk.path[:, None] - leg[None, ::10]).T).min(axis=1).max() < 1.0


def test_passed_goal_is_removed_from_plan():
    goals = (1.5, 3.0), (7.0, 1.5)
    desk = Desk(two_doors(), *goals, kind="navigate_through_poses")
    assert desk.plan(1.0, 3.0) == 0
    assert desk.m["goal"] == 1
    assert len(desk.path) == pytest.approx(len(desk.fresh((1.0, 3.0), goals[1])), abs=2)


def test_robot_is_planned_for_where_the_map_has_no_room():
    desk = Desk(two_doors(), (7.0, 1.5))
    place = 1.0, 0.2  # inscribed by the wall, beside a cell that is not
    assert desk.memory.travel[4, 20] == 254
    desk.cost(slice(4, 8), slice(18, 23), 200)
    assert desk.plan(*place) == 0
    assert desk.path[:-1] == pytest.approx(desk.fresh(place, (7.0, 1.5))[: len(desk.path) - 1])
