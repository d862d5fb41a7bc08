"""The close-up: the world around the robot at one moment, truth dark, belief orange, global costs blue; and the timeline."""

import math
from collections.abc import Mapping, Sequence
from typing import Any, Final

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection, PolyCollection
from matplotlib.colors import to_rgba
from matplotlib.lines import Line2D
from matplotlib.patches import Circle, Polygon, Rectangle
from matplotlib.patches import Patch as Area
from matplotlib.ticker import MaxNLocator
from matplotlib.transforms import Affine2D
from numpy.typing import NDArray

from vastflow.oracles.figures.maps import FREE, UNKNOWN, WALL, draw_zones
from vastflow.oracles.figures.style import COLORS, GOAL_COLOR, INK, OBSTACLE_COLOR, OBSTACLE_EDGE, SOFT_INK
from vastflow.oracles.replay.bands import bands
from vastflow.oracles.replay.story import Story
from vastflow.sim.model.pose import Pose, placed_points
from vastflow.sim.model.rates import TICK_S
from vastflow.sim.replay import Box, Moment, Patch, TickSnapshot
from vastflow.sim.world.occupancy import OccupancyMap

BELIEF_COLOR: Final = "#E69F00"
INTENT_COLOR: Final = "#6A3D9A"
SCAN_COLOR: Final = "#000000"
_BELIEF: Final = (230, 159, 0)
_INFLATED, _INSCRIBED, _MARKED = (86, 180, 233), (172, 208, 232), (0, 96, 150)
_FAINTEST, _STRONGEST = 0.03, 0.33
_DASHES: Final = (0, (3, 2))
PLATE: Final = {"facecolor": "white", "edgecolor": "none", "alpha": 0.75, "boxstyle": "round,pad=0.15"}


def draw_close_up(axes: Axes, story: Story, snapshot: TickSnapshot) -> None:
    """Fill `axes`, which should have the view's proportions, with a moment of a story."""
    tick = snapshot.moment.tick
    box = story.view[tick]
    axes.set(xlim=(box.x0, box.x1), ylim=(box.y0, box.y1), xticks=[], yticks=[], facecolor=_hex(UNKNOWN))
    axes.spines[:].set(color="#B8BEC6", linewidth=0.8)
    points_per_m = width_points(axes) / (box.x1 - box.x0)
    draw_patch(axes, snapshot.global_costs, ground(story.occupancy, snapshot.global_costs))
    draw_zones(axes, story.zones)
    if snapshot.local_costs is not None:
        _draw_local(axes, snapshot.local_costs)
    look: dict[str, Any] = {"facecolors": OBSTACLE_COLOR, "edgecolors": OBSTACLE_EDGE, "linewidths": 0.9, "alpha": 0.55}
    axes.add_collection(PolyCollection(snapshot.obstacles, **look), autolim=False)
    axes.plot(*story.estimated_xy_m[: tick + 1].T, color=BELIEF_COLOR, linewidth=0.9, linestyle=_DASHES, alpha=0.9)
    axes.plot(*story.true_xy_m[: tick + 1].T, color=story.color, linewidth=1.8, alpha=0.9, solid_capstyle="round")
    axes.plot(*snapshot.ahead_xy_m.T, color=GOAL_COLOR, linewidth=4.5, alpha=0.35, solid_capstyle="round")
    axes.plot(*snapshot.plan_xy_m.T, color=GOAL_COLOR, linewidth=1.5)
    axes.plot(*snapshot.intended_xy_m.T, color=INTENT_COLOR, linewidth=2.2, solid_capstyle="round")
    dots: dict[str, Any] = {"marker": ".", "markersize": 2.4, "markeredgewidth": 0, "alpha": 0.6}
    axes.plot(*snapshot.particles[:, :2].T, linestyle="none", color=BELIEF_COLOR, **dots)
    size = float(np.clip(0.05 * points_per_m, 1.2, 3.0))
    axes.plot(*snapshot.scan_xy_m.T, linestyle="none", marker="o", markersize=size, color=SCAN_COLOR,
              markeredgecolor="white", markeredgewidth=0.25 * size)  # fmt: skip
    axes.plot(*story.contacts_until(tick).T, linestyle="none", marker="X", markersize=8, color="#D55E00",
              markeredgecolor="white", markeredgewidth=0.8)  # fmt: skip
    _draw_robot(axes, snapshot)
    _draw_goals(axes, snapshot, box)
    x, y = box.x0 + 0.04 * (box.x1 - box.x0), box.y0 + 0.04 * (box.y1 - box.y0)
    axes.plot([x, x + 1.0], [y, y], color=INK, linewidth=2.2, solid_capstyle="butt")
    axes.text(x + 0.5, y, "1 m", fontsize=7, color=INK, ha="center", va="bottom", bbox=PLATE)


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
    inflated = (costs > 0) & ~(patch.inscribed | patch.lethal | patch.unknown)
    picture[inflated] = _inflated(costs[inflated])
    picture[patch.inscribed] = _INSCRIBED
    picture[patch.lethal] = _MARKED
    picture[patch.unknown] = UNKNOWN
    picture[_standing(occupancy, patch)] = WALL
    return picture


def _standing(occupancy: OccupancyMap, patch: Patch) -> NDArray[np.bool_]:
    """Whether a cell (R, C) of the patch, at points no farther apart than the map's cells, lies in walls."""
    (rows, columns), k = patch.costs.shape, max(1, math.ceil(patch.resolution_m / occupancy.resolution_m - 1e-6))
    rows_in, columns_in = np.indices((rows * k, columns * k)).reshape(2, -1) + 0.5
    points = np.column_stack([columns_in, rows_in]) * (patch.resolution_m / k)
    row, column = np.floor(occupancy.in_cells(placed_points(points, patch.corner))).astype(np.int64).T
    inside = (row >= 0) & (row < occupancy.shape[0]) & (column >= 0) & (column < occupancy.shape[1])
    walls = np.zeros(len(points), dtype=np.bool_)
    walls[inside] = occupancy.occupied[row[inside], column[inside]]
    return np.asarray(walls.reshape(rows, k, columns, k).any(axis=(1, 3)))


def _inflated(costs: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """Colors (N, 3) of costs 1 to 252, the stronger the nearer a wall."""
    share = (_FAINTEST + (_STRONGEST - _FAINTEST) * costs / 252.0)[:, None]
    colors: NDArray[np.uint8] = np.rint((1.0 - share) * 255.0 + share * np.array(_INFLATED)).astype(np.uint8)
    return colors


def draw_patch(axes: Axes, patch: Patch, picture: NDArray[np.uint8]) -> None:
    """A picture of a patch at the patch's place."""
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
    forbidden = patch.lethal | patch.inscribed
    picture[..., 3] = np.select([patch.lethal, forbidden], [235, 45], 0)
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


def _draw_robot(axes: Axes, snapshot: TickSnapshot) -> None:
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
    for index, goal in enumerate(snapshot.goals):
        now = index == snapshot.moment.goal
        if box.x0 <= goal.x_m <= box.x1 and box.y0 <= goal.y_m <= box.y1:
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
                  color=GOAL_COLOR, fontsize=8, ha="center", va="center", fontweight="bold", bbox=PLATE)  # fmt: skip


def width_points(axes: Axes) -> float:
    """Width of `axes` in points."""
    return float(72.0 * axes.get_figure().get_figwidth() * axes.get_position().width)  # type: ignore[union-attr]


def _hex(color: Sequence[int] | NDArray[np.uint8]) -> str:
    return "#" + "".join(f"{int(part):02x}" for part in color)


_BANDS: Final[Mapping[str, tuple[str, float]]] = {
    "following": (COLORS["pass"], 0.18),
    "no progress": ("#F0E442", 0.75),
    "no command": (INK, 0.7),
    "stopped": (COLORS["fail"], 0.95),
    "spin": ("#CC79A7", 0.8),
    "wait": ("#8A8A8A", 0.55),
    "back up": ("#E69F00", 0.8),
    "pausing": ("#8A8A8A", 0.2),
    "resting": ("#8A8A8A", 0.2),
    "starting": ("#8A8A8A", 0.2),
    "ended": ("#8A8A8A", 0.2),
}


_NARROW: Final = {"no command": "no valid command", "stopped": "stopped by the collision monitor"}


def draw_timeline(axes: Axes, moments: Sequence[Moment], marks: Mapping[int, str]) -> None:
    """Fill `axes`: bands of activities, speed (m/s), and localization error (m) over time.

    Args:
        marks: Tick to the label that stands above it.
    """
    times_s = np.array([m.t_s for m in moments])
    end_s = float(times_s[-1]) + TICK_S
    speed = [abs(m.speed_mps) for m in moments]
    error = [m.error_m for m in moments]
    points_per_s = width_points(axes) / end_s
    top = max(0.55, 1.1 * max(error), 1.1 * max(speed))
    axes.set(xlim=(0.0, end_s), ylim=(-0.36 * top, top))
    for first, last, kind in bands(moments):
        color, alpha = _BANDS[kind]
        width_s = (last - first + 1) * TICK_S
        axes.broken_barh([(first * TICK_S, width_s)], (-0.33 * top, 0.25 * top), facecolor=to_rgba(color, alpha))
        if width_s * points_per_s > 4.2 * len(kind) + 4.0:
            middle_s = first * TICK_S + width_s / 2
            color = "white" if kind in _NARROW else INK
            axes.text(middle_s, -0.205 * top, kind, fontsize=7, ha="center", va="center", color=color, clip_on=True)
    axes.fill_between(times_s, 0.0, speed, color=COLORS["pass"], alpha=0.3, linewidth=0)
    axes.plot(times_s, error, color=BELIEF_COLOR, linewidth=1.3)
    height, before_s = 1.03, -math.inf
    for tick, label in marks.items():
        t_s = tick * TICK_S
        close = (t_s - before_s) * points_per_s < 5.0 * len(label) + 3.0
        height, before_s = (1.17 if close and height == 1.03 else 1.03), t_s
        axes.axvline(t_s, color=INK, linewidth=0.6, alpha=0.5)
        axes.text(t_s, height * top, label, fontsize=7, ha="center", va="bottom", color=INK, fontweight="bold")
    # Names of the curves, and of the bands that are too narrow to be named inside.
    kinds = {kind for _, _, kind in bands(moments)}
    words = [("speed (m/s)", COLORS["pass"]), ("localization error (m)", "#B77F00")]
    words += [(text, _BANDS[kind][0]) for kind, text in _NARROW.items() if kind in kinds]
    left = 0
    for text, color in words:
        axes.annotate(text, (0.0, 0.0), (left, -13), xycoords="axes fraction", textcoords="offset points", fontsize=7,
                      va="top", color=color)  # fmt: skip
        left += 4 * len(text) + 10
    axes.set_yticks([each for each in MaxNLocator(3, steps=[1, 2, 5, 10]).tick_values(0.0, top) if each <= top])
    axes.tick_params(labelsize=7, colors=SOFT_INK, length=2)
    axes.annotate("simulated time (s)", (1.0, 0.0), (0, -13), xycoords="axes fraction", textcoords="offset points",
                  fontsize=7, va="top", ha="right", color=SOFT_INK)  # fmt: skip
    axes.spines[:].set_visible(False)


def draw_now(axes: Axes, moments: Sequence[Moment], tick: int) -> None:
    """Over a timeline of the same size: a line at `tick`; what comes after it gets faint."""
    end_s = moments[-1].t_s + TICK_S
    axes.set(xlim=(0.0, end_s), ylim=(0.0, 1.0))
    axes.axis("off")
    axes.axvspan(tick * TICK_S, end_s, color="white", alpha=0.6, linewidth=0)
    axes.axvline(tick * TICK_S, color=INK, linewidth=1.4)
