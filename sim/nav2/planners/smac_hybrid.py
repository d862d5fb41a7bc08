"""SmacPlannerHybrid: Hybrid-A* over cells and headings, along arcs that a robot with a least turning radius can drive."""

import heapq
import math
from typing import Any, Final, NamedTuple

import numpy as np

from vastflow.sim.kernels.numeric import addressed, inner, njit
from vastflow.sim.nav2.parameters.servers import SmacPlannerHybrid
from vastflow.sim.nav2.planners.curves import pose_on, shortest
from vastflow.sim.nav2.planners.planner import (
    NO_VALID_PATH,
    START_OCCUPIED,
    TIMEOUT,
    Planner,
    PlannerInput,
    PlannerSetting,
)
from vastflow.sim.nav2.planners.search import (
    WHOLE,
    Ground,
    SearchMemory,
    along_curve,
    center_cost,
    cost_share,
    has_room,
    new_ground,
    over_ground,
    search_memory,
)
from vastflow.sim.nav2.planners.smoother import smooth

KEY, X, Y, HEADING, VALUE, PARENT, TURN, COST, STATE = range(9)
"""Columns of a node: its cell and bin in one number; its pose in cells and bins; the best cost to it and whence; how it was
turned on the way; the costmap's cost at it; what is known of it."""

NEW, BLOCKED, OPEN, CLOSED = 0.0, 1.0, 2.0, 3.0

_FIRST: Final = 1 << 14
_SPREAD: Final = 0x9E3779B97F4A7C15 >> 1


class Nodes(NamedTuple):
    """Nodes in the order they were met."""

    rows: Any  # (N, 9) float64, of which the first `count[0]` are used.
    slots: Any  # (2 N,) int64, the row of a key and one more, 0 where there is none.
    count: Any  # (1,) int64.


@inner
def roomy(nodes: Nodes, more: int) -> Nodes:
    """The same nodes, with room for some more."""
    count = nodes.count[0]
    if count + more <= nodes.rows.shape[0]:
        return nodes
    rows = np.zeros((2 * nodes.rows.shape[0], 9))
    rows[:count] = nodes.rows[:count]
    slots = np.zeros(2 * rows.shape[0], dtype=np.int64)
    for k in range(count):
        slots[_slot(rows, slots, int(rows[k, KEY]))] = k + 1
    return Nodes(rows, slots, nodes.count)


@inner
def node_of(nodes: Nodes, key: int) -> int:
    """Return the row of a key, inserting it if it is new; the table must not be full."""
    slot = _slot(nodes.rows, nodes.slots, key)
    if nodes.slots[slot] == 0:
        nodes.rows[nodes.count[0], KEY] = key
        nodes.count[0] += 1
        nodes.slots[slot] = nodes.count[0]
    return int(nodes.slots[slot] - 1)


@inner
def _slot(rows: Any, slots: Any, key: int) -> int:
    last = slots.shape[0] - 1
    slot = ((key * _SPREAD) >> 20) & last
    while slots[slot] != 0 and rows[slots[slot] - 1, KEY] != key:
        slot = (slot + 1) & last
    return int(slot)


FORWARD, LEFT, RIGHT, REVERSE, REVERSE_LEFT, REVERSE_RIGHT = 1.0, 2.0, 3.0, 4.0, 5.0, 6.0
"""Turns; the start's is `NO_TURN`."""

NO_TURN: Final = 0.0

AHEAD, ASIDE, BINS, KIND, LENGTH = range(5)
"""Columns of a primitive: where it leads in cells, by how many bins it turns, its turn and its length."""


@inner
def primitives_of(q: Any) -> Any:
    """Return the motion primitives (P, 5).

    Straight on, left and right at the least radius, arcs between them with `q.allow_primitive_interpolation`, and all in reverse.

    The turn's angle is a multiple of a bin, and its chord at least √2 cells, which leaves any cell.
    """
    bin_rad = 2.0 * math.pi / q.bins
    bins = max(math.ceil(2.0 * math.asin(math.sqrt(2.0) / (2.0 * q.radius)) / bin_rad - 1e-9), 1)
    chord = 2.0 * q.radius * math.sin(0.5 * bins * bin_rad)
    between = bins - 1 if q.allow_primitive_interpolation != 0 else 0
    found = np.zeros(((3 + 2 * between) * (2 if q.reverses != 0 else 1), 5))
    n = 0
    for backward in range(2 if q.reverses != 0 else 1):
        sign = -1.0 if backward == 1 else 1.0
        found[n, AHEAD], found[n, KIND], found[n, LENGTH] = sign * chord, REVERSE if backward == 1 else FORWARD, chord
        n += 1
        for k in range(between + 1):
            turned = bins if k == 0 else k
            angle = turned * bin_rad
            radius = chord / (2.0 * math.sin(0.5 * angle))
            for side in range(2):
                bend = -1.0 if side == 1 else 1.0
                row = found[n]
                row[AHEAD], row[ASIDE] = sign * radius * math.sin(angle), bend * radius * (1.0 - math.cos(angle))
                row[BINS], row[LENGTH] = sign * bend * turned, radius * angle
                row[KIND] = (REVERSE_LEFT if backward == 1 else LEFT) + side
                n += 1
    return found


@inner
def price(q: Any, primitive: Any, cost: float, last_turn: float) -> float:
    """Price of a primitive: its length, raised for cost, turning, changes of turn, and reversing."""
    value = primitive[LENGTH] * ((1.0 - q.retrospective_penalty) + q.cost_penalty * cost_share(q, cost))
    kind = primitive[KIND]
    if kind != FORWARD and kind != REVERSE and last_turn != NO_TURN:
        value *= q.non_straight_penalty + (0.0 if kind == last_turn else q.change_penalty)
    return float(value * q.reverse_penalty if kind >= REVERSE else value)


_REFINEMENTS = 8
_STEP_NODES = 5
_WIDEST = 4.0


@inner
def expanded(q: Any, given: Any, nodes: Nodes, node: int, goal: Any) -> Any:
    """Return (found, node, poses): the best curve to the goal, perhaps from a node before the given one.

    Poses are (P, 3) x, y in cells and heading in radians, without the node's own, the goal's last; the goal has its bin.
    """
    found, poses, score = _curve_to(q, given, nodes, node, goal, q.radius)
    if not found:
        return False, node, poses
    test = node
    for _ in range(_REFINEMENTS):
        for _ in range(_STEP_NODES):
            test = int(nodes.rows[test, PARENT]) if test >= 0 else test
        if test < 0:
            break
        better, other, other_score = _curve_to(q, given, nodes, test, goal, q.radius)
        if not better:
            break
        node, poses, score = test, other, other_score
    radius = q.radius
    while radius < _WIDEST * q.radius:
        radius += 0.5
        wider, other, other_score = _curve_to(q, given, nodes, node, goal, radius)
        if wider and other_score <= score:
            poses, score = other, other_score
    return True, node, poses


@inner
def _curve_to(q: Any, given: Any, nodes: Nodes, node: int, goal: Any, radius: float) -> Any:
    """Return (found, poses, score): a curve of one radius and its search cost without turn penalties."""
    x, y, heading = nodes.rows[node, X], nodes.rows[node, Y], 2.0 * math.pi * nodes.rows[node, HEADING] / q.bins
    dx, dy = (goal[0] - x) / radius, (goal[1] - y) / radius
    c, s = math.cos(heading), math.sin(heading)
    curve = shortest(c * dx + s * dy, c * dy - s * dx, 2.0 * math.pi * goal[2] / q.bins - heading, q.reverses != 0)
    length = radius * curve[0]
    count = int(length / math.sqrt(2.0))
    poses = np.empty((max(count, 1), 3))
    poses[-1, 0], poses[-1, 1], poses[-1, 2] = goal[0], goal[1], 2.0 * math.pi * goal[2] / q.bins
    if length > q.analytic_expansion_max_length:
        return False, poses, math.inf
    score, step, leaves = 0.0, length / max(count, 1), 0
    for k in range(1, count):
        along_x, along_y, turned, _ = pose_on(curve, k * step / radius)
        pose = poses[k - 1]
        pose[0] = x + radius * (c * along_x - s * along_y)
        pose[1] = y + radius * (s * along_x + c * along_y)
        pose[2] = heading + turned
        if not has_room(q, given, pose[0], pose[1], pose[2]):
            return False, poses, math.inf
        cost = center_cost(given.costs, pose[0], pose[1])
        # Costly ground may only be entered for good: from its last segment on, a curve that has left it must not come back.
        if cost <= q.analytic_expansion_max_cost:
            leaves = 2 if leaves == 1 else leaves
        elif leaves == 0:
            leaves = 1
        score += step * (1.0 + q.cost_penalty * cost / WHOLE)
    if leaves == 2 and not (q.analytic_expansion_max_cost_override != 0 and length < 2.0 * math.pi * radius):
        return False, poses, math.inf
    return True, poses, score


@addressed
def compute_path(parameters: Any, memory: SearchMemory, given: PlannerInput) -> int:
    """Plan into `given.path`; return the number of poses, or minus an error code."""
    q = memory.search[0]
    poses, iterations, code = search(q, memory.distances, given)
    n = poses.shape[0]
    if code == 0 and n > given.path.shape[0]:
        code = NO_VALID_PATH
    if code != 0:
        return int(-code)
    for k in range(n):
        given.path[k, 0] = q.origin_x + poses[k, 0] * q.resolution
        given.path[k, 1] = q.origin_y + poses[k, 1] * q.resolution
        given.path[k, 2] = poses[k, 2]
    if q.smooths != 0 and iterations > 1:
        smooth(q, given.costs, given.path[:n], given.path[:n, 2])
    return int(n)


@njit
def search(q: Any, distances: Any, given: PlannerInput) -> Any:
    """(poses, iterations, error code): the path as it is searched, not smoothed, from the start's cell and bin on.

    Poses are (N, 3) x, y in cells and heading in radians. For `q` see `search_of`, for `distances` `SearchMemory`.
    """
    start, goal = _placed(q, given.start), _placed(q, given.goal)
    alone = np.empty((1, 3))
    alone[0] = start[0], start[1], 2.0 * math.pi * start[2] / q.bins
    if _key(q, given, start) == _key(q, given, goal):
        return alone, 0, 0
    nodes, node, curve, iterations, code = _searched(q, distances, given, start, goal)
    return (alone if code != 0 else _path(q, nodes, node, curve)), iterations, code


@inner
def _placed(q: Any, pose: Any) -> Any:
    """(3,) a pose in cells and in the nearest bin."""
    found = np.empty(3)
    found[0], found[1] = (pose[0] - q.origin_x) / q.resolution, (pose[1] - q.origin_y) / q.resolution
    found[2] = round(pose[2] * q.bins / (2.0 * math.pi)) % q.bins
    return found


@inner
def _key(q: Any, given: PlannerInput, pose: Any) -> int:
    return int((int(pose[1]) * given.costs.shape[1] + int(pose[0])) * q.bins + int(pose[2]))


@inner
def _searched(q: Any, distances: Any, given: PlannerInput, start: Any, goal: Any) -> Any:
    """(nodes, last node, poses of the curve from there to the goal, iterations, error code)."""
    primitives = primitives_of(q)
    nodes = Nodes(np.zeros((_FIRST, 9)), np.zeros(2 * _FIRST, dtype=np.int64), np.zeros(1, dtype=np.int64))
    ground, ahead = new_ground(q, given.costs, goal)
    first, goal_key = node_of(nodes, _key(q, given, start)), _key(q, given, goal)
    nodes.rows[first, X : HEADING + 1] = start
    nodes.rows[first, PARENT], nodes.rows[first, TURN], nodes.rows[first, STATE] = -1.0, NO_TURN, OPEN
    waiting = [(0.0, first)]
    nearest = [(math.inf, 0)]
    none = np.empty((0, 3))
    iterations, on_approach, until_expansion, closest = 0, 0, 0, 1 << 40
    while len(waiting) > 0 and iterations < q.max_iterations:
        _, node = heapq.heappop(waiting)
        row = nodes.rows[node]
        if row[STATE] == CLOSED:
            continue
        iterations += 1
        row[STATE] = CLOSED
        if int(row[0]) == goal_key:
            return nodes, node, none, iterations, 0
        closest = min(closest, int(_left(q, distances, given, ground, ahead, row)))
        pause = max(int(closest / q.analytic_expansion_ratio), math.ceil(q.analytic_expansion_ratio))
        until_expansion = min(until_expansion, pause)
        if until_expansion <= 0:
            until_expansion = pause
            found, origin, curve = expanded(q, given, nodes, node, goal)
            if found:
                return nodes, origin, curve, iterations, 0
        until_expansion -= 1
        if nearest[0][0] < q.tolerance:
            on_approach += 1
            if on_approach >= q.max_on_approach_iterations:
                return nodes, nearest[0][1], none, iterations, 0
        nodes = roomy(nodes, primitives.shape[0])
        _expand(q, distances, given, ground, ahead, nodes, node, primitives, waiting, nearest)
    if nearest[0][0] < q.tolerance:
        return nodes, nearest[0][1], none, iterations, 0
    code = START_OCCUPIED if iterations == 1 else TIMEOUT if iterations >= q.max_iterations else NO_VALID_PATH
    return nodes, first, none, iterations, code


@inner
def _expand(
    q: Any,
    distances: Any,
    given: PlannerInput,
    ground: Ground,
    ahead: Any,
    nodes: Nodes,
    node: int,
    primitives: Any,
    waiting: Any,
    nearest: Any,
) -> None:
    """Put the nodes that a node's primitives improve into the open set.

    Args:
        nearest: Least cost left to the goal so far, and its node, in a list.
    """
    here = nodes.rows[node]
    heading = 2.0 * math.pi * here[HEADING] / q.bins
    c, s = math.cos(heading), math.sin(heading)
    for k in range(primitives.shape[0]):
        primitive = primitives[k]
        x = here[X] + c * primitive[AHEAD] - s * primitive[ASIDE]
        y = here[Y] + s * primitive[AHEAD] + c * primitive[ASIDE]
        if x < 0.0 or y < 0.0 or x >= given.costs.shape[1] or y >= given.costs.shape[0]:
            continue
        turned = int(here[HEADING] + primitive[BINS]) % q.bins
        there = node_of(nodes, (int(y) * given.costs.shape[1] + int(x)) * q.bins + turned)
        row = nodes.rows[there]
        if row[STATE] == CLOSED or row[STATE] == BLOCKED:
            continue
        if row[STATE] == NEW:
            # Of a cell and heading it is known once, from where it was first met.
            row[COST] = center_cost(given.costs, x, y)
            if not has_room(q, given, x, y, 2.0 * math.pi * turned / q.bins):
                row[STATE] = BLOCKED
                continue
            row[VALUE] = math.inf
        value = here[VALUE] + price(q, primitive, row[COST], here[TURN])
        if value >= row[VALUE]:
            continue
        row[X], row[Y], row[HEADING], row[VALUE] = x, y, turned, value
        row[PARENT], row[TURN], row[STATE] = node, primitive[KIND], OPEN
        left = _left(q, distances, given, ground, ahead, row)
        if left < nearest[0][0]:
            nearest[0] = (left, there)
        heapq.heappush(waiting, (value + left, there))


@inner
def _left(q: Any, distances: Any, given: PlannerInput, ground: Ground, ahead: Any, row: Any) -> float:
    """Heuristic cost to the goal: over the ground, or along the shortest curve, whichever is more."""
    x, y = int(row[X]), int(row[Y])
    over = over_ground(q, ground, ahead, given.costs, x, y)
    return max(over, along_curve(q, distances, ground.goal, x, y, int(row[HEADING]), over))


@inner
def _path(q: Any, nodes: Nodes, node: int, curve: Any) -> Any:
    """(N, 3) poses from the start to a node, and on along a curve."""
    n, at = 0, node
    while at >= 0:
        n, at = n + 1, int(nodes.rows[at, PARENT])
    poses = np.empty((n + curve.shape[0], 3))
    poses[n:] = curve
    at = node
    for k in range(n - 1, -1, -1):
        row = nodes.rows[at]
        poses[k, 0], poses[k, 1], poses[k, 2] = row[X], row[Y], 2.0 * math.pi * row[HEADING] / q.bins
        at = int(row[PARENT])
    return poses


class SmacHybrid(SmacPlannerHybrid, Planner):
    """The planner."""

    compute_path = compute_path

    def memory(self, setting: PlannerSetting) -> SearchMemory:
        return search_memory(self, setting)
