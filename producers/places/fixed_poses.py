"""Fixed poses of a family: whether they lie on its map, off its walls, and within reach of each other."""

from collections.abc import Iterator, Mapping

import numpy as np

from vastflow.sim.model.pose import Pose
from vastflow.sim.world.occupancy import OccupancyMap


def pose_complaints(
    occupancy: OccupancyMap, stops: Mapping[str, Pose], radius_m: float
) -> Iterator[tuple[str, str, str]]:
    """Yield name, problem, and expectation of each pose that a robot of the radius can't reach.

    The robot passes where its center is more than its radius from the center of every wall's cell, over unknown cells as well. A pose
    that is nearer to a wall counts as the nearest place where the robot passes.
    """
    from scipy import ndimage

    cells = {name: occupancy.cell_of(pose.x_m, pose.y_m) for name, pose in stops.items()}
    inside = {name: cell for name, cell in cells.items() if occupancy.contains(*cell)}
    passable = np.ones(occupancy.shape, dtype=np.bool_)
    if occupancy.occupied.any():
        passable = ndimage.distance_transform_edt(~occupancy.occupied) > radius_m / occupancy.resolution_m
    rows, columns = ndimage.distance_transform_edt(~passable, return_distances=False, return_indices=True)
    regions = ndimage.label(passable, np.ones((3, 3)))[0][rows, columns]
    first = next((name for name, cell in inside.items() if not occupancy.occupied[cell]), "")
    for name, pose in stops.items():
        got = f"got ({pose.x_m:g}, {pose.y_m:g}), which"
        if name not in inside:
            yield name, f"{got} lies outside the map", "a pose on the map"
        elif occupancy.occupied[cells[name]]:
            yield name, f"{got} lies in a wall", "a pose off the map's walls"
        elif regions[cells[name]] != regions[cells[first]]:
            robot = f"a robot of {radius_m:g} m radius"
            yield name, f"{got} {robot} can't reach from {first}", "a pose to which the map has a path"
