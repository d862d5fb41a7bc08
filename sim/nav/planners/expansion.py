"""Analytic expansion: the curve of bounded curvature from a node to the goal, where the robot has room along it."""

import math
from typing import Any

import numpy as np

from vastflow.sim.kernels.numeric import inner
from vastflow.sim.nav.planners.curves import pose_on, shortest
from vastflow.sim.nav.planners.nodes import HEADING, PARENT, Nodes, X, Y
from vastflow.sim.nav.planners.room import center_cost, has_room
from vastflow.sim.nav.planners.search import WHOLE

_REFINEMENTS = 8
_STEP_NODES = 5
_WIDEST = 4.0


@inner
def expanded(q: Any, given: Any, nodes: Nodes, node: int, goal: Any) -> Any:
    """(found, node, poses): the best curve to the goal, and the node it begins at, which may lie before the one asked for.

    Args:
        goal: (3,) x, y in cells and bin.

    Returns:
        poses: (P, 3) x, y in cells and heading in radians, without the node's own, the goal's last.
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
    """(found, poses, score): a curve of one radius; its score is its cost as the search would have it, but for turns."""
    x, y, heading = nodes.rows[node, X], nodes.rows[node, Y], 2.0 * math.pi * nodes.rows[node, HEADING] / q.bins
    dx, dy = (goal[0] - x) / radius, (goal[1] - y) / radius
    c, s = math.cos(heading), math.sin(heading)
    curve = shortest(c * dx + s * dy, c * dy - s * dx, 2.0 * math.pi * goal[2] / q.bins - heading, q.reverses != 0)
    length = radius * curve[0]
    count = int(length / math.sqrt(2.0))
    poses = np.empty((max(count, 1), 3))
    poses[-1, 0], poses[-1, 1], poses[-1, 2] = goal[0], goal[1], 2.0 * math.pi * goal[2] / q.bins
    if length > q.expansion_length:
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
        # Costly ground may only be entered for good: from its last stretch on, a curve that has left it must not come back.
        if cost <= q.expansion_cost:
            leaves = 2 if leaves == 1 else leaves
        elif leaves == 0:
            leaves = 1
        score += step * (1.0 + q.cost_penalty * cost / WHOLE)
    if leaves == 2 and not (q.expansion_override != 0 and length < 2.0 * math.pi * radius):
        return False, poses, math.inf
    return True, poses, score
