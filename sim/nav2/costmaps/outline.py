"""Outline of the robot's padded footprint, a polygon or Nav2's 16-gon for `robot_radius`, and its radii."""

from typing import Final

import numpy as np
from numpy.typing import NDArray

from vastflow.sim.model.elementary import cos_sin, hypots
from vastflow.sim.model.polygon import as_array, vertices_of
from vastflow.sim.nav2.parameters.costmap import Costmap
from vastflow.sim.nav2.parameters.stack import NavParameters

VERTICES: Final = 16


def outline_of(costmap: Costmap) -> NDArray[np.float64]:
    """(V, 2) vertices of a costmap's padded footprint in the robot's frame (m): the polygon's, or 16 of the disc."""
    if vertices := vertices_of(costmap.footprint):
        return padded(as_array(vertices), costmap.footprint_padding)
    return padded_outline(costmap.robot_radius, costmap.footprint_padding)


def padded_outline(robot_radius_m: float, padding_m: float) -> NDArray[np.float64]:
    """Vertices (16, 2) in the robot's frame, counter-clockwise from +x.

    The result is not regular and its radii are neither `robot_radius` nor that plus the padding.
    """
    angles_rad = (2.0 * np.pi * np.arange(VERTICES) / VERTICES).tolist()
    # sin π is 1.2e-16 and not 0, so a vertex on an axis moves off it, in Nav2 as here.
    return padded(robot_radius_m * np.array([*map(cos_sin, angles_rad)]), padding_m)


def padded(vertices: NDArray[np.float64], padding_m: float) -> NDArray[np.float64]:
    """Vertices (N, 2), each moved away from both axes by the padding (nav2_costmap_2d, `padFootprint`)."""
    return np.asarray(vertices + padding_m * np.sign(vertices))


def inscribed_radius_m(outline: NDArray[np.float64]) -> float:
    """Radius of the largest circle round the robot's center inside the outline (0.225498 m for 0.22 m and 0.01 m)."""
    to_vertices_m = hypots(outline[:, 0], outline[:, 1])
    is_edge = (outline != np.roll(outline, -1, axis=0)).any(axis=1)  # a padding below 0 can lay vertices together
    ends, outline = np.roll(outline, -1, axis=0)[is_edge], outline[is_edge]
    edges = ends - outline
    areas = outline[:, 0] * ends[:, 1] - outline[:, 1] * ends[:, 0]
    to_lines_m = np.abs(areas) / hypots(edges[:, 0], edges[:, 1])
    # Of an edge that the perpendicular from the center misses, as a notch has them, an end is nearest.
    shares = -np.sum(outline * edges, axis=1) / np.sum(edges * edges, axis=1)
    return float(min(to_vertices_m.min(), np.min(to_lines_m[(shares >= 0.0) & (shares <= 1.0)], initial=np.inf)))


def inscribed_radius_of(parameters: NavParameters) -> float:
    """Radius (m) of the largest disc inside of the robot: that of `robot`, else of the local footprint."""
    given, costmap = parameters.robot, parameters.local_costmap
    if given.radius is not None:
        return given.radius
    vertices = vertices_of(given.polygon or costmap.footprint)
    return inscribed_radius_m(as_array(vertices)) if vertices else costmap.robot_radius
