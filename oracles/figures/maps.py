"""Maps: the floor with marks common to all figures on maps, final poses, trajectories, and failure rates of places."""

from collections.abc import Iterable, Sequence
from typing import Any, Final

import matplotlib
import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection, PolyCollection
from matplotlib.colors import Normalize, to_rgba
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch
from matplotlib.transforms import Affine2D
from numpy.typing import ArrayLike, NDArray
from PIL import Image

from vastflow.oracles.figures import style
from vastflow.oracles.judgment.verdict import Judgment
from vastflow.oracles.query.scene import NO_ZONES, Scene, Zones, known_cells, known_extent_m
from vastflow.oracles.results.tables import CODES
from vastflow.oracles.statistics.failure_map import MINIMUM_VISITS, FailureGrid, grid_over
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
    dpi: int = style.DPI,
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
    axes = style.place(figure, left_in, bottom_in, map_width_in, map_height_in)
    draw_floor(axes, occupancy, zones)
    style.axis_labels(axes, "x (m)", "y (m)", labelpad=1)
    return figure, axes


def lines_plot(
    lines: Iterable[tuple[str, ArrayLike, ArrayLike]], x: str, y: str, occupancy: OccupancyMap | None = None
) -> style.Plot:
    """Draw named lines, on a map if one is given."""
    figure = Figure(figsize=(8, 5), layout="constrained")
    axes = figure.subplots()
    axes.set(xlabel=x, ylabel=y)
    if occupancy is not None:
        draw_floor(axes, occupancy)
    for name, *xy in lines:
        axes.plot(*xy, label=name)
    if axes.lines:
        figure.legend(loc="outside right upper", fontsize=8)
    return style.Plot(figure)


def draw_floor(axes: Axes, occupancy: OccupancyMap, zones: Zones = NO_ZONES) -> None:
    """Draw the map with its zones, cropped to the known part."""
    _show(axes, occupancy, _picture(occupancy))
    draw_zones(axes, zones)
    x0, x1, y0, y1 = known_extent_m(occupancy, _MARGIN_M)
    axes.set_xlim(x0, x1)
    axes.set_ylim(y0, y1)
    axes.set_facecolor(style.LINE)  # as unknown cells
    axes.tick_params(labelsize=8, colors=style.SOFT_INK, length=2)
    axes.spines[:].set_visible(False)


def draw_zones(axes: Axes, zones: Zones) -> None:
    """Tint keepout and speed zones by the values of their masks."""
    for masks, color in ((zones.keepout, style.KEEPOUT_COLOR), (zones.speed, style.SPEED_COLOR)):
        for mask in masks:
            values = np.maximum(mask.cells[known_cells(mask)], cell_values.FREE)
            picture = np.tile(np.array(_rgba(color), np.uint8), (*values.shape, 1))
            picture[..., 3] = np.rint(255 * _ZONE_ALPHA * values / cell_values.OCCUPIED)
            _show(axes, mask, picture)


def zone_handles(zones: Zones) -> list[Patch]:
    """Legend entries of the tints; empty without zones."""
    said = (zones.keepout, style.KEEPOUT_COLOR, "kept out"), (zones.speed, style.SPEED_COLOR, "slower")
    return [
        Patch(facecolor=color, alpha=_ZONE_ALPHA, label=f"{label} by a mask") for masks, color, label in said if masks
    ]


def draw_walls(axes: Axes, world: OccupancyMap) -> None:
    occupied = world.occupied[known_cells(world)]
    picture = np.zeros((*occupied.shape, 4), dtype=np.uint8)
    picture[occupied] = _rgba(style.OBSTACLE_COLOR)
    _show(axes, world, picture)


def _rgba(color: str) -> list[int]:
    return [round(255 * part) for part in to_rgba(color)]


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
    return np.array([(pose.x_m, pose.y_m) for pose in poses], dtype=np.float64).reshape(-1, 2)


def draw_ends(axes: Axes, starts_xy_m: NDArray[np.float64], goals_xy_m: NDArray[np.float64]) -> list[Line2D]:
    """Mark starts (n, 2) and goals (m, 2) and return their legend entries."""
    shrink = 1.0 if len(starts_xy_m) + len(goals_xy_m) <= 60 else 0.6
    alone: dict[str, Any] = {"linestyle": "none"}
    start = {**alone, "marker": "o", "markersize": 6.5 * shrink, "color": "white", "markeredgecolor": style.INK}
    goal = {**alone, "marker": "D", "markersize": 7.5 * shrink, "color": style.GOAL_COLOR, "markeredgecolor": "white"}
    axes.plot(*starts_xy_m.T, **start)
    axes.plot(*goals_xy_m.T, **goal)
    return [Line2D([], [], label="start", **start), Line2D([], [], label="goal", **goal)]


def draw_obstacles(axes: Axes, obstacles: Sequence[Obstacle], *, alpha: float) -> None:
    outlines = [np.asarray(obstacle.footprint().exterior.coords) for obstacle in obstacles]
    shapes = PolyCollection(
        outlines, facecolors=style.OBSTACLE_COLOR, edgecolors=style.OBSTACLE_EDGE, linewidths=0.8, alpha=alpha
    )
    axes.add_collection(shapes, autolim=False)


def obstacle_handle(n: int) -> list[Patch]:
    """Legend entry of `n` obstacles; empty for 0."""
    if not n:
        return []
    label = f"obstacle, not on the robot's map ({n})"
    return [Patch(facecolor=style.OBSTACLE_COLOR, edgecolor=style.OBSTACLE_EDGE, alpha=0.7, label=label)]


def legend(figure: Figure, handles: Sequence[Any]) -> None:
    figure.legend(handles=list(handles), loc="lower center", ncols=min(len(handles), 4), frameon=False, fontsize=9,
                  labelcolor=style.INK, handletextpad=0.5, columnspacing=1.6, borderpad=0.2)  # fmt: skip


def _show(axes: Axes, occupancy: OccupancyMap, picture: NDArray[np.uint8]) -> None:
    extent = known_extent_m(occupancy.upright, 0.0)
    image = axes.imshow(picture, origin="lower", extent=extent, aspect="auto")
    if occupancy.yaw_rad != 0.0:
        turn = Affine2D().rotate_around(*occupancy.origin_xy_m, occupancy.yaw_rad)
        image.set_transform(turn + axes.transData)


def _picture(occupancy: OccupancyMap) -> NDArray[np.uint8]:
    """The known part of the map as a picture of at most a figure's resolution."""
    cells = occupancy.cells[known_cells(occupancy)]
    picture = np.empty((*cells.shape, 3), dtype=np.uint8)
    picture[:] = WALL  # everything a robot can't be sure to drive on, but for unknown cells
    picture[cells == cell_values.UNKNOWN] = UNKNOWN
    picture[cells == cell_values.FREE] = FREE
    if (fold := -(-max(cells.shape) // _MOST_PIXELS)) > 1:
        return np.asarray(Image.fromarray(picture).reduce(fold))
    return picture


BLUR_M: Final = 0.2
"""Standard deviation of the blur of final poses; the paper's blur radius."""
MAX_OBSTACLES: Final = 150
"""Obstacles drawn; more cover the floor and say nothing."""
MAX_COLUMNS: Final = 6
MAX_CROSSES: Final = 150
_HALF_IN, _HALF_DPI = 7.0, 144  # two of them stand beside each other in the report
_NEVER, _SELDOM = (0.86, 0.92, 0.96, 1.0), (0.88, 0.88, 0.88, 1.0)
_LEAST_SHOWN: Final = 0.04
"""Share of the greatest density below which the floor is left as it is."""


def final_poses_figure(scene: Scene) -> Figure:
    """Density of the places where failed runs ended, blurred with `BLUR_M`."""
    figure, axes = map_figure(scene.occupancy, legend_rows=3, width_in=_HALF_IN, dpi=_HALF_DPI, zones=scene.zones)
    greatest = draw_final_poses(axes, scene)
    _color_bar(figure, axes, greatest, "failed runs that ended here, per m²")
    legend(figure, _crosses(axes, scene))
    return figure


def paths_figure(scene: Scene, judgment: Judgment) -> Figure:
    """The true trajectories of failed or of passed runs, from circle to cross, with the obstacles."""
    zones = zone_handles(scene.zones)
    rows = 2 if zones else 1
    figure, axes = map_figure(scene.occupancy, legend_rows=rows, width_in=_HALF_IN, dpi=_HALF_DPI, zones=scene.zones)
    drawn = min(len(scene.obstacles), MAX_OBSTACLES)
    draw_obstacles(axes, scene.obstacles[:drawn], alpha=0.45 if drawn < 40 else 0.2)
    draw_paths(axes, scene, judgment)
    lines = scene.lines[CODES[judgment]]
    whole = {"pass": scene.runs.passed, "fail": scene.runs.failed, "not judged": scene.runs.not_judged}[judgment]
    label = f"{style.WORDS[judgment]} ({len(lines)}{'' if len(lines) == whole else f' of {whole:,}'})"
    handles: list[Any] = [Line2D([], [], color=style.COLORS[judgment], linewidth=2.5, label=label)]
    if len(lines) <= MAX_CROSSES:
        handles += draw_ends(axes, scene.starts_xy_m, scene.goals_xy_m)
    legend(figure, [*handles, *obstacle_handle(drawn), *zones])
    return figure


def failure_rate_figure(scene: Scene) -> Figure:
    """Draw the failure rate of each cell, fainter if uncertain, outlined if above the map's mean."""
    figure, axes = map_figure(scene.occupancy, legend_rows=3, width_in=_HALF_IN, dpi=_HALF_DPI, zones=scene.zones)
    most = draw_failure_rates(axes, scene)
    _color_bar(figure, axes, most, "share of the runs that came here and failed here", percent=True)
    handles = [
        Patch(facecolor=_NEVER, edgecolor="none", label="nobody failed"),
        Patch(facecolor=_SELDOM, edgecolor="none", label=f"fewer than {MINIMUM_VISITS} visits"),
        Patch(facecolor="none", edgecolor=style.INK, linewidth=1.2, label="above the map's rate (5 % error)"),
    ]
    legend(figure, handles)
    return figure


def all_maps_figure(scenes: Sequence[Scene], titles: Sequence[str]) -> Figure:
    """The paper's figure: a column for each map; final poses of failures, failed paths, passed paths below each other."""
    shown = sorted(range(len(scenes)), key=lambda k: -scenes[k].runs.failed)[:MAX_COLUMNS]
    columns = [scenes[k] for k in sorted(shown)]
    extents_m = [known_extent_m(scene.occupancy, 0.4) for scene in columns]
    aspects = [(y1 - y0) / (x1 - x0) for x0, x1, y0, y1 in extents_m]
    row_in = min(3.2, 14.0 / sum(1 / aspect for aspect in aspects))
    widths = [row_in / aspect for aspect in aspects]
    size_in = (sum(widths) + 0.1 * (len(widths) + 1) + 0.3, 3 * row_in + 0.75)
    figure = Figure(figsize=size_in, dpi=style.DPI)
    left_in = 0.4
    for scene, width_in, k in zip(columns, widths, sorted(shown), strict=True):
        for row in range(3):
            bottom_in = size_in[1] - 0.35 - (row + 1) * row_in - 0.1 * row
            axes = style.place(figure, left_in, bottom_in, width_in, row_in)
            draw_floor(axes, scene.occupancy, scene.zones)
            axes.set(xticks=[], yticks=[])
            if row == 0:
                # On a large map the blur is smaller than a pixel; the rings show where to look.
                (drawn,) = axes.plot(*scene.failed_xy_m.T, "o", ms=4.5, mfc="none", mec=style.INK, mew=0.5, alpha=0.5)
                drawn.set_rasterized(len(scene.failed_xy_m) > MAX_CROSSES)
                draw_final_poses(axes, scene)
                axes.set_title(titles[k], fontsize=10, color=style.INK, pad=5)
            else:
                draw_paths(axes, scene, ("fail", "pass")[row - 1], 0.55)
            if left_in == 0.4:
                axes.set_ylabel(("final poses", "failed", "passed")[row], fontsize=10, color=style.INK, labelpad=4)
        left_in += width_in + 0.1
    return figure


def draw_final_poses(axes: Axes, scene: Scene) -> float:
    """Draw the density over the floor and return its maximum in failed runs per m²."""
    x0, x1, y0, y1 = known_extent_m(scene.occupancy, 0.0)
    grid = grid_over(x0, y0, x1, y1, BLUR_M / 2)
    density = _density(grid, scene.failed_xy_m)
    greatest = float(density.max())
    if greatest > 0:
        share = density / greatest
        picture = matplotlib.colormaps[style.RATES](
            share, alpha=np.clip((share - _LEAST_SHOWN) / 0.12, 0, 0.95), bytes=True
        )
        axes.imshow(picture, origin="lower", extent=grid.extent_m, aspect="auto", interpolation="bilinear")
    return greatest


def draw_paths(axes: Axes, scene: Scene, judgment: Judgment, scale: float = 1.0) -> None:
    """Draw paths from circle to cross, with lines and marks scaled by `scale`."""
    lines = scene.lines[CODES[judgment]]
    draw_lines(axes, lines, style.COLORS[judgment], width=1.3 * scale)
    if lines:
        look: dict[str, Any] = {"linestyle": "none", "alpha": 0.7 if len(lines) <= MAX_CROSSES else 0.35}
        circle: dict[str, Any] = {"ms": 3.2 * scale, "mfc": "white", "mec": style.INK, "mew": 0.7 * scale}
        cross: dict[str, Any] = {"ms": 4.5 * scale, "color": style.INK, "mew": scale}
        for end, mark, size in ((0, "o", circle), (-1, "x", cross)):
            (drawn,) = axes.plot(*np.array([line[end] for line in lines]).T, mark, **size, **look)
            drawn.set_rasterized(len(lines) > MAX_CROSSES)


def draw_failure_rates(axes: Axes, scene: Scene) -> float:
    """Draw the rate of each cell with enough visits and return the rate of the darkest color."""
    found = scene.failures
    rate = found.rate()
    most = float(np.ceil(10 * max(np.nanmax(rate, initial=0.0), 0.1)) / 10)
    low, high = np.moveaxis(found.intervals(), -1, 0)
    known = np.isfinite(rate)
    picture = matplotlib.colormaps[style.RATES](np.nan_to_num(rate) / most)
    picture[..., 3] = np.where(known, np.clip(1.15 - (high - low), 0.25, 0.95), 0.0)
    picture[known & (found.failures == 0)] = _NEVER
    picture[(found.visits > 0) & ~known] = _SELDOM
    extent = found.grid.extent_m
    axes.imshow(picture, origin="lower", extent=extent, aspect="auto", interpolation="nearest")
    _outline(axes, found.hot(), extent)
    return most


def _outline(axes: Axes, cells: NDArray[np.bool_], extent: tuple[float, float, float, float]) -> None:
    padded = np.pad(cells, 1).astype(np.int8)
    x0, x1, y0, y1 = extent
    xs, ys = np.linspace(x0, x1, cells.shape[1] + 1), np.linspace(y0, y1, cells.shape[0] + 1)
    across = np.argwhere(np.diff(padded[1:-1], axis=1))
    along = np.argwhere(np.diff(padded[:, 1:-1], axis=0))
    segments = [np.array([(xs[c], ys[r]), (xs[c], ys[r + 1])]) for r, c in across]
    segments += [np.array([(xs[c], ys[r]), (xs[c + 1], ys[r])]) for r, c in along]
    draw_lines(axes, segments, style.INK, alpha=1.0, width=1.1)


def _density(grid: FailureGrid, xy_m: NDArray[np.float64]) -> NDArray[np.float64]:
    """(H, W) points per m², blurred without compensation at the border."""
    from scipy.ndimage import gaussian_filter  # takes half a second, which a report without maps does without

    cells = grid.cells(xy_m)
    counts = np.bincount(cells[cells >= 0], minlength=grid.shape[0] * grid.shape[1]).reshape(grid.shape)
    return np.asarray(
        gaussian_filter(counts.astype(np.float64), BLUR_M / grid.cell_m, mode="constant") / grid.cell_m**2
    )


def _crosses(axes: Axes, scene: Scene) -> list[Line2D]:
    if len(scene.failed_xy_m) > MAX_CROSSES:
        return []
    handles = []
    kinds = ((True, "x", "mission failed"), (False, "o", "mission succeeded, another oracle failed"))
    for missed, marker, label in kinds:
        chosen = scene.failed_xy_m[scene.missed == missed]
        if len(chosen):
            look: dict[str, Any] = {"marker": marker, "ms": 5.5, "mfc": "none", "mec": style.INK, "mew": 1.2, "ls": ""}
            handles += axes.plot(*chosen.T, label=f"{label} ({len(chosen)})", **look)
    return handles


def _color_bar(figure: Figure, axes: Axes, greatest: float, label: str, *, percent: bool = False) -> None:
    bar = style.place(figure, figure.get_figwidth() - 3.4, 0.42, 3.2, 0.11)
    found = matplotlib.cm.ScalarMappable(Normalize(0, greatest or 1.0), style.RATES)
    drawn = figure.colorbar(found, cax=bar, orientation="horizontal")
    drawn.outline.set_visible(False)
    ticks = np.array([0.0, 0.5, 1.0]) * (greatest or 1.0)
    drawn.set_ticks(list(ticks), labels=[f"{100 * t:.0f} %" if percent else f"{t:.3g}" for t in ticks])
    bar.tick_params(labelsize=7.5, colors=style.SOFT_INK, length=2)
    bar.set_title(label, fontsize=8, color=style.SOFT_INK, pad=3, loc="right")
