"""Figures: maps with what happened on them, and success rates with their intervals.

Colours are those of Okabe and Ito, told apart by people with any common colour blindness, and every judgement has
a shape or an order of its own beside its colour.
"""

import io
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection, PolyCollection
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch
from numpy.typing import NDArray

from vastflow.oracles.evidence import Evidence
from vastflow.oracles.rates import Counts, Interval
from vastflow.oracles.scene import Scene
from vastflow.oracles.verdict import Judgement
from vastflow.sim.maps import UNKNOWN, OccupancyMap
from vastflow.sim.obstacle import Obstacle

COLOURS: Final[Mapping[Judgement, str]] = {"pass": "#0072B2", "fail": "#D55E00", "not judged": "#8A8A8A"}
OBSTACLE_COLOUR: Final = "#CC79A7"
OBSTACLE_EDGE: Final = "#8F4A72"
GOAL_COLOUR: Final = "#009E73"
INK: Final = "#22262B"
_WORDS: Final[Mapping[Judgement, str]] = {"pass": "passed", "fail": "failed", "not judged": "not judged"}
_WALL, _UNKNOWN, _FREE = (58, 63, 71), (226, 229, 232), (255, 255, 255)
_DPI: Final = 120
_WIDTH_IN: Final = 10.0
_HEIGHT_IN: Final = 9.0
_MARGIN_M: Final = 0.4
MAX_RATE_ROWS: Final = 60
"""Rows of the rate figure; with more configurations it shows families alone."""


def trajectories_figure(scene: Scene) -> Figure:
    """The environment with its trajectories coloured by judgement, failures on top, and where missions failed."""
    figure, axes = map_figure(scene.occupancy, legend_rows=2)
    draw_obstacles(axes, scene.obstacles, alpha=0.45)
    handles: list[Any] = []
    for judgement in ("pass", "not judged", "fail"):
        paths = [t.xy_m for t in scene.trajectories if t.judgement == judgement]
        if paths:
            _draw_paths(axes, paths, COLOURS[judgement])
            label = _shown(_WORDS[judgement], len(paths), _count(scene.runs, judgement))
            handles.append(Line2D([], [], color=COLOURS[judgement], linewidth=2.5, label=label))
    handles += draw_ends(axes, scene.starts_xy_m, scene.goals_xy_m)
    missed = sum(final.mission_failed for final in scene.failed)
    if missed:
        handles.append(_draw_failed(axes, scene, f"mission failed here ({missed})", mission_failed=True))
    handles += _obstacle_handle(scene)
    legend(figure, handles)
    return figure


def failures_figure(scene: Scene) -> Figure:
    """The environment with the final positions of failed runs alone, and the ways that led there, faint."""
    figure, axes = map_figure(scene.occupancy, legend_rows=1)
    draw_obstacles(axes, scene.obstacles, alpha=0.3)
    _draw_paths(axes, [t.xy_m for t in scene.trajectories if t.judgement == "fail"], COLOURS["fail"], opacity=0.35)
    missed = sum(final.mission_failed for final in scene.failed)
    handles: list[Any] = []
    if other := len(scene.failed) - missed:
        label = f"mission succeeded, another oracle failed ({other})"
        handles.append(_draw_failed(axes, scene, label, mission_failed=False))
    if missed:
        handles.insert(0, _draw_failed(axes, scene, f"mission failed ({missed})", mission_failed=True))
    legend(figure, [*handles, *_obstacle_handle(scene)])
    return figure


def rates_figure(evidence: Mapping[str | None, Evidence]) -> Figure:
    """Success rate and 95 % interval of the campaign, each family and, where they are few, each configuration.

    One panel for all oracles together and, where there are several, one for each. Bars are Wilson intervals of
    these configurations, thin black lines those for other configurations of the kind.
    """
    labels = [label for label, _ in _rate_rows(next(iter(evidence.values())))]
    panels = list(evidence) if len(evidence) > 2 else [None]
    height_in = 0.6 + 0.21 * len(labels)
    figure = Figure(figsize=(_WIDTH_IN, height_in), dpi=_DPI)
    left = min(0.02 + 0.0075 * max(map(len, labels)), 0.4)
    width = (0.99 - left) / len(panels)
    for i, oracle in enumerate(panels):
        axes = figure.add_axes((left + i * width, 0.3 / height_in, width - 0.025, 1 - 0.6 / height_in))
        title = (oracle or "all oracles").rpartition(":")[2]  # of an oracle in a file the class: panels are narrow
        axes.set_title(title, fontsize=10, color=INK, loc="left", fontweight="bold")
        _draw_rates(axes, [bars for _, bars in _rate_rows(evidence[oracle])])
        axes.set_ylim(len(labels) - 0.4, -0.6)
        axes.set_yticks(range(len(labels)) if i == 0 else [], labels if i == 0 else [], fontsize=8)
    for text, (_, bars) in zip(figure.axes[0].get_yticklabels(), _rate_rows(evidence[None]), strict=True):
        text.set_fontweight("bold" if bars.group else "normal")
    return figure


def png(figure: Figure) -> bytes:
    """`figure` as a picture; the same figure gives the same bytes."""
    out = io.BytesIO()
    figure.savefig(out, format="png", metadata={"Software": None})
    return out.getvalue()


@dataclass(frozen=True, slots=True)
class _Bars:
    """A row of the rate figure: counts, the interval for other configurations, whether it is a group."""

    counts: Counts
    others: Interval | None
    group: bool


def _rate_rows(evidence: Evidence) -> Iterator[tuple[str, _Bars]]:
    singles = len(evidence.configurations) + len(evidence.families) < MAX_RATE_ROWS
    yield "whole campaign", _Bars(evidence.campaign.counts, evidence.campaign.clustered, True)
    for family, group in evidence.families.items():
        yield family, _Bars(group.counts, group.clustered, True)
        if singles:
            for name in evidence.members[family]:
                yield name, _Bars(evidence.configurations[name], None, False)


def _draw_rates(axes: Axes, rows: Sequence[_Bars]) -> None:
    colour = COLOURS["pass"]
    judged = [(y, row) for y, row in enumerate(rows) if row.counts.rate is not None]
    for group in (False, True):
        at = [y for y, row in judged if row.group == group]
        intervals = [row.counts.interval for _, row in judged if row.group == group]
        low, high = [i.low for i in intervals], [i.high for i in intervals]
        axes.hlines(at, low, high, color=colour, linewidth=5.0 if group else 2.6, alpha=0.75 if group else 0.4)
    others = [(y, row.others) for y, row in judged if row.others is not None]
    axes.hlines([y for y, _ in others], [i.low for _, i in others], [i.high for _, i in others], color=INK, linewidth=1)
    for group, marker, fill in ((False, "o", colour), (True, "D", INK)):
        points = [(r, y) for y, row in judged if row.group == group and (r := row.counts.rate) is not None]
        axes.plot(
            [rate for rate, _ in points], [y for _, y in points], marker, markersize=5, color=fill,
            markeredgecolor="white", markeredgewidth=0.7,
        )  # fmt: skip
    for y, row in enumerate(rows):
        if row.counts.rate is None:
            text = "not judged" if row.counts.not_judged else "not run"
            axes.text(0.5, y, text, ha="center", va="center", fontsize=7.5, color="#6B7280")
    axes.set_xlim(-0.03, 1.03)
    axes.set_xticks([0, 0.25, 0.5, 0.75, 1], ["0", "25", "50", "75", "100 %"], fontsize=8)
    axes.grid(axis="x", color="#E2E5E8", linewidth=0.8)
    axes.set_axisbelow(True)
    axes.tick_params(length=0, colors=INK)
    axes.spines[:].set_visible(False)


def map_figure(occupancy: OccupancyMap, legend_rows: int, top_in: float = 0.1) -> tuple[Figure, Axes]:
    """A figure that fits what is known of the map, with room for axis labels and a legend below, and `top_in` above."""
    x0, x1, y0, y1 = _known_extent_m(occupancy)
    left_in, right_in, bottom_in = 0.55, 0.1, 0.5 + 0.24 * legend_rows
    scale = min((_WIDTH_IN - left_in - right_in) / (x1 - x0), _HEIGHT_IN / (y1 - y0))
    map_width_in, map_height_in = scale * (x1 - x0), scale * (y1 - y0)
    # A tall map leaves room at its sides, so that the legend below always has the whole width.
    left_in += (_WIDTH_IN - left_in - right_in - map_width_in) / 2
    height_in = top_in + map_height_in + bottom_in
    figure = Figure(figsize=(_WIDTH_IN, height_in), dpi=_DPI)
    axes = figure.add_axes(
        (left_in / _WIDTH_IN, bottom_in / height_in, map_width_in / _WIDTH_IN, map_height_in / height_in)
    )
    rows, columns = occupancy.shape
    left, bottom = occupancy.origin_xy_m
    extent = (left, left + columns * occupancy.resolution_m, bottom, bottom + rows * occupancy.resolution_m)
    axes.imshow(_picture(occupancy), origin="lower", extent=extent, aspect="auto")
    axes.set_xlim(x0, x1)
    axes.set_ylim(y0, y1)
    axes.set_facecolor("#E2E5E8")  # as unknown cells
    axes.tick_params(labelsize=8, colors="#6B7280", length=2)
    axes.spines[:].set_visible(False)
    axes.set_xlabel("x (m)", fontsize=8, color="#6B7280", labelpad=1)
    axes.set_ylabel("y (m)", fontsize=8, color="#6B7280", labelpad=1)
    return figure, axes


def _picture(occupancy: OccupancyMap) -> NDArray[np.uint8]:
    picture = np.empty((*occupancy.shape, 3), dtype=np.uint8)
    picture[:] = _WALL  # everything a robot can't be sure to drive on, but for unknown cells
    picture[occupancy.cells == UNKNOWN] = _UNKNOWN
    picture[occupancy.free] = _FREE
    return picture


def _known_extent_m(occupancy: OccupancyMap) -> tuple[float, float, float, float]:
    """x0, x1, y0, y1 of what is known of the map, with a margin."""
    known = occupancy.cells != UNKNOWN
    rows, columns = np.flatnonzero(known.any(axis=1)), np.flatnonzero(known.any(axis=0))
    if not rows.size:
        rows, columns = np.array([0, known.shape[0] - 1]), np.array([0, known.shape[1] - 1])
    x, y = occupancy.origin_xy_m
    resolution_m = occupancy.resolution_m
    return (
        x + columns[0] * resolution_m - _MARGIN_M,
        x + (columns[-1] + 1) * resolution_m + _MARGIN_M,
        y + rows[0] * resolution_m - _MARGIN_M,
        y + (rows[-1] + 1) * resolution_m + _MARGIN_M,
    )


def _draw_paths(axes: Axes, paths: Sequence[NDArray[np.float64]], colour: str, opacity: float | None = None) -> None:
    """Lines the fainter the more there are, so that what many share stands out."""
    alpha = opacity or float(np.clip(4 / max(len(paths), 1) ** 0.5, 0.25, 0.8))
    lines = LineCollection(paths, colors=colour, linewidths=1.5, alpha=alpha, capstyle="round")
    axes.add_collection(lines, autolim=False)


def draw_ends(axes: Axes, starts_xy_m: NDArray[np.float64], goals_xy_m: NDArray[np.float64]) -> list[Line2D]:
    """Mark starts (n, 2) and goals (m, 2); gives what the marks mean."""
    alone: dict[str, Any] = {"linestyle": "none"}
    start = {**alone, "marker": "o", "markersize": 6.5, "color": "white", "markeredgecolor": INK}
    goal = {**alone, "marker": "D", "markersize": 7.5, "color": GOAL_COLOUR, "markeredgecolor": "white"}
    axes.plot(*starts_xy_m.T, **start)
    axes.plot(*goals_xy_m.T, **goal)
    return [Line2D([], [], label="start", **start), Line2D([], [], label="goal", **goal)]


def _draw_failed(axes: Axes, scene: Scene, label: str, *, mission_failed: bool) -> Line2D:
    """Crosses for missions that failed, or rings for runs that another oracle failed."""
    chosen = [final for final in scene.failed if final.mission_failed == mission_failed]
    look: dict[str, Any] = {
        "marker": "X" if mission_failed else "o",
        "markersize": 8.5,
        "markerfacecolor": COLOURS["fail"] if mission_failed else "none",
        "markeredgecolor": "white" if mission_failed else COLOURS["fail"],
        "markeredgewidth": 1.0 if mission_failed else 1.6,
        "linestyle": "none",
    }
    axes.plot([f.x_m for f in chosen], [f.y_m for f in chosen], zorder=5, **look)
    return Line2D([], [], label=label, **look)


def draw_obstacles(axes: Axes, obstacles: Sequence[Obstacle], *, alpha: float) -> None:
    """Fill the outlines of `obstacles`."""
    outlines = [np.asarray(obstacle.footprint().exterior.coords) for obstacle in obstacles]
    axes.add_collection(
        PolyCollection(outlines, facecolors=OBSTACLE_COLOUR, edgecolors=OBSTACLE_EDGE, linewidths=0.8, alpha=alpha),
        autolim=False,
    )


def _obstacle_handle(scene: Scene) -> list[Patch]:
    if not scene.obstacles:
        return []
    label = f"obstacle, not on the robot's map ({len(scene.obstacles)})"
    return [Patch(facecolor=OBSTACLE_COLOUR, edgecolor=OBSTACLE_EDGE, alpha=0.7, label=label)]


def legend(figure: Figure, handles: Sequence[Any]) -> None:
    """Say below the axes what the marks mean."""
    figure.legend(handles=list(handles), loc="lower center", ncols=min(len(handles), 4), frameon=False, fontsize=9,
                  labelcolor=INK, handletextpad=0.5, columnspacing=1.6, borderpad=0.2)  # fmt: skip


def _shown(word: str, drawn: int, all_of_them: int) -> str:
    return f"{word} ({drawn})" if drawn == all_of_them else f"{word} ({drawn} of {all_of_them})"


def _count(counts: Counts, judgement: Judgement) -> int:
    return {"pass": counts.passed, "fail": counts.failed, "not judged": counts.not_judged}[judgement]
