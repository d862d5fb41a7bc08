"""The close-up: the world around the robot at one moment. Truth is dark, belief orange, global costs blue."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection, PolyCollection
from matplotlib.lines import Line2D
from matplotlib.patches import Circle, Polygon, Rectangle
from matplotlib.patches import Patch as Area
from matplotlib.transforms import Affine2D
from numpy.typing import NDArray

from vastflow.oracles.figures.floor import FREE, UNKNOWN, WALL, draw_zones
from vastflow.oracles.figures.scene import NO_ZONES, Zones
from vastflow.oracles.figures.style import GOAL_COLOR, INK, OBSTACLE_COLOR, OBSTACLE_EDGE
from vastflow.sim.model.pose import Pose
from vastflow.sim.nav2.costmaps.inflation import INSCRIBED, LETHAL
from vastflow.sim.nav2.costmaps.inflation import UNKNOWN as UNKNOWN_COST
from vastflow.sim.replay import Box, Patch, TickSnapshot
from vastflow.sim.world.occupancy import OccupancyMap

BELIEF_COLOR: Final = "#E69F00"
INTENT_COLOR: Final = "#6A3D9A"
SCAN_COLOR: Final = "#000000"
_BELIEF: Final = (230, 159, 0)
_INFLATED, _INSCRIBED, _MARKED = (86, 180, 233), (172, 208, 232), (0, 96, 150)
_FAINTEST, _STRONGEST = 0.03, 0.33
_DASHES: Final = (0, (3, 2))


@dataclass(frozen=True, eq=False)
class DrivenPath:
    """True and estimated positions (N, 2) up to a moment, and places of contacts."""

    true_xy_m: NDArray[np.float64]
    estimated_xy_m: NDArray[np.float64]
    contacts_xy_m: NDArray[np.float64]
    color: str


def draw_close_up(
    axes: Axes, occupancy: OccupancyMap, snapshot: TickSnapshot, path: DrivenPath, box: Box, zones: Zones = NO_ZONES
) -> None:
    """Fill `axes` with the part `box` of the map frame; the box should have the axes' proportions."""
    axes.set(xlim=(box.x0, box.x1), ylim=(box.y0, box.y1), xticks=[], yticks=[], facecolor=_hex(UNKNOWN))
    axes.spines[:].set(color="#B8BEC6", linewidth=0.8)
    points_per_m = _points_per_m(axes, box)
    draw_patch(axes, snapshot.global_costs, ground(occupancy, snapshot.global_costs))
    draw_zones(axes, zones)
    if snapshot.local_costs is not None:
        _draw_local(axes, snapshot.local_costs)
    _draw_obstacles(axes, snapshot.obstacles)
    axes.plot(*path.estimated_xy_m.T, color=BELIEF_COLOR, linewidth=0.9, linestyle=_DASHES, alpha=0.9)
    axes.plot(*path.true_xy_m.T, color=path.color, linewidth=1.8, alpha=0.9, solid_capstyle="round")
    axes.plot(*snapshot.ahead_xy_m.T, color=GOAL_COLOR, linewidth=4.5, alpha=0.35, solid_capstyle="round")
    axes.plot(*snapshot.plan_xy_m.T, color=GOAL_COLOR, linewidth=1.5)
    axes.plot(*snapshot.intended_xy_m.T, color=INTENT_COLOR, linewidth=2.2, solid_capstyle="round")
    dots: dict[str, Any] = {"marker": ".", "markersize": 2.4, "markeredgewidth": 0, "alpha": 0.6}
    axes.plot(*snapshot.particles[:, :2].T, linestyle="none", color=BELIEF_COLOR, **dots)
    size = float(np.clip(0.05 * points_per_m, 1.2, 3.0))
    axes.plot(*snapshot.scan_xy_m.T, linestyle="none", marker="o", markersize=size, color=SCAN_COLOR,
              markeredgecolor="white", markeredgewidth=0.25 * size)  # fmt: skip
    axes.plot(*path.contacts_xy_m.T, linestyle="none", marker="X", markersize=8, color="#D55E00",
              markeredgecolor="white", markeredgewidth=0.8)  # fmt: skip
    _draw_robot(axes, snapshot)
    _draw_goals(axes, snapshot, box)
    _draw_scale(axes, box)


def legend_handles(color: str) -> list[Any]:
    """Legend entries; `color` is the trajectory's."""
    alone: dict[str, Any] = {"linestyle": "none"}
    believed: dict[str, Any] = {"linestyle": _DASHES, "linewidth": 1, "markerfacecolor": "none", "markeredgewidth": 1.6}
    return [
        Line2D([], [], label="robot", marker="o", markersize=8, color=INK, **alone),
        Line2D([], [], label="path so far", color=color, linewidth=2),
        Line2D([], [], label="where it takes itself to be", marker="o", markersize=8, color=BELIEF_COLOR, **believed),
        Line2D([], [], label="particles", marker=".", markersize=4, color=BELIEF_COLOR, **alone),
        Line2D([], [], label="scan", marker="o", markersize=3, color=SCAN_COLOR, **alone),
        Line2D([], [], label="plan, and what of it the controller follows", color=GOAL_COLOR, linewidth=1.5),
        Line2D([], [], label="where MPPI's commands lead", color=INTENT_COLOR, linewidth=2.2),
        Line2D([], [], label="goal", marker="D", markersize=6, color=GOAL_COLOR, **alone),
        Area(facecolor=_hex(_inflated(np.array([130], dtype=np.uint8))[0]), label="global costs"),
        Area(facecolor=_hex(_INSCRIBED), label="no place for the robot's center"),
        Area(facecolor=_hex(_MARKED), label="marked, not on the map"),
        Area(facecolor=BELIEF_COLOR, alpha=0.7, label="the same of the local costmap (dashed square)"),
        Area(facecolor=OBSTACLE_COLOR, edgecolor=OBSTACLE_EDGE, alpha=0.7, label="obstacle"),
    ]


def ground(occupancy: OccupancyMap, patch: Patch) -> NDArray[np.uint8]:
    """Picture (R, C, 3) of walls over a patch of global costs, row 0 at the lowest y."""
    costs = patch.costs
    picture = np.empty((*costs.shape, 3), dtype=np.uint8)
    picture[:] = FREE
    inflated = (costs > 0) & (costs < INSCRIBED)
    picture[inflated] = _inflated(costs[inflated])
    picture[costs == INSCRIBED] = _INSCRIBED
    picture[costs == LETHAL] = _MARKED
    picture[costs == UNKNOWN_COST] = UNKNOWN
    picture[_walls(occupancy, patch)] = WALL
    return picture


def _walls(occupancy: OccupancyMap, patch: Patch) -> NDArray[np.bool_]:
    """Whether each cell (R, C) of the patch, one or more cells of the map, contains a wall."""
    k = round(patch.resolution_m / occupancy.resolution_m)
    row, column = np.rint(occupancy.in_cells(np.array([(patch.corner.x_m, patch.corner.y_m)])))[0].astype(int).tolist()
    rows, columns = patch.costs.shape
    part = occupancy.occupied[row : row + rows * k, column : column + columns * k]
    walls = np.zeros((rows * k, columns * k), dtype=np.bool_)
    walls[: part.shape[0], : part.shape[1]] = part
    return np.asarray(walls.reshape(rows, k, columns, k).any(axis=(1, 3)))


def _inflated(costs: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """Colors (N, 3) of costs 1 to 252, the stronger the nearer a wall."""
    share = (_FAINTEST + (_STRONGEST - _FAINTEST) * costs / 252.0)[:, None]
    colors: NDArray[np.uint8] = np.rint((1.0 - share) * 255.0 + share * np.array(_INFLATED)).astype(np.uint8)
    return colors


def draw_patch(axes: Axes, patch: Patch, picture: NDArray[np.uint8]) -> None:
    """A picture of a patch where the patch lies."""
    rows, columns = patch.costs.shape
    if not rows or not columns:
        return
    image = axes.imshow(
        picture,
        origin="lower",
        extent=(0.0, columns * patch.resolution_m, 0.0, rows * patch.resolution_m),
        interpolation="nearest",
        aspect="auto",
    )
    image.set_transform(_place(patch) + axes.transData)
    image.set_clip_path(axes.patch)


def _place(patch: Patch) -> Affine2D:
    return Affine2D().rotate(patch.corner.yaw_rad).translate(patch.corner.x_m, patch.corner.y_m)


def _draw_local(axes: Axes, patch: Patch) -> None:
    """The local costmap over the global one: its marks, and a line round where the robot's center may not be."""
    limits = axes.get_xlim(), axes.get_ylim()
    costs = patch.costs
    picture = np.empty((*costs.shape, 4), dtype=np.uint8)
    picture[..., :3] = _BELIEF
    forbidden = (costs == LETHAL) | (costs == INSCRIBED)
    picture[..., 3] = np.select([costs == LETHAL, forbidden], [235, 45], 0)
    draw_patch(axes, patch, picture)
    rows, columns = costs.shape
    if forbidden.any() and not forbidden.all():
        x, y = ((np.arange(n) + 0.5) * patch.resolution_m for n in (columns, rows))
        points = _place(patch).transform(np.stack(np.meshgrid(x, y), axis=-1).reshape(-1, 2)).reshape(rows, columns, 2)
        axes.contour(points[..., 0], points[..., 1], forbidden, levels=[0.5], colors=BELIEF_COLOR, linewidths=1.1)
    edge = Rectangle((0, 0), columns * patch.resolution_m, rows * patch.resolution_m, fill=False, linewidth=1.0,
                     edgecolor=BELIEF_COLOR, linestyle=(0, (4, 3)))  # fmt: skip
    edge.set_transform(_place(patch) + axes.transData)
    axes.add_patch(edge)
    axes.set(xlim=limits[0], ylim=limits[1])  # which imshow has changed


def _draw_obstacles(axes: Axes, obstacles: NDArray[np.float64]) -> None:
    outlines = [_outline(row) for row in obstacles if np.isfinite(row[:6]).all()]
    axes.add_collection(
        PolyCollection(outlines, facecolors=OBSTACLE_COLOR, edgecolors=OBSTACLE_EDGE, linewidths=0.9, alpha=0.55),
        autolim=False,
    )


def _outline(row: NDArray[np.float64]) -> NDArray[np.float64]:
    """Corners (N, 2) of an obstacle's row (x, y, cos, sin, half length, half width or 0 for a cylinder)."""
    x, y, c, s, length, width = row[:6].tolist()
    if width == 0.0:
        angles = np.linspace(0.0, 2.0 * math.pi, 32, endpoint=False)
        return np.column_stack([x + length * np.cos(angles), y + length * np.sin(angles)])
    corners = np.array([[length, width], [-length, width], [-length, -width], [length, -width]])
    return np.asarray(corners @ np.array([[c, s], [-s, c]]) + (x, y))


def _draw_robot(axes: Axes, snapshot: TickSnapshot) -> None:
    """The true body, dark, and the padded footprint where the robot takes itself to be."""
    true, estimate = snapshot.moment.true, snapshot.moment.estimate
    robot, solid = snapshot.robot, {"facecolor": INK, "edgecolor": "white", "linewidth": 0.8, "zorder": 4}
    if robot.vertices:
        axes.add_patch(Polygon(_turned(np.array(robot.vertices), true), closed=True, **solid))
    else:
        axes.add_patch(Circle((true.x_m, true.y_m), robot.radius_m, **solid))
    axes.add_collection(LineCollection([_heading(true, robot.radius_m)], colors="white", linewidths=1.6, zorder=5))
    edge = {"edgecolor": BELIEF_COLOR, "linewidth": 1.6, "fill": False}
    axes.add_patch(Polygon(_turned(snapshot.outline_m, estimate), closed=True, zorder=6, **edge))
    length_m = float(np.hypot(*snapshot.outline_m.T).max())
    axes.add_collection(LineCollection([_heading(estimate, length_m)], colors=BELIEF_COLOR, linewidths=1.2, zorder=6))
    if snapshot.moment.stopped:
        stop = {"edgecolor": "#D55E00", "linewidth": 1.8, "fill": False, "linestyle": (0, (1.5, 1))}
        axes.add_patch(Circle((true.x_m, true.y_m), length_m + 0.12, zorder=6, **stop))


def _turned(points: NDArray[np.float64], pose: Pose) -> NDArray[np.float64]:
    """Points (N, 2) of the robot's frame in the map's."""
    c, s = math.cos(pose.yaw_rad), math.sin(pose.yaw_rad)
    return np.asarray(points @ np.array([[c, s], [-s, c]]) + (pose.x_m, pose.y_m))


def _heading(pose: Pose, length_m: float) -> list[tuple[float, float]]:
    ahead = pose.x_m + length_m * math.cos(pose.yaw_rad), pose.y_m + length_m * math.sin(pose.yaw_rad)
    return [(pose.x_m, pose.y_m), ahead]


def _draw_goals(axes: Axes, snapshot: TickSnapshot, box: Box) -> None:
    """Draw goals as diamonds, other goals hollow; an arrow points to the current goal out of sight."""
    for index, goal in enumerate(snapshot.goals):
        now = index == snapshot.moment.goal
        if _inside(box, goal):
            axes.plot(goal.x_m, goal.y_m, marker="D", markersize=7.5 if now else 6, zorder=5, markeredgewidth=1.0,
                      color=GOAL_COLOR if now else "white", markeredgecolor="white" if now else GOAL_COLOR)  # fmt: skip
        elif now:
            _draw_arrow(axes, goal, box)


def _draw_arrow(axes: Axes, goal: Pose, box: Box) -> None:
    """At the box's edge, towards the goal, with the distance from the box's middle."""
    x, y = (box.x0 + box.x1) / 2, (box.y0 + box.y1) / 2
    dx, dy = goal.x_m - x, goal.y_m - y
    half_width, half_height = (box.x1 - box.x0) / 2, (box.y1 - box.y0) / 2
    reach = min(half_width / abs(dx) if dx else math.inf, half_height / abs(dy) if dy else math.inf)
    tail = (x + 0.86 * reach * dx, y + 0.86 * reach * dy)
    axes.annotate("", (x + 0.98 * reach * dx, y + 0.98 * reach * dy), tail,
                  arrowprops={"arrowstyle": "-|>", "color": GOAL_COLOR, "linewidth": 2})  # fmt: skip
    away_m = math.hypot(dx, dy)
    axes.annotate(f"goal, {away_m:.0f} m", tail, (-32 * dx / away_m, -9 * dy / away_m), textcoords="offset points",
                  color=GOAL_COLOR, fontsize=8, ha="center", va="center", fontweight="bold", bbox=_PLATE)  # fmt: skip


def _draw_scale(axes: Axes, box: Box) -> None:
    x, y = box.x0 + 0.04 * (box.x1 - box.x0), box.y0 + 0.04 * (box.y1 - box.y0)
    axes.plot([x, x + 1.0], [y, y], color=INK, linewidth=2.2, solid_capstyle="butt")
    axes.text(x + 0.5, y, "1 m", fontsize=7, color=INK, ha="center", va="bottom", bbox=_PLATE)


_PLATE: Final = {"facecolor": "white", "edgecolor": "none", "alpha": 0.75, "boxstyle": "round,pad=0.15"}


def _inside(box: Box, pose: Pose) -> bool:
    return box.x0 <= pose.x_m <= box.x1 and box.y0 <= pose.y_m <= box.y1


def _points_per_m(axes: Axes, box: Box) -> float:
    inches = axes.get_figure().get_figwidth() * axes.get_position().width  # type: ignore[union-attr]
    return float(72.0 * inches / (box.x1 - box.x0))


def _hex(color: Sequence[int] | NDArray[np.uint8]) -> str:
    return "#" + "".join(f"{int(part):02x}" for part in color)
