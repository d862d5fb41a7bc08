"""Figures of one configuration: its plan before it is run, the paths of its runs, and these in two campaigns."""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Any, Final

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Circle, Patch, PathPatch, Rectangle
from matplotlib.path import Path
from numpy.typing import NDArray

from vastflow.oracles.figures import maps
from vastflow.oracles.figures.style import COLORS, DPI, INK, OBSTACLE_COLOR, OBSTACLE_EDGE, WORDS, place
from vastflow.oracles.judgment.verdict import Judgment
from vastflow.oracles.observation.situation import Situation, situation_of
from vastflow.oracles.query.scene import NO_ZONES, Zones, zones_of
from vastflow.oracles.results.executed import KeptFiles, scenario_of_row
from vastflow.oracles.results.tables import Tables
from vastflow.sim.model.obstacle import Obstacle
from vastflow.sim.world.environment import world_of
from vastflow.sim.world.world import World

Floats = NDArray[np.float64]
PATH_COLOR: Final = "#0072B2"
CASE_IN: Final = (5.0, 3.4)
_MARGIN_M: Final = 1.2
_LEAST_M: Final = 5.0
_PANEL_IN: Final = 5.0
_LEGEND_IN: Final = 0.6
_TITLE_IN: Final = 0.62
_GAP_IN: Final = 0.12
_JUDGMENTS: Final[tuple[Judgment, ...]] = ("pass", "not judged", "fail")
CROSS: Final[dict[str, Any]] = {"marker": "X", "ms": 8, "color": COLORS["fail"], "mec": "white", "mew": 0.9, "ls": ""}
_DASHES: Final = (0, (4, 3))
_PLAN_TITLE_IN: Final = 0.36
_ARROW_POINTS: Final = 16.0


@dataclass(frozen=True, eq=False)
class Case:
    """The runs of a configuration in one campaign.

    Attributes:
        paths: True trajectories (N, 2) by judgment, of which `chosen` is drawn strong.
        estimate_xy_m: (N, 2) an estimated path, dashed.
        mover_paths: Trajectories (N, 2) of movers in one run, dotted.
        route_xy_m: (N, 2) the way, which is in sight in all figures, and drawn in a plan view.
    """

    title: str
    world: World
    situation: Situation
    obstacles: Sequence[Obstacle]
    paths: Sequence[tuple[Judgment, Floats]] = field(repr=False)
    chosen: int | None = None
    zones: Zones = NO_ZONES
    estimate_xy_m: Floats | None = None
    mover_paths: Sequence[Floats] = field(default=(), repr=False)
    route_xy_m: Floats | None = field(default=None, repr=False)

    @property
    def stops(self) -> tuple[Floats, Floats]:
        start = self.situation.start
        return maps.places_of([] if start is None else [start]), maps.places_of(self.situation.goals)

    @property
    def points(self) -> list[Floats]:
        """All places (n, 2) that a figure must show."""
        around = [] if self.route_xy_m is None else [self.route_xy_m]
        return [*self.stops, *(path for _, path in self.paths), *around]


def case_of(tables: Tables, configuration: int, files: KeptFiles) -> Case:
    """The configuration at an index in its world, before any run; a `ValueError` without a world."""
    scenario = scenario_of_row(tables.configurations.row(configuration), files)
    world = world_of(scenario.environment)
    if world is None:
        raise ValueError("it has no map")
    situation = situation_of(scenario)
    return Case("", world, situation, situation.obstacles, (), zones=zones_of([scenario]))


def case_figure(case: Case) -> Figure:
    """Draw a case, with crosses where failures ended."""
    figure = Figure(figsize=CASE_IN, dpi=DPI)
    axes = figure.add_axes((0, 0, 1, 1))
    _draw(axes, case, lambda n: 0.55 if n > 3 else 0.8)
    points = np.concatenate(case.points)
    if len(points):
        low, high = points.min(axis=0) - _MARGIN_M, points.max(axis=0) + _MARGIN_M
        meters = _look_at(axes, low, high, CASE_IN, _LEAST_M)
        # A bar of 1 m in the lower left corner.
        pad: dict[str, Any] = {"facecolor": "white", "edgecolor": "none", "alpha": 0.85, "transform": axes.transAxes}
        axes.add_patch(Rectangle((0.015, 0.02), max(1 / meters, 0.07) + 0.03, 0.115, zorder=4, **pad))
        look: dict[str, Any] = {"color": INK, "transform": axes.transAxes, "zorder": 5}
        axes.plot([0.03, 0.03 + 1 / meters], [0.045, 0.045], linewidth=2.5, solid_capstyle="butt", **look)
        axes.text(0.03, 0.062, "1 m", fontsize=8, va="bottom", **look)
    return figure


def pair_figure(title: str, sides: tuple[Case, Case]) -> Figure:
    """Draw both sides on the same part of the map, the chosen runs strong among the others."""
    points = np.concatenate([points for side in sides for points in side.points])
    points = points if len(points) else np.zeros((1, 2))
    low, high = points.min(axis=0), points.max(axis=0)
    middle, half = (low + high) / 2, np.maximum((high - low) / 2 + _MARGIN_M, _LEAST_M / 2)
    low, high = middle - half, middle + half
    height_in = float(np.clip(_PANEL_IN * (high[1] - low[1]) / (high[0] - low[0]), 2.5, 7.0))
    width_in, whole_in = 2 * _PANEL_IN + 3 * _GAP_IN, height_in + _LEGEND_IN + _TITLE_IN
    figure = Figure(figsize=(width_in, whole_in), dpi=DPI)
    figure.text(_GAP_IN / width_in, 1 - 0.1 / whole_in, title, fontsize=11, fontweight="bold", color=INK, va="top")
    marks: list[Line2D] = []
    for k, side in enumerate(sides):
        axes = place(figure, _GAP_IN + k * (_PANEL_IN + _GAP_IN), _LEGEND_IN, _PANEL_IN, height_in)
        marks = _draw(axes, side, (lambda _: 0.22) if side.chosen is not None else (lambda _: None))
        axes.set_title(side.title, fontsize=9, color=INK, loc="left", pad=4)
        _look_at(axes, low, high, (1.0, height_in / _PANEL_IN))
    said = {said for side in sides for said, _ in side.paths}
    handles: list[Any] = [
        Line2D([], [], color=COLORS[judgment], linewidth=2.5, label=WORDS[judgment])
        for judgment in _JUDGMENTS
        if judgment in said
    ]
    handles += [Line2D([], [], label="where it failed", **CROSS)] if "fail" in said else []
    before, after = (side.zones for side in sides)
    zones = Zones(before.keepout + after.keepout, before.speed + after.speed)
    obstacles = maps.obstacle_handle(max(len(side.obstacles) for side in sides))
    maps.legend(figure, [*marks, *handles, *obstacles, *maps.zone_handles(zones)])
    return figure


def _draw(axes: Axes, case: Case, alpha: Callable[[int], float | None]) -> list[Line2D]:
    """Fill `axes` with a case, n lines at the opacity `alpha(n)`, and return legend entries of its ends."""
    maps.draw_floor(axes, case.world.ground, case.zones)
    if case.world.walls is not case.world.ground:
        maps.draw_walls(axes, case.world.walls)
    axes.set(xticks=[], yticks=[])
    maps.draw_obstacles(axes, case.obstacles, alpha=0.7)
    for path in case.mover_paths:
        axes.plot(*path.T, color=INK, linewidth=1.0, linestyle=(0, (1, 2)), alpha=0.6)
    for judgment in _JUDGMENTS:
        lines = [line for k, (said, line) in enumerate(case.paths) if said == judgment and k != case.chosen]
        maps.draw_lines(axes, lines, COLORS[judgment], alpha=alpha(len(lines)))
    if case.chosen is not None:
        said, line = case.paths[case.chosen]
        maps.draw_lines(axes, [line], COLORS[said], alpha=1.0, width=2.6)
    if case.estimate_xy_m is not None:
        axes.plot(*case.estimate_xy_m.T, color=INK, linewidth=1.3, linestyle=(0, (3, 2)), alpha=0.8)
    ends = np.array([line[-1] for said, line in case.paths if said == "fail"]).reshape(-1, 2)
    axes.plot(*ends.T, **CROSS)
    return maps.draw_ends(axes, *case.stops) if case.situation.start is not None else []


def _look_at(axes: Axes, low: Floats, high: Floats, shape: tuple[float, float], least_m: float = 0.0) -> float:
    """Show a box in a panel of proportions `shape` and return the shown width in meters."""
    (x, y), (width, height) = (low + high) / 2, high - low
    across, up = shape
    half_x = max(width, height * across / up, least_m) / 2
    axes.set_xlim(x - half_x, x + half_x)
    axes.set_ylim(y - half_x * up / across, y + half_x * up / across)
    return float(2 * half_x)


def plan_view_figure(view: Case) -> Figure:
    """The map with everything of the scenario on it; an obstacle that appears has its outline and trigger dashed."""
    figure, axes = maps.map_figure(view.world.ground, legend_rows=2, top_in=_PLAN_TITLE_IN, zones=view.zones)
    if view.world.walls is not view.world.ground:
        maps.draw_walls(axes, view.world.walls)
    top = 1 - 0.12 / figure.get_figheight()
    figure.suptitle(view.title, x=0.02, ha="left", y=top, va="top", fontsize=10, color=INK)
    handles: list[Any] = []
    if view.route_xy_m is not None and len(view.route_xy_m) > 1:
        axes.plot(*view.route_xy_m.T, color=PATH_COLOR, linewidth=1.8, solid_capstyle="round", alpha=0.85)
        handles.append(Line2D([], [], color=PATH_COLOR, linewidth=1.8, label="path"))
    standing = [obstacle for obstacle in view.situation.obstacles if obstacle.trigger is None]
    appearing = [obstacle for obstacle in view.situation.obstacles if obstacle.trigger is not None]
    maps.draw_obstacles(axes, standing, alpha=0.7)
    dashed: dict[str, Any] = {"edgecolor": OBSTACLE_EDGE, "linestyle": _DASHES}
    for obstacle in appearing:
        outline = Path(np.asarray(obstacle.footprint().exterior.coords), closed=True)
        axes.add_patch(PathPatch(outline, facecolor=OBSTACLE_COLOR, alpha=0.45, linewidth=1.2, **dashed))
        if (at := obstacle.trigger) is not None:
            axes.add_patch(Circle((at.x_m, at.y_m), at.distance_m, facecolor="none", linewidth=1.0, **dashed))
    handles += _draw_stops(axes, view.situation) + maps.obstacle_handle(len(standing))
    if appearing:
        label = f"obstacle that appears when the robot enters the circle ({len(appearing)})"
        handles.append(Patch(facecolor=OBSTACLE_COLOR, alpha=0.45, label=label, **dashed))
    handles += maps.zone_handles(view.zones)
    if handles:
        maps.legend(figure, handles)
    return figure


def _draw_stops(axes: Axes, situation: Situation) -> list[Any]:
    if situation.start is None:
        return []
    goals = list(dict.fromkeys(situation.goals))
    arrow = {"arrowstyle": "<-", "color": INK, "linewidth": 1.0, "shrinkA": 0, "shrinkB": 0}
    for pose in (situation.start, *goals):
        tip = (_ARROW_POINTS * math.cos(pose.yaw_rad), _ARROW_POINTS * math.sin(pose.yaw_rad))
        axes.annotate("", (pose.x_m, pose.y_m), tip, textcoords="offset points", arrowprops=arrow)
    handles = maps.draw_ends(axes, maps.places_of([situation.start]), maps.places_of(goals))
    if len(goals) > 1:
        for number, goal in enumerate(goals, 1):
            axes.annotate(str(number), (goal.x_m, goal.y_m), (6, 5), textcoords="offset points", fontsize=8, color=INK)
    return [*handles]
