"""The case figure: one configuration's runs on the part of the map where they drove."""

from collections.abc import Sequence
from typing import Any, Final

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Rectangle
from numpy.typing import NDArray

from vastflow.oracles.figures.floor import DPI, draw_ends, draw_floor, draw_lines, draw_obstacles, draw_walls
from vastflow.oracles.figures.palette import COLORS, INK
from vastflow.oracles.figures.zones import NO_ZONES, Zones
from vastflow.oracles.situation import Situation
from vastflow.oracles.verdict import Judgement
from vastflow.sim.model.obstacle import Obstacle
from vastflow.sim.world.occupancy import OccupancyMap

_WIDTH_IN: Final = 5.0
_HEIGHT_IN: Final = 3.4
_MARGIN_M: Final = 1.2
_LEAST_M: Final = 5.0


def case_figure(
    occupancy: OccupancyMap,
    situation: Situation,
    obstacles: Sequence[Obstacle],
    paths: Sequence[tuple[Judgement, NDArray[np.float64]]],
    estimate_xy_m: NDArray[np.float64] | None = None,
    world: OccupancyMap | None = None,
    zones: Zones = NO_ZONES,
) -> Figure:
    """Paths (N, 2) by judgement, failures on top with a cross where they ended; the robot's own estimate (N, 2) of one is dashed.

    Args:
        world: The walls as they stand, where the robot's map has them elsewhere.
    """
    figure = Figure(figsize=(_WIDTH_IN, _HEIGHT_IN), dpi=DPI)
    axes = figure.add_axes((0, 0, 1, 1))
    draw_floor(axes, occupancy, zones)
    if world is not None:
        draw_walls(axes, world)
    axes.set_xticks([])
    axes.set_yticks([])
    draw_obstacles(axes, obstacles, alpha=0.7)
    judgements: tuple[Judgement, ...] = ("pass", "not judged", "fail")
    for judgement in judgements:
        lines = [line for said, line in paths if said == judgement]
        draw_lines(axes, lines, COLORS[judgement], alpha=0.55 if len(lines) > 3 else 0.8)
    if estimate_xy_m is not None:
        axes.plot(*estimate_xy_m.T, color=INK, linewidth=1.3, linestyle=(0, (3, 2)), alpha=0.8)
    ends = np.array([line[-1] for said, line in paths if said == "fail"]).reshape(-1, 2)
    axes.plot(*ends.T, "X", ms=8, color=COLORS["fail"], mec="white", mew=0.9)
    if situation.start is not None:
        start = np.array([(situation.start.x_m, situation.start.y_m)])
        goals = np.array([(goal.x_m, goal.y_m) for goal in situation.goals]).reshape(-1, 2)
        draw_ends(axes, start, goals)
        points = np.concatenate([start, goals, *(line for _, line in paths)])
    else:
        points = np.concatenate([np.zeros((0, 2)), *(line for _, line in paths)])
    if len(points):
        (x0, y0), (x1, y1) = points.min(axis=0) - _MARGIN_M, points.max(axis=0) + _MARGIN_M
        meters = max(x1 - x0, (y1 - y0) * _WIDTH_IN / _HEIGHT_IN, _LEAST_M)
        x, y = (x0 + x1) / 2, (y0 + y1) / 2
        axes.set_xlim(x - meters / 2, x + meters / 2)
        axes.set_ylim(y - meters / 2 * _HEIGHT_IN / _WIDTH_IN, y + meters / 2 * _HEIGHT_IN / _WIDTH_IN)
        _draw_scale(axes, meters)
    return figure


def _draw_scale(axes: Axes, meters: float) -> None:
    """A bar of 1 m in the lower left corner."""
    pad: dict[str, Any] = {"facecolor": "white", "edgecolor": "none", "alpha": 0.85, "transform": axes.transAxes}
    axes.add_patch(Rectangle((0.015, 0.02), max(1 / meters, 0.07) + 0.03, 0.115, zorder=4, **pad))
    look: dict[str, Any] = {"color": INK, "transform": axes.transAxes, "zorder": 5}
    axes.plot([0.03, 0.03 + 1 / meters], [0.045, 0.045], linewidth=2.5, solid_capstyle="butt", **look)
    axes.text(0.03, 0.062, "1 m", fontsize=8, va="bottom", **look)
