"""The Smac planners: their curves, their paths beside exhaustive searches, within their turning radius, and driven."""

import heapq
import itertools
import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.sparse import coo_array
from scipy.sparse.csgraph import dijkstra
from table import each_row

from vastflow.sim.kernels.numeric import njit
from vastflow.sim.kernels.record import record_of
from vastflow.sim.nav2.costmaps.inflation import inflate
from vastflow.sim.nav2.costmaps.outline import inscribed_radius_m, outline_of
from vastflow.sim.nav2.navigator.kernels import with_kernels
from vastflow.sim.nav2.parameter_files.chosen import parameters_of
from vastflow.sim.nav2.parameters.costmap import global_costmap
from vastflow.sim.nav2.parameters.servers import SmacPlanner2D, SmacPlannerHybrid, SmootherParameters
from vastflow.sim.nav2.planners import smac_2d, smac_hybrid
from vastflow.sim.nav2.planners.binding import compute_path, running
from vastflow.sim.nav2.planners.curves import pose_on, shortest
from vastflow.sim.nav2.planners.planner import PlannerInput, PlannerSetting
from vastflow.sim.nav2.planners.search import search_of
from vastflow.sim.nav2.planners.smac_hybrid import price, primitives_of
from vastflow.sim.nav2.planners.smoother import keep_ends

RESOLUTION_M = 0.05
UNSMOOTHED = SmootherParameters(max_iterations=0)
RECTANGLE = "[[0.55, 0.2], [0.55, -0.2], [-0.55, -0.2], [-0.55, 0.2]]"


def costs_of(lethal, costmap=None):
    """An inflated costmap of flags (H, W)."""
    q = costmap or global_costmap()
    layer = q.inflation_layer
    radius = inscribed_radius_m(outline_of(q))
    cells = np.where(lethal, 254, 0).astype(np.uint8)
    return inflate(cells, RESOLUTION_M, radius, layer.inflation_radius, layer.cost_scaling_factor)


def rooms(rows=80, columns=120, door=slice(30, 44)):
    """Two rooms and a door between them."""
    lethal = np.zeros((rows, columns), dtype=bool)
    lethal[[0, -1]], lethal[:, [0, -1]] = True, True
    lethal[:, columns // 2 : columns // 2 + 2] = True
    lethal[door, columns // 2 : columns // 2 + 2] = False
    return lethal


def situation(costs, start, goal, costmap=None, room=4096):
    """Return a planner's input; poses (x, y, yaw) in meters from the map's corner."""
    place = np.array([0.0, 0.0, RESOLUTION_M])
    outline = outline_of(costmap or global_costmap())
    return PlannerInput(costs, place, outline, tuple(map(float, start)), tuple(map(float, goal)), np.zeros((room, 3)))


def record(parameters):
    return record_of(search_of(parameters, global_costmap(), RESOLUTION_M, (0.0, 0.0)))


def prepared(parameters, costmap=None):
    nothing = np.zeros((1, 1), dtype=np.uint8)
    setting = PlannerSetting(nothing, nothing, costmap or global_costmap(), RESOLUTION_M, (0.0, 0.0))
    return running(with_kernels(parameters), setting)


@njit
def planned(planner, given):
    return compute_path(planner, given)


@njit
def searched(q, distances, given):
    return smac_hybrid.search(q[0], distances, given)


@njit
def searched_2d(q, costs, start, goal):
    return smac_2d.search(q[0], costs, start, goal)


@njit
def primitives(q):
    return primitives_of(q[0])


@njit
def price_of(q, primitive, cost, last):
    return price(q[0], primitive, cost, last)


@njit
def ends_kept(q, costs, points, headings):
    keep_ends(q[0], costs, points, headings)


def path_of(parameters, given, costmap=None):
    """(N, 2) path in meters, or the error code."""
    n = planned(prepared(parameters, costmap).bound, given)
    return given.path[:n, :2].copy() if n > 0 else -n


def raw_path(parameters, given, costmap=None):
    """(N, 3) poses of Hybrid-A* in meters and radians, and the iterations."""
    planner = prepared(parameters, costmap)
    poses, iterations, code = searched(planner.memory.search, planner.memory.distances, given)
    assert code == 0
    return poses * [RESOLUTION_M, RESOLUTION_M, 1.0], iterations


def least_cost(costs, start, goal, penalty):
    """The least cost from a cell to another over eight neighbors, exhaustively."""
    rows, columns = costs.shape
    numbers = np.pad(np.arange(costs.size).reshape(costs.shape), 1, constant_values=-1)
    prices = (1.0 + penalty * costs / 252.0).ravel()
    moves = []
    for dy, dx in itertools.product((-1, 0, 1), repeat=2):
        to = numbers[1 + dy : 1 + dy + rows, 1 + dx : 1 + dx + columns].ravel()
        is_move = (to >= 0) & ((dy, dx) != (0, 0)) & ~np.isin(costs.ravel()[to], (253, 254))
        moves.append([math.hypot(dx, dy) * prices[to[is_move]], np.flatnonzero(is_move), to[is_move]])
    values, *ends = (np.concatenate(each) for each in zip(*moves, strict=True))
    return dijkstra(coo_array((values, ends), shape=(costs.size, costs.size)), indices=start)[goal]


def cost_2d(costs, cells, penalty):
    steps = np.hypot(*np.diff(cells, axis=0).T)
    return float((steps * (1.0 + penalty * costs[cells[1:, 0], cells[1:, 1]] / 252.0)).sum())


@settings(max_examples=25, deadline=None)
@given(st.integers(0, 10_000), st.sampled_from([0.0, 1.0, 2.0]))
def test_path_over_cells_has_minimum_cost(seed, penalty):
    draw = np.random.default_rng(seed)
    lethal = draw.random((50, 60)) < 0.01
    costs = costs_of(lethal)
    free = np.argwhere(costs < 200)
    start, goal = (row * 60 + column for row, column in free[draw.integers(len(free), size=2)].tolist())
    least = least_cost(costs, start, goal, penalty)
    search = record(SmacPlanner2D(cost_travel_multiplier=penalty))
    last, parents, code = searched_2d(search, costs, start, goal)
    if not math.isfinite(least):
        return
    assert code == 0
    cells = [last]
    while cells[-1] != start:
        cells.append(parents[cells[-1]])
    path = np.array([divmod(int(cell), 60) for cell in cells[::-1]])
    assert cost_2d(costs, path, penalty) == pytest.approx(least, rel=1e-4)


@pytest.mark.slow
def test_goal_in_an_obstacle_is_replaced_by_a_cell_within_the_tolerance():
    lethal = rooms()
    lethal[40, 90] = True
    given = situation(costs_of(lethal), (1.0, 2.0, 0.0), (90.5 * 0.05, 40.5 * 0.05, 0.0))
    path = path_of(SmacPlanner2D(tolerance=0.5), given)
    assert 0.2 < math.hypot(*(path[-1] - [4.525, 2.025])) < 0.5
    assert path_of(SmacPlanner2D(tolerance=0.1), given) == 208


def test_closed_door_and_blocked_start_have_no_path():
    closed = costs_of(rooms(door=slice(0, 0)))
    assert path_of(SmacPlanner2D(), situation(closed, (1.0, 2.0, 0.0), (5.0, 2.0, 0.0))) == 208
    walled = rooms()
    walled[30:50, 10:30] = True
    assert path_of(SmacPlanner2D(), situation(costs_of(walled), (1.0, 2.0, 0.0), (5.0, 2.0, 0.0))) == 205
    few = SmacPlanner2D(max_iterations=50)
    assert path_of(few, situation(costs_of(rooms()), (1.0, 2.0, 0.0), (5.0, 2.0, 0.0))) == 207


def test_path_crosses_unknown_cells_only_when_allowed():
    costs = costs_of(rooms())
    costs[30:44, 55:66] = 255
    given = situation(costs, (1.0, 2.0, 0.0), (5.0, 2.0, 0.0))
    assert len(path_of(SmacPlanner2D(), given)) > 20
    assert path_of(SmacPlanner2D(allow_unknown=False), given) == 208


def test_smoother_keeps_the_ends_and_takes_the_corners_away():
    given = situation(costs_of(rooms()), (1.0, 0.8, 0.0), (5.0, 3.2, 0.0))
    rough = path_of(SmacPlanner2D(smoother=UNSMOOTHED), given)
    smooth = path_of(SmacPlanner2D(), given)
    assert rough.shape == smooth.shape
    assert np.array_equal(rough[[0, -1]], smooth[[0, -1]])
    turns = [np.abs(np.diff(np.unwrap(np.arctan2(*np.diff(path, axis=0).T)))).max() for path in (rough, smooth)]
    assert turns[0] > 0.7 and turns[1] < 0.2
    assert np.hypot(*(rough - smooth).T).max() < 0.3


def curvature(poses):
    """Return the curvature (1/m) of the arc between successive poses, whatever its direction."""
    turned = np.abs(np.remainder(np.diff(poses[:, 2]) + math.pi, 2.0 * math.pi) - math.pi)
    chord = np.hypot(*np.diff(poses[:, :2], axis=0).T)
    # The chord of an arc of this angle and radius r is 2 r sin(angle / 2).
    return 2.0 * np.sin(0.5 * turned) / np.maximum(chord, 1e-12)


@pytest.mark.slow
@settings(max_examples=40, deadline=None)
@given(
    st.integers(0, 10_000),
    st.sampled_from(["DUBIN", "REEDS_SHEPP"]),
    st.floats(0.1, 1.0),
    st.sampled_from([16, 64, 72]),
    st.booleans(),
)
def test_searched_paths_turn_no_tighter_than_the_robot_can(seed, model, radius_m, bins, interpolates):
    draw = np.random.default_rng(seed)
    costs = costs_of(draw.random((100, 100)) < 0.002)
    free = np.argwhere(costs < 150)
    cells = free[draw.integers(len(free), size=2)]
    poses = [(column * 0.05 + 0.02, row * 0.05 + 0.02, draw.uniform(-3, 3)) for row, column in cells]
    planner = SmacPlannerHybrid(
        motion_model_for_search=model,
        minimum_turning_radius=radius_m,
        angle_quantization_bins=bins,
        allow_primitive_interpolation=interpolates,
        # Between two poses of a Reeds-Shepp curve may lie a cusp; those curves are tested by themselves.
        analytic_expansion_max_length=3.0 if model == "DUBIN" else 0.0,
        max_iterations=20_000,
    )
    found = prepared(planner)
    path, _, code = searched(found.memory.search, found.memory.distances, situation(costs, *poses))
    if code != 0:
        return
    assert curvature(path * [RESOLUTION_M, RESOLUTION_M, 1.0]).max(initial=0.0) <= 1.0 / radius_m * (1.0 + 1e-6)


def headed(poses):
    """Whether each step leads forward."""
    steps = np.diff(poses[:, :2], axis=0)
    middle = poses[:-1, 2] + 0.5 * (np.remainder(np.diff(poses[:, 2]) + math.pi, 2.0 * math.pi) - math.pi)
    return steps[:, 0] * np.cos(middle) + steps[:, 1] * np.sin(middle) > 0.0


def test_dubins_path_never_reverses_and_a_reeds_shepp_path_does():
    costs = costs_of(rooms(rows=44, columns=200, door=slice(0, 44)))
    start, goal = (6.0, 1.1, 0.0), (3.0, 1.1, 0.0)
    values = {"minimum_turning_radius": 0.5, "analytic_expansion_max_length": 10.0}
    either = SmacPlannerHybrid(motion_model_for_search="REEDS_SHEPP", **values)
    assert not headed(raw_path(either, situation(costs, start, goal))[0]).all()
    open_costs = costs_of(rooms(rows=200, columns=200, door=slice(0, 200)))
    start, goal = (6.0, 5.0, 0.0), (3.0, 5.0, 0.0)
    forward, _ = raw_path(SmacPlannerHybrid(**values), situation(open_costs, start, goal))
    assert headed(forward).all()
    assert forward[[0, -1]] == pytest.approx(np.array([start, goal]))


@each_row("model", ["DUBIN", "REEDS_SHEPP"])
@each_row(("start", "goal"), [((1.0, 1.0, 0.0), (5.0, 4.0, -1.5)), ((5.0, 2.0, 3.0), (1.0, 4.0, 3.0))])
def test_smoothed_path_keeps_the_headings_of_start_and_goal(model, start, goal):
    """Headings stay within an arc of the least radius and half a bin; the smoother alone keeps neither."""
    values = {"motion_model_for_search": model, "minimum_turning_radius": 0.8, "analytic_expansion_max_length": 0.0}
    rough = SmacPlannerHybrid(**values, smooth_path=False)
    given = situation(costs_of(rooms(rows=110, columns=120, door=slice(0, 110))), start, goal)
    searched_path, path = path_of(rough, given), path_of(SmacPlannerHybrid(**values), given)
    assert path.shape == searched_path.shape
    assert path[[0, -1]] == pytest.approx(searched_path[[0, -1]])
    assert np.hypot(*(path - searched_path).T).max() > 0.02
    steps = np.diff(path, axis=0)
    for step, searched_step in zip(steps[[0, -1]], np.diff(searched_path, axis=0)[[0, -1]], strict=True):
        turned = math.remainder(math.atan2(*step[::-1]) - math.atan2(*searched_step[::-1]), 2.0 * math.pi)
        assert abs(turned) <= np.hypot(*step) / 0.8 + math.pi / 72


@each_row("reversing", [False, True])
def test_curves_at_the_ends_keep_both_headings_forward_and_in_reverse(reversing):
    radius_m, flip = 0.5, math.pi if reversing else 0.0
    kept, points = kept_ends(5.0, 0.4 + flip, -0.3 + flip, flip)
    assert kept[[0, -1]] == pytest.approx(points[[0, -1]])
    along = np.arctan2(*np.diff(kept, axis=0).T[::-1])
    turned = np.abs(np.diff(along)) / 0.08
    assert along[[0, -1]] == pytest.approx([0.4, -0.3], abs=0.5 * 0.09 / radius_m)
    assert turned.max() < 1.2 / radius_m
    assert np.array_equal(kept[20:31], points[20:31])


def kept_ends(to_x_m, first, last, between=0.0, costs=None):
    """A straight path with other headings at its ends, kept by a radius of 0.5 m, and as it was."""
    points, headings = np.column_stack([np.linspace(1.0, to_x_m, 51), np.full(51, 2.0)]), np.full(51, between)
    kept, headings[0], headings[-1] = points.copy(), first, last
    costs = np.zeros((80, 120), dtype=np.uint8) if costs is None else costs
    ends_kept(record(SmacPlannerHybrid(minimum_turning_radius=0.5)), costs, kept, headings)
    return kept, points


def test_curves_are_laid_through_no_obstacle_and_in_no_loop():
    walled = np.zeros((80, 120), dtype=np.uint8)
    walled[41:], walled[:39] = 254, 254
    for kept, points in (kept_ends(5.0, 0.9, 0.0, costs=walled), kept_ends(1.9, math.pi, 0.0)):
        assert kept == pytest.approx(points, abs=1e-9)


def lattice_dijkstra(q, costs, start, goal_cell):
    """Search the least price from a pose to a cell with any heading, exhaustively over the same primitives."""
    moves = primitives(q)
    bins = int(q["bins"][0])
    x, y, turn = start
    known, settled, waiting = {}, set(), [(0.0, 0, x, y, turn, 0.0)]
    count = 0
    while waiting:
        value, _, x, y, turn, last = heapq.heappop(waiting)
        key = int(x), int(y), turn
        if key in settled:
            continue
        settled.add(key)
        if key[:2] == goal_cell:
            return value
        angle = 2.0 * math.pi * turn / bins
        c, s = math.cos(angle), math.sin(angle)
        for move in moves:
            to_x, to_y = x + c * move[0] - s * move[1], y + s * move[0] + c * move[1]
            to_turn = int(turn + move[2]) % bins
            to = int(to_x), int(to_y), to_turn
            if not (0 <= to_x < costs.shape[1] and 0 <= to_y < costs.shape[0]) or to in settled:
                continue
            cost = costs[to[1], to[0]]
            if cost >= 253:
                continue
            sum_ = value + price_of(q, move, float(cost), last)
            if sum_ < known.get(to, math.inf):
                known[to] = sum_
                count += 1
                heapq.heappush(waiting, (sum_, count, to_x, to_y, to_turn, move[3]))
    return math.inf


@each_row("model", ["DUBIN", "REEDS_SHEPP"])
def test_path_on_the_lattice_costs_within_two_percent_of_an_exhaustive_search(model):
    lethal = rooms(rows=60, columns=80, door=slice(22, 40))
    costs = costs_of(lethal)
    parameters = SmacPlannerHybrid(
        motion_model_for_search=model, angle_quantization_bins=16, analytic_expansion_max_length=0.0
    )
    q = record(parameters)
    distances = prepared(parameters).memory.distances
    ratios = []
    for start, goal in (((0.8, 0.8, 0.0), (3.2, 2.2)), ((0.8, 2.2, 0.0), (3.2, 0.8)), ((0.6, 1.5, 1.2), (3.4, 1.5))):
        turn = round(start[2] * 16 / (2.0 * math.pi)) % 16
        goal_cell = int(goal[0] / 0.05), int(goal[1] / 0.05)
        least = lattice_dijkstra(q, costs, (start[0] / 0.05, start[1] / 0.05, turn), goal_cell)
        best = math.inf
        for heading in np.arange(16) * 2.0 * math.pi / 16:
            poses, _, code = searched(q, distances, situation(costs, start, (*goal, heading)))
            if code == 0 and tuple(poses[-1, :2].astype(int)) == goal_cell:
                best = min(best, lattice_price(q, poses, costs))
        ratios.append(best / least)
    assert max(ratios) <= 1.02


def lattice_price(q, poses, costs):
    """The price of a path of primitives, pose after pose."""
    moves, total, last = primitives(q), 0.0, 0.0
    for here, there in itertools.pairwise(poses):
        c, s = math.cos(here[2]), math.sin(here[2])
        dx, dy = there[0] - here[0], there[1] - here[1]
        apart = np.hypot(moves[:, 0] - (c * dx + s * dy), moves[:, 1] - (c * dy - s * dx))
        move = moves[int(apart.argmin())]
        assert apart.min() < 1e-6
        total += price_of(q, move, float(costs[int(there[1]), int(there[0])]), last)
        last = move[3]
    return total


def test_long_robot_passes_door_only_lengthwise():
    costmap = global_costmap().with_values(footprint=RECTANGLE)
    wide, narrow = (costs_of(rooms(door=slice(40 - n, 40 + n)), costmap) for n in (7, 3))
    q = SmacPlannerHybrid(minimum_turning_radius=0.5)
    start, goal = (1.0, 2.0, 0.0), (5.0, 2.0, 0.0)
    path, _ = raw_path(q, situation(wide, start, goal, costmap), costmap)
    assert np.abs(np.sin(path[np.abs(path[:, 0] - 3.05) < 0.3, 2])).max() < 0.35
    assert path_of(q, situation(narrow, start, goal, costmap), costmap) == 208


def test_enforced_path_inversion_reverses_only_to_cusp(over_a_floor):
    """The path of a steering robot reverses in an arc of a quarter turn and then leads forward."""
    backward_m = {}
    for enforced in (True, False):
        stack = parameters_of(
            {
                "FollowPath.motion_model": "Ackermann",
                "FollowPath.AckermannConstraints.min_turning_r": 0.6,
                "FollowPath.enforce_path_inversion": enforced,
            }
        )
        planner = SmacPlannerHybrid(
            minimum_turning_radius=0.7, motion_model_for_search="REEDS_SHEPP", reverse_penalty=1.2
        )
        found = over_a_floor(stack.with_values(planner=planner), yaw_rad=math.pi)
        assert found.run.outcome == "succeeded"
        backward_m[enforced] = np.maximum(-found.columns["speed_mmps"], 0).sum() * 1e-4  # rows are 0.1 s apart
    assert 0.5 < backward_m[True] < 4.0 and backward_m[False] > 8.0


LENGTHS = st.floats(-8.0, 8.0)
ANGLES = st.floats(-math.pi, math.pi)


@settings(max_examples=200, deadline=None)
@given(LENGTHS, LENGTHS, ANGLES)
def test_curve_is_no_shorter_than_a_line_and_no_longer_by_reversing(x, y, heading):
    forward, either = shortest(x, y, heading, False)[0], shortest(x, y, heading, True)[0]
    assert math.hypot(x, y) - 1e-9 <= either <= forward + 1e-9


@settings(max_examples=200, deadline=None)
@given(LENGTHS, LENGTHS, ANGLES, st.booleans())
def test_curve_ends_at_its_pose_and_is_nowhere_tighter_than_the_radius(x, y, heading, reverses):
    curve, step = shortest(x, y, heading, reverses), 0.01
    poses = np.array([pose_on(curve, along)[:3] for along in [*np.arange(0.0, curve[0], step), curve[0]]])
    assert poses[-1, :2] == pytest.approx([x, y], abs=1e-6)
    assert math.remainder(poses[-1, 2] - heading, 2.0 * math.pi) == pytest.approx(0.0, abs=1e-6)
    turned = np.abs(np.remainder(np.diff(poses[:, 2]) + math.pi, 2.0 * math.pi) - math.pi)
    assert (turned <= step + 1e-9).all()
    assert (np.hypot(*np.diff(poses[:, :2], axis=0).T) <= step + 1e-9).all()


@each_row(
    ("pose", "dubins", "reeds_shepp"),
    [
        ((5.0, 0.0, 0.0), 5.0, 5.0),
        ((1.0, 1.0, math.pi / 2), math.pi / 2, math.pi / 2),
        ((0.0, 2.0, math.pi), math.pi, math.pi),
        ((0.0, 0.0, math.pi), 7.0 * math.pi / 3.0, math.pi),
    ],
)
def test_lengths_that_geometry_gives(pose, dubins, reeds_shepp):
    assert shortest(*pose, True)[0] == pytest.approx(reeds_shepp)
    assert shortest(*pose, False)[0] == pytest.approx(dubins)
