"""NavFn by itself: a potential and a path over a costmap, from Python."""

import numpy as np

from vastflow.sim.nav2.planners import navfn


def potential(costmap, root, stop=None, allow_unknown=True, use_astar=False):
    """Potential (H, W) from the cell (x, y) `root`, until `stop` has a value; unreached cells keep 1e10."""
    travel = navfn.travel_costs(costmap, allow_unknown)
    out = navfn.new_potential(travel.shape)
    stop = stop or (-1, -1)
    travel[root[1], root[0]] = navfn.NEUTRAL
    navfn.propagate(travel, *root, *stop, use_astar, out, np.inf, out, navfn.new_scratch(travel.shape))
    return out


def path(costmap, start, goal, allow_unknown=True, use_astar=False):
    """Path (N, 2) of (x, y) in cells from start to goal; empty if there is none."""
    out = np.empty((4 * max(costmap.shape), 2))
    n = navfn.descend(potential(costmap, start, goal, allow_unknown, use_astar), *goal, *start, out)
    return out[:n][::-1].copy()
