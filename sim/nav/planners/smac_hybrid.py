"""SmacPlannerHybrid: Hybrid-A* over cells and headings, along arcs that a robot with a least turning radius can drive."""

import heapq
import math
from typing import Any, NamedTuple

import numpy as np

from vastflow.sim.kernels.numeric import addressed, inner, njit
from vastflow.sim.nav.planners.expansion import expanded
from vastflow.sim.nav.planners.heuristic import Ground, along_curve, new_ground, over_ground
from vastflow.sim.nav.planners.nodes import (
    BLOCKED,
    CLOSED,
    COST,
    HEADING,
    NEW,
    OPEN,
    PARENT,
    STATE,
    TURN,
    VALUE,
    Nodes,
    X,
    Y,
    new_nodes,
    node_of,
    roomy,
)
from vastflow.sim.nav.planners.primitives import AHEAD, ASIDE, BINS, KIND, NO_TURN, price, primitives_of
from vastflow.sim.nav.planners.room import center_cost, has_room
from vastflow.sim.nav.planners.search import NO_VALID_PATH, START_OCCUPIED, TIMEOUT, PlannerInput
from vastflow.sim.nav.planners.smoother import smooth


class _Nearest(NamedTuple):
    """The node with the least left to the goal: (1,) what is left, and (1,) the node."""

    left: Any
    node: Any


@addressed
def compute_path(q: Any, distances: Any, given: PlannerInput) -> int:
    """The number of poses of the path, which `given.path` then begins with; minus an error code where there is none."""
    poses, iterations, code = search(q, distances, given)
    n = poses.shape[0]
    if code == 0 and n > given.path.shape[0]:
        code = NO_VALID_PATH
    if code != 0:
        return int(-code)
    for k in range(n):
        given.path[k, 0] = q.origin_x + poses[k, 0] * q.resolution
        given.path[k, 1] = q.origin_y + poses[k, 1] * q.resolution
        given.path[k, 2] = poses[k, 2]
    if q.smoother_iterations > 0 and iterations > 1:
        smooth(q, given.costs, given.path[:n], given.path[:n, 2])
    return int(n)


@njit
def search(q: Any, distances: Any, given: PlannerInput) -> Any:
    """(poses, iterations, error code): the path as it is searched, not smoothed.

    Args:
        q: `Search`.
        distances: See `heuristic.new_distances`.

    Returns:
        poses: (N, 3) x, y in cells and heading in radians, from the start's cell and bin on.
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
    nodes, ground = new_nodes(), new_ground(q, given.costs, goal)
    part = 2 if q.halves != 0 else 1
    ahead = [(0.0, (int(goal[1]) // part) * ground.values.shape[1] + int(goal[0]) // part)]
    first, goal_key = node_of(nodes, _key(q, given, start)), _key(q, given, goal)
    nodes.rows[first, X : HEADING + 1] = start
    nodes.rows[first, PARENT], nodes.rows[first, TURN], nodes.rows[first, STATE] = -1.0, NO_TURN, OPEN
    waiting = [(0.0, first)]
    nearest = _Nearest(np.full(1, math.inf), np.zeros(1, dtype=np.int64))
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
        pause = max(int(closest / q.expansion_ratio), math.ceil(q.expansion_ratio))
        until_expansion = min(until_expansion, pause)
        if until_expansion <= 0:
            until_expansion = pause
            found, origin, curve = expanded(q, given, nodes, node, goal)
            if found:
                return nodes, origin, curve, iterations, 0
        until_expansion -= 1
        if nearest.left[0] < q.tolerance:
            on_approach += 1
            if on_approach >= q.max_on_approach_iterations:
                return nodes, nearest.node[0], none, iterations, 0
        nodes = roomy(nodes, primitives.shape[0])
        _expand(q, distances, given, ground, ahead, nodes, node, primitives, waiting, nearest)
    if nearest.left[0] < q.tolerance:
        return nodes, nearest.node[0], none, iterations, 0
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
    nearest: _Nearest,
) -> None:
    """Put the nodes that a node's primitives lead to, and that it is the best way to, into the open set."""
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
        if left < nearest.left[0]:
            nearest.left[0], nearest.node[0] = left, there
        heapq.heappush(waiting, (value + left, there))


@inner
def _left(q: Any, distances: Any, given: PlannerInput, ground: Ground, ahead: Any, row: Any) -> float:
    """What is left from a node to the goal: over the ground, or along the shortest curve, whichever is more."""
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
