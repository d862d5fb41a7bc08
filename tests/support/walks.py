"""Ways of a robot on a map, found without the product's planner."""

import itertools
import math

import numpy as np
import shapely
from skimage.graph import MCP_Geometric

from vastflow.sim.world import octile
from vastflow.sim.world.map_file import load_map


def walks(map_file, robot_diameter):
    """Return the passable mask (H, W), its cells (N, 2), and the octile distances (N, N) in meters between them."""
    occupancy = load_map(map_file.path)
    blocked = np.argwhere(np.pad(~occupancy.free, 1, constant_values=True)) - 1
    every = np.indices(occupancy.shape).reshape(2, -1).T
    nearest = np.hypot(*(every[:, None] - blocked).transpose(2, 0, 1)).min(axis=1)
    passable = (nearest > math.ceil(robot_diameter / 2 / occupancy.resolution_m)).reshape(occupancy.shape)
    cells, cost = np.argwhere(passable), np.where(passable, 1.0, -1.0)
    found = [MCP_Geometric(cost, fully_connected=True).find_costs([start])[0][passable] for start in cells]
    return passable, cells, np.array(found).reshape(len(cells), len(cells)) * occupancy.resolution_m


def is_walked(path, passable, occupancy):
    """Whether every cell below the legs of a path along the grid is passable."""
    legs = [np.linspace(one, other, 60) for one, other in itertools.pairwise(path)]
    return all(passable[occupancy.cell_of(*point)] for point in np.concatenate([path[:1], *legs]))


def leaves_a_path(map_file, footprints, stops, robot_diameter):
    """Whether a robot gets from stop to stop when no cell is free that a footprint touches."""
    occupancy = load_map(map_file.path)
    free = occupancy.free.copy()
    cells = np.argwhere(free)
    corner = occupancy.centers_of(cells) - occupancy.resolution_m / 2
    squares = shapely.box(*corner.T, *(corner + occupancy.resolution_m).T)
    for footprint in footprints:
        free[tuple(cells[shapely.intersects(squares, footprint)].T)] = False
    passable = octile.inflated_free(free, math.ceil(robot_diameter / 2 / occupancy.resolution_m))
    return octile.shortest_path(occupancy, passable, np.array(stops)) is not None
