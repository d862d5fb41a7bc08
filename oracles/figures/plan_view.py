"""The plan view: a scenario from above before it is run, with its map, path, start, goals and obstacles."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any, Final

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Circle, Patch, PathPatch
from matplotlib.path import Path
from numpy.typing import NDArray

from vastflow.oracles.figures.floor import (
    draw_ends,
    draw_obstacles,
    legend,
    map_figure,
    obstacle_handle,
    places_of,
    zone_handles,
)
from vastflow.oracles.figures.scene import NO_ZONES, Zones
from vastflow.oracles.figures.style import INK, OBSTACLE_COLOR, OBSTACLE_EDGE
from vastflow.oracles.observation.situation import Situation
from vastflow.sim.model.obstacle import Obstacle
from vastflow.sim.model.pose import Pose
from vastflow.sim.world.occupancy import OccupancyMap

PATH_COLOR: Final = "#0072B2"
_DASHES: Final = (0, (4, 3))
_TITLE_IN: Final = 0.36
_ARROW_POINTS: Final = 16.0


@dataclass(frozen=True, eq=False)
class PlanView:
    """Content of a plan view.

    Attributes:
        path_xy_m: (N, 2) the path that was drawn for the robot, which it need not follow; empty where there is none.
    """

    title: str
    occupancy: OccupancyMap
    situation: Situation
    path_xy_m: NDArray[np.float64] = field(repr=False)
    zones: Zones = NO_ZONES


def plan_view_figure(view: PlanView) -> Figure:
    """The map with everything of the scenario on it; an obstacle that appears has its outline and trigger dashed."""
    figure, axes = map_figure(view.occupancy, legend_rows=2, top_in=_TITLE_IN, zones=view.zones)
    figure.suptitle(
        view.title, x=0.02, ha="left", y=1 - 0.12 / figure.get_figheight(), va="top", fontsize=10, color=INK
    )
    handles: list[Any] = []
    if len(view.path_xy_m) > 1:
        axes.plot(*view.path_xy_m.T, color=PATH_COLOR, linewidth=1.8, solid_capstyle="round", alpha=0.85)
        handles.append(Line2D([], [], color=PATH_COLOR, linewidth=1.8, label="path"))
    standing = [obstacle for obstacle in view.situation.obstacles if obstacle.trigger is None]
    appearing = [obstacle for obstacle in view.situation.obstacles if obstacle.trigger is not None]
    draw_obstacles(axes, standing, alpha=0.7)
    _draw_appearing(axes, appearing)
    handles += _draw_stops(axes, view.situation)
    handles += _obstacle_handles(len(standing), len(appearing))
    handles += zone_handles(view.zones)
    if handles:
        legend(figure, handles)
    return figure


def _draw_appearing(axes: Axes, obstacles: Sequence[Obstacle]) -> None:
    for obstacle in obstacles:
        outline = Path(np.asarray(obstacle.footprint().exterior.coords), closed=True)
        look: dict[str, Any] = {"edgecolor": OBSTACLE_EDGE, "linestyle": _DASHES}
        axes.add_patch(PathPatch(outline, facecolor=OBSTACLE_COLOR, alpha=0.45, linewidth=1.2, **look))
        if obstacle.trigger is not None:
            at = obstacle.trigger
            axes.add_patch(Circle((at.x_m, at.y_m), at.distance_m, facecolor="none", linewidth=1.0, **look))


def _draw_stops(axes: Axes, situation: Situation) -> list[Line2D]:
    """Start and goals with the directions they ask for; several goals with their numbers."""
    if situation.start is None:
        return []
    goals = list(dict.fromkeys(situation.goals))
    for pose in (situation.start, *goals):
        _draw_direction(axes, pose)
    handles = draw_ends(axes, places_of([situation.start]), places_of(goals))
    if len(goals) > 1:
        for number, goal in enumerate(goals, 1):
            axes.annotate(str(number), (goal.x_m, goal.y_m), (6, 5), textcoords="offset points", fontsize=8, color=INK)
    return handles


def _draw_direction(axes: Axes, pose: Pose) -> None:
    tip = (_ARROW_POINTS * math.cos(pose.yaw_rad), _ARROW_POINTS * math.sin(pose.yaw_rad))
    arrow = {"arrowstyle": "<-", "color": INK, "linewidth": 1.0, "shrinkA": 0, "shrinkB": 0}
    axes.annotate("", (pose.x_m, pose.y_m), tip, textcoords="offset points", arrowprops=arrow)


def _obstacle_handles(standing: int, appearing: int) -> list[Any]:
    handles: list[Any] = [*obstacle_handle(standing)]
    if appearing:
        label = f"obstacle that appears when the robot enters the circle ({appearing})"
        look: dict[str, Any] = {"facecolor": OBSTACLE_COLOR, "edgecolor": OBSTACLE_EDGE, "linestyle": _DASHES}
        handles.append(Patch(alpha=0.45, label=label, **look))
    return handles
