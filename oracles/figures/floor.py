"""The floor: axes with an occupancy map and marks common to all maps."""

from collections.abc import Sequence
from typing import Any, Final

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection, PolyCollection
from matplotlib.colors import to_rgba
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch
from matplotlib.transforms import Affine2D
from numpy.typing import NDArray
from PIL import Image

from vastflow.oracles.figures.scene import NO_ZONES, Zones, known_cells, known_extent_m
from vastflow.oracles.figures.style import (
    DPI,
    GOAL_COLOR,
    INK,
    KEEPOUT_COLOR,
    LINE,
    OBSTACLE_COLOR,
    OBSTACLE_EDGE,
    SOFT_INK,
    SPEED_COLOR,
    axis_labels,
    place,
)
from vastflow.sim.model.obstacle import Obstacle
from vastflow.sim.model.pose import Pose
from vastflow.sim.world import occupancy as cell_values
from vastflow.sim.world.occupancy import OccupancyMap

WALL, UNKNOWN, FREE = (58, 63, 71), (226, 229, 232), (255, 255, 255)
"""RGB of cells."""
_WIDTH_IN: Final = 10.0
_HEIGHT_IN: Final = 9.0
_MARGIN_M: Final = 0.4
_MOST_PIXELS: Final = 1400
_ZONE_ALPHA: Final = 0.5


def map_figure(
    occupancy: OccupancyMap,
    legend_rows: int,
    top_in: float = 0.1,
    width_in: float = _WIDTH_IN,
    dpi: int = DPI,
    zones: Zones = NO_ZONES,
) -> tuple[Figure, Axes]:
    """A figure for the known part of a map, with room for labels, a legend below, and `top_in` above."""
    x0, x1, y0, y1 = known_extent_m(occupancy, _MARGIN_M)
    left_in, right_in, bottom_in = 0.55, 0.1, 0.5 + 0.24 * legend_rows
    scale = min((width_in - left_in - right_in) / (x1 - x0), _HEIGHT_IN * width_in / _WIDTH_IN / (y1 - y0))
    map_width_in, map_height_in = scale * (x1 - x0), scale * (y1 - y0)
    # A tall map leaves room at its sides, so that the legend below always has the whole width.
    left_in += (width_in - left_in - right_in - map_width_in) / 2
    height_in = top_in + map_height_in + bottom_in
    figure = Figure(figsize=(width_in, height_in), dpi=dpi)
    axes = place(figure, left_in, bottom_in, map_width_in, map_height_in)
    draw_floor(axes, occupancy, zones)
    axis_labels(axes, "x (m)", "y (m)", labelpad=1)
    return figure, axes


def draw_floor(axes: Axes, occupancy: OccupancyMap, zones: Zones = NO_ZONES) -> None:
    """Draw the map with the zones on it, and show what is known of it."""
    _show(axes, occupancy, _picture(occupancy))
    draw_zones(axes, zones)
    x0, x1, y0, y1 = known_extent_m(occupancy, _MARGIN_M)
    axes.set_xlim(x0, x1)
    axes.set_ylim(y0, y1)
    axes.set_facecolor(LINE)  # as unknown cells
    axes.tick_params(labelsize=8, colors=SOFT_INK, length=2)
    axes.spines[:].set_visible(False)


def draw_zones(axes: Axes, zones: Zones) -> None:
    """Tint keepout and speed zones by the values of their masks."""
    for masks, color in ((zones.keepout, KEEPOUT_COLOR), (zones.speed, SPEED_COLOR)):
        for mask in masks:
            row, end_row, column, end_column = known_cells(mask)
            picture = np.empty((end_row - row, end_column - column, 4), dtype=np.uint8)
            picture[:] = [round(255 * part) for part in to_rgba(color)]
            values = np.maximum(mask.cells[row:end_row, column:end_column], cell_values.FREE)
            picture[..., 3] = np.rint(255 * _ZONE_ALPHA * values / cell_values.OCCUPIED)
            _show(axes, mask, picture)


def zone_handles(zones: Zones) -> list[Patch]:
    """Legend entries of the tints; empty without zones."""
    said = ((zones.keepout, KEEPOUT_COLOR, "kept out by a mask"), (zones.speed, SPEED_COLOR, "slower by a mask"))
    return [Patch(facecolor=color, alpha=_ZONE_ALPHA, label=label) for masks, color, label in said if masks]


def draw_walls(axes: Axes, world: OccupancyMap) -> None:
    """Draw the walls of the world in the color of obstacles."""
    row, end_row, column, end_column = known_cells(world)
    picture = np.zeros((end_row - row, end_column - column, 4), dtype=np.uint8)
    picture[world.occupied[row:end_row, column:end_column]] = [round(255 * part) for part in to_rgba(OBSTACLE_COLOR)]
    _show(axes, world, picture)


def draw_lines(
    axes: Axes, paths: Sequence[NDArray[np.float64]], color: str, *, alpha: float | None = None, width: float = 1.5
) -> None:
    """Draw lines (N, 2), fainter if there are many, so that common parts stand out."""
    if alpha is None:
        alpha = float(np.clip(4 / max(len(paths), 1) ** 0.5, 0.12, 0.8))
    lines = LineCollection(paths, colors=color, linewidths=width, alpha=alpha, capstyle="round")
    lines.set_rasterized(True)
    axes.add_collection(lines, autolim=False)


def places_of(poses: Sequence[Pose]) -> NDArray[np.float64]:
    """Positions (n, 2) of poses."""
    return np.array([(pose.x_m, pose.y_m) for pose in poses], dtype=np.float64).reshape(-1, 2)


def draw_ends(axes: Axes, starts_xy_m: NDArray[np.float64], goals_xy_m: NDArray[np.float64]) -> list[Line2D]:
    """Mark starts (n, 2) and goals (m, 2) and return their legend entries."""
    shrink = 1.0 if len(starts_xy_m) + len(goals_xy_m) <= 60 else 0.6
    alone: dict[str, Any] = {"linestyle": "none"}
    start = {**alone, "marker": "o", "markersize": 6.5 * shrink, "color": "white", "markeredgecolor": INK}
    goal = {**alone, "marker": "D", "markersize": 7.5 * shrink, "color": GOAL_COLOR, "markeredgecolor": "white"}
    axes.plot(*starts_xy_m.T, **start)
    axes.plot(*goals_xy_m.T, **goal)
    return [Line2D([], [], label="start", **start), Line2D([], [], label="goal", **goal)]


def draw_obstacles(axes: Axes, obstacles: Sequence[Obstacle], *, alpha: float) -> None:
    """Fill the outlines of `obstacles`."""
    outlines = [np.asarray(obstacle.footprint().exterior.coords) for obstacle in obstacles]
    shapes = PolyCollection(outlines, facecolors=OBSTACLE_COLOR, edgecolors=OBSTACLE_EDGE, linewidths=0.8, alpha=alpha)
    axes.add_collection(shapes, autolim=False)


def obstacle_handle(n: int) -> list[Patch]:
    """Legend entry of `n` obstacles; empty for 0."""
    if not n:
        return []
    label = f"obstacle, not on the robot's map ({n})"
    return [Patch(facecolor=OBSTACLE_COLOR, edgecolor=OBSTACLE_EDGE, alpha=0.7, label=label)]


def legend(figure: Figure, handles: Sequence[Any]) -> None:
    """Draw the legend below the axes."""
    figure.legend(handles=list(handles), loc="lower center", ncols=min(len(handles), 4), frameon=False, fontsize=9,
                  labelcolor=INK, handletextpad=0.5, columnspacing=1.6, borderpad=0.2)  # fmt: skip


def _show(axes: Axes, occupancy: OccupancyMap, picture: NDArray[np.uint8]) -> None:
    extent = known_extent_m(occupancy.upright, 0.0)
    image = axes.imshow(picture, origin="lower", extent=extent, aspect="auto")
    if occupancy.yaw_rad != 0.0:
        turn = Affine2D().rotate_around(*occupancy.origin_xy_m, occupancy.yaw_rad)
        image.set_transform(turn + axes.transData)


def _picture(occupancy: OccupancyMap) -> NDArray[np.uint8]:
    """The known part of the map as a picture of at most a figure's resolution."""
    row, end_row, column, end_column = known_cells(occupancy)
    cells = occupancy.cells[row:end_row, column:end_column]
    picture = np.empty((*cells.shape, 3), dtype=np.uint8)
    picture[:] = WALL  # everything a robot can't be sure to drive on, but for unknown cells
    picture[cells == cell_values.UNKNOWN] = UNKNOWN
    picture[cells == cell_values.FREE] = FREE
    if (fold := -(-max(cells.shape) // _MOST_PIXELS)) > 1:
        return np.asarray(Image.fromarray(picture).reduce(fold))
    return picture
