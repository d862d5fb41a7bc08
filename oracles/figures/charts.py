"""Charts: rates, thresholds, failure rates by factor level, and results of a search."""

from collections.abc import Iterator, Mapping, Sequence
from typing import Any, Final, Literal, NamedTuple

import matplotlib
import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection
from matplotlib.figure import Figure
from matplotlib.patches import Rectangle
from numpy.typing import NDArray

from vastflow.oracles.evidence.causes import Criterion, Score
from vastflow.oracles.evidence.evidence import Evidence
from vastflow.oracles.figures.style import COLORS, DPI, INK, RATES, SOFT_INK, axis_labels, place, plain_axes
from vastflow.oracles.statistics.effects import FactorEffect, InteractionEffect
from vastflow.oracles.statistics.intervals import Counts, Interval
from vastflow.oracles.statistics.looks import Mean

Floats = NDArray[np.float64]
MAX_RATE_ROWS: Final = 60
"""Rows of the rate figure; beyond, it shows only families, and of these the worst."""
_WIDTH_IN: Final = 10.0
_MOST_LABELS: Final = 20
"""Levels of a factor that its axis names; of more, evenly spaced ones."""


def rate_panels(evidence: Mapping[str | None, Evidence]) -> "dict[str | None, list[tuple[str, _Bars]]]":
    """Rates and intervals of campaign, families and few configurations by oracle, for `rates_figure`."""
    groups = evidence[None].families
    worst = {*sorted(groups, key=lambda family: -groups[family].counts.failed)[: MAX_RATE_ROWS - 1]}
    families = [family for family in groups if family in worst]
    return {oracle: list(_rate_rows(of, families)) for oracle, of in evidence.items()}


def rates_figure(panels: "Mapping[str | None, Sequence[tuple[str, _Bars]]]") -> Figure:
    """Draw a panel for each oracle.

    Bars are intervals for these configurations, thin black lines those for others of their kind.
    """
    labels = [label for label, _ in panels[None]]
    height_in = 0.6 + 0.21 * len(labels)
    figure = Figure(figsize=(_WIDTH_IN, height_in), dpi=DPI)
    left = min(0.02 + 0.0075 * max(map(len, labels)), 0.4)
    width = (0.99 - left) / len(panels)
    for i, (oracle, rows) in enumerate(panels.items()):
        axes = figure.add_axes((left + i * width, 0.3 / height_in, width - 0.025, 1 - 0.6 / height_in))
        title = (oracle or "all oracles").rpartition(":")[2]  # of an oracle in a file the class: panels are narrow
        axes.set_title(title, fontsize=10, color=INK, loc="left", fontweight="bold")
        _draw_rates(axes, [bars for _, bars in rows])
        axes.set_ylim(len(labels) - 0.4, -0.6)
        axes.set_yticks(range(len(labels)) if i == 0 else [], labels if i == 0 else [], fontsize=8)
    for text, (_, bars) in zip(figure.axes[0].get_yticklabels(), panels[None], strict=True):
        text.set_fontweight("bold" if bars.group else "normal")
    return figure


class _Bars(NamedTuple):
    """A row of the rate figure; `mean` has the interval for these configurations, `others` is that for others."""

    counts: Counts
    mean: Mean | None
    others: Interval | None
    group: bool


def _rate_rows(evidence: Evidence, families: Sequence[str]) -> Iterator[tuple[str, _Bars]]:
    singles = len(evidence.configurations) + len(evidence.families) < MAX_RATE_ROWS
    yield "whole campaign", _Bars(evidence.campaign.counts, evidence.campaign.mean, evidence.campaign.clustered, True)
    for family in families:
        group = evidence.families[family]
        yield family, _Bars(group.counts, group.mean, group.clustered, True)
        if singles:
            for name in group.by_name:
                yield name, _Bars(group.by_name[name], group.means[name], None, False)


def _draw_rates(axes: Axes, rows: Sequence[_Bars]) -> None:
    color = COLORS["pass"]
    judged = [(y, row, row.mean) for y, row in enumerate(rows) if row.mean is not None]
    for group in (False, True):
        at = [y for y, row, _ in judged if row.group == group]
        intervals = [interval for _, row, (_, interval) in judged if row.group == group]
        low, high = [i.low for i in intervals], [i.high for i in intervals]
        axes.hlines(at, low, high, color=color, linewidth=5.0 if group else 2.6, alpha=0.75 if group else 0.4)
    others = [(y, row.others) for y, row, _ in judged if row.others is not None]
    axes.hlines([y for y, _ in others], [i.low for _, i in others], [i.high for _, i in others], color=INK, linewidth=1)
    for group, marker, fill in ((False, "o", color), (True, "D", INK)):
        points = [(rate, y) for y, row, (rate, _) in judged if row.group == group]
        axes.plot(
            [rate for rate, _ in points], [y for _, y in points], marker, markersize=5, color=fill,
            markeredgecolor="white", markeredgewidth=0.7,
        )  # fmt: skip
    for y, row in enumerate(rows):
        if row.mean is None:
            text = "chosen by the search" if row.counts.judged else "not judged" if row.counts.not_judged else "not run"
            axes.text(0.5, y, text, ha="center", va="center", fontsize=7.5, color=SOFT_INK)
    axes.set_xlim(-0.03, 1.03)
    axes.set_xticks([0, 0.25, 0.5, 0.75, 1], ["0", "25", "50", "75", "100 %"], fontsize=8)
    plain_axes(axes, "x")


_THRESHOLD_IN: Final = (5.0, 2.1)


def threshold_figure(criterion: Criterion, score: Score) -> Figure:
    """Draw the pass rate over thresholds, and the oracle's own threshold; in multiples where it differs between runs."""
    figure = Figure(figsize=_THRESHOLD_IN, dpi=DPI)
    axes = figure.add_axes((0.12, 0.27, 0.84, 0.6))
    values = np.sort(score.slacks)
    shares = np.arange(1, len(values) + 1) / len(values)
    own = 1.0 if score.threshold is None else score.threshold
    low, high = min(values[0], own), max(values[-1], own)
    room = 0.06 * (high - low or abs(high) or 1.0)
    rate = np.r_[1.0, 1.0 - shares + 1 / len(values), 0.0] if score.is_margin else np.r_[0.0, shares, 1.0]
    side: Literal["pre", "post"] = "pre" if score.is_margin else "post"
    axes.step(np.r_[low - room, values, high + room], rate, where=side, color=COLORS["pass"], linewidth=1.8)
    axes.axvline(own, color=INK, linewidth=1)
    aligned, offset = ("right", -4) if own > (low + high) / 2 else ("left", 4)
    axes.annotate("threshold", (own, 0.5), (offset, 0), textcoords="offset points", ha=aligned, fontsize=8, color=INK)
    axes.set_title(criterion.oracle.rpartition(":")[2], fontsize=10, color=INK, loc="left", fontweight="bold")
    unit = f" ({score.unit})" if score.unit not in ("", "1") else ""
    unit = ", in multiples of the threshold" if score.threshold is None else unit
    axis_labels(axes, score.metric.replace("_", " ") + unit)
    axes.set_xlim(low - room, high + room)
    axes.set_ylim(-0.04, 1.04)
    axes.set_yticks([0, 0.5, 1], ["0", "50", "100 %"])
    plain_axes(axes, labelsize=8)
    return figure


MAX_FACTORS: Final = 12
MAX_INTERACTIONS: Final = 4
_COLUMNS: Final = 2
_PANEL_IN: Final = (5.0, 2.1)
_ASIDE: Final = 0.09
"""Largest shift of lines beside a level."""


def factor_figure(factors: Sequence[FactorEffect]) -> Figure:
    """Draw a panel for each factor: failure rates of situations at each level, and their mean."""
    shown = factors[:MAX_FACTORS]
    columns = min(_COLUMNS, len(shown))
    rows = -(-len(shown) // columns)
    figure = Figure(figsize=(columns * _PANEL_IN[0], rows * _PANEL_IN[1]), dpi=DPI, layout="constrained")
    for factor, axes in zip(shown, figure.subplots(rows, columns, squeeze=False).flat, strict=False):
        _draw_factor(axes, factor)
    for axes in figure.axes[len(shown) :]:
        axes.set_axis_off()
    return figure


def interaction_figure(interactions: Sequence[InteractionEffect]) -> Figure:
    """Draw a panel for each pair: failure rates of its cells, framed where effects do not add up."""
    shown = interactions[:MAX_INTERACTIONS]
    columns = min(_COLUMNS, len(shown))
    rows = -(-len(shown) // columns)
    height_in = 0.95 + 0.42 * max(len(_levels(pair, 0)) for pair in shown)
    figure = Figure(figsize=(_WIDTH_IN, rows * height_in), dpi=DPI)
    for k, pair in enumerate(shown):
        left_in, bottom_in = 1.1 + (k % columns) * _WIDTH_IN / columns, (rows - 1 - k // columns) * height_in + 0.5
        width_in = _WIDTH_IN / columns - 1.4
        _draw_interaction(place(figure, left_in, bottom_in, width_in, height_in - 0.9), pair, -0.9 / width_in)
    return figure


def _draw_factor(axes: Axes, factor: FactorEffect) -> None:
    rates = np.array(factor.rates, dtype=np.float64).reshape(-1, len(factor.levels))
    xs = np.arange(len(factor.levels))
    # Lines that coincide stand beside each other.
    aside = np.linspace(-_ASIDE, _ASIDE, len(rates)) if len(rates) > 1 else np.zeros(len(rates))
    lines = [np.column_stack([xs + shift, rate])[np.isfinite(rate)] for rate, shift in zip(rates, aside, strict=True)]
    alpha = max(0.25, min(1.0, 12 / max(len(rates), 1)))
    axes.add_collection(LineCollection(lines, colors=SOFT_INK, linewidths=1, alpha=alpha, clip_on=False))
    axes.plot(
        *np.concatenate([np.empty((0, 2)), *lines]).T, "o", ms=3.5, color=SOFT_INK, mfc="white", mew=0.9, alpha=alpha,
        clip_on=False,
    )  # fmt: skip
    color = COLORS["fail"] if factor.matters else INK
    means = [level.failed / level.runs if level.runs else np.nan for level in factor.levels]
    axes.plot(xs, means, "D-", ms=7, lw=2.4, color=color, mec="white", mew=0.8, zorder=3, clip_on=False)
    axes.set_title(_cut(factor.name, 48), fontsize=9, color=INK, loc="left", fontweight="bold", pad=9)
    ticks = xs[:: -(-len(xs) // _MOST_LABELS)]
    axes.set_xticks(ticks, [_cut(factor.levels[x].level, 84 // len(ticks)) for x in ticks], fontsize=8)
    axes.set_xlim(-0.4, len(xs) - 0.6)
    axes.set_ylim(0, 1)
    axes.set_yticks([0, 0.25, 0.5, 0.75, 1], ["0 %", "", "50 %", "", "100 %"], fontsize=7.5)
    axes.set_ylabel("runs that failed", fontsize=8, color=SOFT_INK)
    plain_axes(axes, "y", pad=6)


def _draw_interaction(axes: Axes, pair: InteractionEffect, title_x: float) -> None:
    down, across = _levels(pair, 0), _levels(pair, 1)
    grid = np.full((len(down), len(across)), np.nan)
    for cell in pair.cells:
        grid[down.index(cell.levels[0]), across.index(cell.levels[1])] = cell.rate
    axes.imshow(grid, cmap=matplotlib.colormaps[RATES], vmin=0, vmax=1, aspect="auto")
    for cell in pair.cells:
        row, column = down.index(cell.levels[0]), across.index(cell.levels[1])
        unlike = not cell.interval.low <= cell.expected <= cell.interval.high
        look: dict[str, Any] = {"color": "white" if cell.rate > 0.45 else INK}
        look["fontweight"] = "bold" if unlike else "normal"
        axes.text(column, row, f"{100 * cell.rate:.0f} %", ha="center", va="center", fontsize=8, **look)
        if unlike:
            axes.add_patch(Rectangle((column - 0.47, row - 0.46), 0.94, 0.92, fill=False, edgecolor=INK, linewidth=1.6))
    axes.set_xticks(range(len(across)), [_cut(level, 12) for level in across], fontsize=8)
    axes.set_yticks(range(len(down)), [_cut(level, 12) for level in down], fontsize=8)
    axes.set_title(
        f"{_cut(pair.names[0], 34)} ↓  ×  {_cut(pair.names[1], 34)} →", fontsize=8.5, color=INK, loc="left", x=title_x
    )
    plain_axes(axes, None)


def _levels(pair: InteractionEffect, side: int) -> list[str]:
    """Levels in the order of the analysis; numbers by size, since missing cells upset it."""
    levels = list(dict.fromkeys(cell.levels[side] for cell in pair.cells))
    try:
        return sorted(levels, key=float)
    except ValueError:
        return levels


def _cut(text: str, most: int) -> str:
    return text if len(text) <= most else f"…{text[1 - most :]}"


_SEARCH_IN: Final = (6.0, 3.2)


def progress_figure(
    rows: Sequence[Mapping[str, Any]], objective: str, direction: str, beside: Sequence[Mapping[str, Any]] = ()
) -> Figure:
    """Objective of each judged point over the runs spent by then, and the best so far.

    Args:
        rows: Rows of `evaluations.parquet`.
        beside: Rows of `baseline.parquet`, of which only the best so far is drawn.
    """
    figure, axes = _axes()
    runs, values, best = _grown(rows, direction)
    axes.plot(runs, values, "o", color=SOFT_INK, markersize=3, alpha=0.6)
    axes.step(runs, best, where="post", color=COLORS["fail"], linewidth=1.8)
    if beside:
        runs, _, best = _grown(beside, direction)
        axes.step(runs, best, "--", where="post", color=INK, linewidth=1.2)
    axis_labels(axes, "runs", objective)
    return figure


def _grown(rows: Sequence[Mapping[str, Any]], direction: str) -> tuple[Floats, Floats, Floats]:
    runs = np.cumsum([row["runs"] for row in rows])
    judged = np.array([row["objective"] is not None for row in rows])
    values = np.array([row["objective"] for row in rows if row["objective"] is not None], dtype=np.float64)
    best = (np.maximum if direction == "maximize" else np.minimum).accumulate(values)
    return runs[judged].astype(np.float64), values, best


def archive_figure(
    cells: Mapping[tuple[int, int], float], measures: Mapping[str, tuple[float, float, int]], objective: str
) -> Figure:
    """The objective of the best point in each cell, by place, of a grid of two measures: low, high, bins."""
    figure, axes = _axes()
    (x_low, x_high, x_bins), (y_low, y_high, y_bins) = measures.values()
    grid = np.full((y_bins, x_bins), np.nan)
    for (x, y), value in cells.items():
        grid[y, x] = value
    look: dict[str, Any] = {"aspect": "auto", "cmap": "YlOrRd", "interpolation": "nearest"}
    drawn = axes.imshow(grid, origin="lower", extent=(x_low, x_high, y_low, y_high), **look)
    bar = figure.colorbar(drawn, ax=axes, fraction=0.05)
    bar.set_label(objective, fontsize=8, color=SOFT_INK)
    bar.ax.tick_params(length=0, labelsize=8)
    axis_labels(axes, *measures)
    axes.grid(visible=False)
    return figure


def boundary_figure(rows: Sequence[Mapping[str, Any]], names: Sequence[str], level: float, objective: str) -> Figure:
    """Draw the expected objective over one dimension, or the level's contour over two, with its uncertainty.

    Args:
        rows: Rows of `boundary.parquet`, each with its decoded `point`.
    """
    figure, axes = _axes()
    x = np.array([row["point"][names[0]] for row in rows])
    low, expected, high = (np.array([row[key] for row in rows]) for key in ("low", "expected", "high"))
    axis_labels(axes, names[0], objective if len(names) == 1 else names[1])
    if len(names) == 1:
        axes.fill_between(x, low, high, color=COLORS["fail"], alpha=0.2, linewidth=0)
        axes.plot(x, expected, color=COLORS["fail"], linewidth=1.8)
        axes.axhline(level, color=INK, linewidth=1)
        return figure
    y = np.array([row["point"][names[1]] for row in rows])
    side = round(len(rows) ** 0.5)
    uncertain = ((low < level) & (high > level)).astype(float)
    x, y, uncertain, expected = (each.reshape(side, side) for each in (x, y, uncertain, expected))
    axes.contourf(x, y, uncertain, levels=[0.5, 1.5], colors=[COLORS["fail"]], alpha=0.2)
    axes.contour(x, y, expected, levels=[level], colors=[COLORS["fail"]], linewidths=1.8)
    return figure


def _axes() -> tuple[Figure, Axes]:
    figure = Figure(figsize=_SEARCH_IN, dpi=DPI, layout="constrained")
    axes = figure.add_subplot()
    plain_axes(axes, labelsize=8)
    return figure, axes
