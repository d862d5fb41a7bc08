"""Placing obstacles along a path as version 1 of RoboVAST does: into walls and into each other, if need be."""

import math
from collections.abc import Iterator, Sequence
from dataclasses import replace
from typing import Final

import numpy as np
from numpy.typing import NDArray

from vastflow.producers.places.cells import centerd_cells
from vastflow.producers.places.ground import Ground
from vastflow.producers.places.outline import Line
from vastflow.producers.places.placement import MAX_ATTEMPTS, Site, Wanted, is_connected
from vastflow.sim.model.obstacle import Obstacle

FROM_STOPS: Final = 2.0
"""Least distance of a center from start and goals, in diameters of the robot."""
FROM_EACH_OTHER: Final = 1.5
"""Least distance of two centers, in diameters of the robot."""
TRIES_FOR_EACH: Final = 100
"""Places tried for one kind of obstacle, for each that is wanted of it."""


def place_as_v1(site: Site, wanted: Sequence[Wanted], rng: np.random.Generator) -> list[Obstacle] | str:
    """Draw a place for every obstacle in turn; or say why version 1 would find none.

    Places are drawn as `vastflow.producers.places.placement.place` draws them. One will do where the center is far enough
    from the stops and from other centers. A whole set will do where a path remains: it is drawn `MAX_ATTEMPTS` times at most.
    """
    total = sum(each.amount for each in wanted)
    if total == 0:
        return []
    most, blocking = 0, 0
    for _ in range(MAX_ATTEMPTS):
        obstacles = list(_drawn(site, wanted, rng))
        most = max(most, len(obstacles))
        if len(obstacles) < total:
            continue
        if is_connected(site, _around(site.ground, (*site.standing, *obstacles))):
            return obstacles
        blocking += 1
    if blocking:
        return f"as version 1 places them, {blocking} of {MAX_ATTEMPTS} sets of {total} obstacles left no path to the goals"
    return f"as version 1 places them, at most {most} of {total} obstacles found room in {MAX_ATTEMPTS} attempts"


def _drawn(site: Site, wanted: Sequence[Wanted], rng: np.random.Generator) -> Iterator[Obstacle]:
    """One set, as far as places are found."""
    line = Line.along(site.path_xy_m)
    diameter_m = site.ground.robot_diameter_m
    centers: list[tuple[float, float]] = []
    for each in wanted:
        left = each.amount
        for _ in range(TRIES_FOR_EACH * each.amount):
            if not left:
                break
            pose = line.draw(each.max_distance_m, rng)
            center = pose.x_m, pose.y_m
            if any(math.dist(center, stop) < FROM_STOPS * diameter_m for stop in site.stops_xy_m):
                continue
            if any(math.dist(center, other) < FROM_EACH_OTHER * diameter_m for other in centers):
                continue
            centers.append(center)
            left -= 1
            yield replace(each.pattern, pose=pose)


def _around(ground: Ground, obstacles: Sequence[Obstacle]) -> NDArray[np.bool_]:
    """The passable cells (H, W) when obstacles stand, each grown by the robot's radius to all sides."""
    passable = ground.passable.copy()
    for obstacle in obstacles:
        length_m, width_m = (side_m + ground.robot_diameter_m for side_m in (obstacle.length_m, obstacle.width_m))
        grown = replace(obstacle, length_m=length_m, width_m=width_m)
        cells = centerd_cells(ground.occupancy, grown.footprint())
        passable[cells[:, 0], cells[:, 1]] = False
    return passable
