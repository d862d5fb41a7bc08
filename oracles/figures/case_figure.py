"""Case and pair figures: the paths of one configuration's runs, in one campaign or in two."""

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any, Final, TypeAlias

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Rectangle
from numpy.typing import NDArray

from vastflow.oracles.figures.floor import (
    draw_ends,
    draw_floor,
    draw_lines,
    draw_obstacles,
    draw_walls,
    legend,
    obstacle_handle,
    places_of,
    zone_handles,
)
from vastflow.oracles.figures.scene import NO_ZONES, Zones
from vastflow.oracles.figures.style import COLORS, DPI, INK, place
from vastflow.oracles.judgement.verdict import Judgement
from vastflow.oracles.observation.situation import Situation
from vastflow.sim.model.obstacle import Obstacle
from vastflow.sim.world.occupancy import OccupancyMap

Floats: TypeAlias = NDArray[np.float64]

_WIDTH_IN: Final = 5.0
_HEIGHT_IN: Final = 3.4
_MARGIN_M: Final = 1.2
_LEAST_M: Final = 5.0


def case_figure(
    occupancy: OccupancyMap,
    situation: Situation,
    obstacles: Sequence[Obstacle],
    paths: Sequence[tuple[Judgement, Floats]],
    estimate_xy_m: Floats | None = None,
    world: OccupancyMap | None = None,
    zones: Zones = NO_ZONES,
) -> Figure:
    """Draw paths (N, 2) by judgement with crosses where failures ended; an estimated path (N, 2) is dashed.

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
    for judgement in _JUDGEMENTS:
        lines = [line for said, line in paths if said == judgement]
        draw_lines(axes, lines, COLORS[judgement], alpha=0.55 if len(lines) > 3 else 0.8)
    if estimate_xy_m is not None:
        axes.plot(*estimate_xy_m.T, color=INK, linewidth=1.3, linestyle=(0, (3, 2)), alpha=0.8)
    ends = np.array([line[-1] for said, line in paths if said == "fail"]).reshape(-1, 2)
    axes.plot(*ends.T, **_cross())
    stops = _stops(situation)
    if situation.start is not None:
        draw_ends(axes, *stops)
    points = np.concatenate([*stops, *(line for _, line in paths)])
    if len(points):
        low, high = points.min(axis=0) - _MARGIN_M, points.max(axis=0) + _MARGIN_M
        _draw_scale(axes, _look_at(axes, low, high, (_WIDTH_IN, _HEIGHT_IN), _LEAST_M))
    return figure


def _draw_scale(axes: Axes, meters: float) -> None:
    """A bar of 1 m in the lower left corner."""
    pad: dict[str, Any] = {"facecolor": "white", "edgecolor": "none", "alpha": 0.85, "transform": axes.transAxes}
    axes.add_patch(Rectangle((0.015, 0.02), max(1 / meters, 0.07) + 0.03, 0.115, zorder=4, **pad))
    look: dict[str, Any] = {"color": INK, "transform": axes.transAxes, "zorder": 5}
    axes.plot([0.03, 0.03 + 1 / meters], [0.045, 0.045], linewidth=2.5, solid_capstyle="butt", **look)
    axes.text(0.03, 0.062, "1 m", fontsize=8, va="bottom", **look)


_PANEL_IN: Final = 5.0
_LEGEND_IN: Final = 0.6
_TITLE_IN: Final = 0.62
_GAP_IN: Final = 0.12
_JUDGEMENTS: Final[tuple[Judgement, ...]] = ("pass", "not judged", "fail")


@dataclass(frozen=True, eq=False)
class Side:
    """Content of one campaign's panel: true trajectories (N, 2), of which `chosen` is drawn strong."""

    title: str
    occupancy: OccupancyMap
    situation: Situation
    obstacles: Sequence[Obstacle]
    paths: Sequence[tuple[Judgement, Floats]] = field(repr=False)
    chosen: int | None = None
    zones: Zones = NO_ZONES


def pair_figure(title: str, sides: tuple[Side, Side]) -> Figure:
    """Draw both sides on the same part of the map, the chosen runs strong among the others."""
    low, high = _box(sides)
    height_in = float(np.clip(_PANEL_IN * (high[1] - low[1]) / (high[0] - low[0]), 2.5, 7.0))
    width_in, whole_in = 2 * _PANEL_IN + 3 * _GAP_IN, height_in + _LEGEND_IN + _TITLE_IN
    figure = Figure(figsize=(width_in, whole_in), dpi=DPI)
    figure.text(_GAP_IN / width_in, 1 - 0.1 / whole_in, title, fontsize=11, fontweight="bold", color=INK, va="top")
    marks: list[Line2D] = []
    for k, side in enumerate(sides):
        axes = place(figure, _GAP_IN + k * (_PANEL_IN + _GAP_IN), _LEGEND_IN, _PANEL_IN, height_in)
        marks = _draw(axes, side)
        axes.set_title(side.title, fontsize=9, color=INK, loc="left", pad=4)
        _look_at(axes, low, high, (1.0, height_in / _PANEL_IN))
    legend(figure, [*marks, *_handles(sides)])
    return figure


def _draw(axes: Axes, side: Side) -> list[Line2D]:
    draw_floor(axes, side.occupancy, side.zones)
    axes.set_xticks([])
    axes.set_yticks([])
    draw_obstacles(axes, side.obstacles, alpha=0.7)
    others = [path for k, path in enumerate(side.paths) if k != side.chosen]
    for judgement in _JUDGEMENTS:
        lines = [line for said, line in others if said == judgement]
        draw_lines(axes, lines, COLORS[judgement], alpha=0.22 if side.chosen is not None else None)
    if side.chosen is not None:
        said, line = side.paths[side.chosen]
        draw_lines(axes, [line], COLORS[said], alpha=1.0, width=2.6)
    marks = draw_ends(axes, *_stops(side.situation)) if side.situation.start is not None else []
    ends = np.array([line[-1] for said, line in side.paths if said == "fail"]).reshape(-1, 2)
    axes.plot(*ends.T, **_cross())
    return marks


def _stops(situation: Situation) -> tuple[Floats, Floats]:
    """Start and goals (n, 2)."""
    return places_of([] if situation.start is None else [situation.start]), places_of(situation.goals)


def _box(sides: Sequence[Side]) -> tuple[Floats, Floats]:
    """Lowest and highest corner of all that happened on either side."""
    points = np.concatenate([p for side in sides for p in (*_stops(side.situation), *(path for _, path in side.paths))])
    if not len(points):
        points = np.zeros((1, 2))
    low, high = points.min(axis=0) - _MARGIN_M, points.max(axis=0) + _MARGIN_M
    middle, half = (low + high) / 2, np.maximum((high - low) / 2, _LEAST_M / 2)
    return middle - half, middle + half


def _look_at(axes: Axes, low: Floats, high: Floats, shape: tuple[float, float], least_m: float = 0.0) -> float:
    """Show a box in a panel of proportions `shape` and return the shown width in meters."""
    (x, y), (width, height) = (low + high) / 2, high - low
    across, up = shape
    half_x = max(width, height * across / up, least_m) / 2
    axes.set_xlim(x - half_x, x + half_x)
    axes.set_ylim(y - half_x * up / across, y + half_x * up / across)
    return float(2 * half_x)


def _cross() -> dict[str, Any]:
    look: dict[str, Any] = {"marker": "X", "markersize": 8, "color": COLORS["fail"], "markeredgecolor": "white"}
    return {**look, "markeredgewidth": 0.9, "linestyle": "none"}


def _handles(sides: Sequence[Side]) -> list[Any]:
    handles: list[Any] = []
    words = {"pass": "passed", "fail": "failed", "not judged": "not judged"}
    for judgement in _JUDGEMENTS:
        if any(said == judgement for side in sides for said, _ in side.paths):
            handles.append(Line2D([], [], color=COLORS[judgement], linewidth=2.5, label=words[judgement]))
    if any(said == "fail" for side in sides for said, _ in side.paths):
        handles.append(Line2D([], [], label="where it failed", **_cross()))
    before, after = (side.zones for side in sides)
    zones = Zones(before.keepout + after.keepout, before.speed + after.speed)
    return [*handles, *obstacle_handle(max(len(side.obstacles) for side in sides)), *zone_handles(zones)]
