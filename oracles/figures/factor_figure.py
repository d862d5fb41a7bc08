"""The factor figure: the failure rate at each level of each factor, and of pairs that act together."""

from collections.abc import Sequence
from typing import Final

import matplotlib
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from vastflow.oracles.figures.palette import COLORS, INK, LINE, RATES, SOFT_INK
from vastflow.oracles.statistics.effects import FactorEffect
from vastflow.oracles.statistics.interactions import InteractionEffect

MAX_FACTORS: Final = 12
MAX_INTERACTIONS: Final = 4
_COLUMNS: Final = 2
_WIDTH_IN: Final = 10.0
_DPI: Final = 120
_ROW_IN: Final = 0.26


def factor_figure(factors: Sequence[FactorEffect]) -> Figure:
    """A panel for each factor, the strongest first: adjusted failure rates with their intervals, plain rates as rings."""
    shown = factors[:MAX_FACTORS]
    places, whole_in = _packed([0.85 + _ROW_IN * len(factor.levels) for factor in shown])
    figure = Figure(figsize=(_WIDTH_IN, whole_in), dpi=_DPI)
    highest = max((level.interval.high for factor in shown for level in factor.levels), default=1.0)
    width_in = _WIDTH_IN / _COLUMNS - 1.95
    for factor, (column, top_in) in zip(shown, places, strict=True):
        inner_in = _ROW_IN * len(factor.levels)
        bottom_in = whole_in - top_in - 0.35 - inner_in
        left_in = 0.15 + column * _WIDTH_IN / _COLUMNS + 1.55
        axes = figure.add_axes((left_in / _WIDTH_IN, bottom_in / whole_in, width_in / _WIDTH_IN, inner_in / whole_in))
        _draw_factor(axes, factor, min(1.0, highest * 1.04 + 0.01))
    return figure


def interaction_figure(interactions: Sequence[InteractionEffect]) -> Figure:
    """A panel for each pair: the failure rate in each of its cells, framed where it is not what both effects add up to."""
    shown = interactions[:MAX_INTERACTIONS]
    sizes = [(len(_levels(pair, 0)), len(_levels(pair, 1))) for pair in shown]
    columns = min(2, len(shown))
    rows = -(-len(shown) // columns)
    height_in = 0.95 + 0.42 * max(rows_ for rows_, _ in sizes)
    figure = Figure(figsize=(_WIDTH_IN, rows * height_in), dpi=_DPI)
    for k, pair in enumerate(shown):
        left_in = 1.1 + (k % columns) * _WIDTH_IN / columns
        bottom_in = (rows - 1 - k // columns) * height_in + 0.5
        inner_in = height_in - 0.9
        width_in = _WIDTH_IN / columns - 1.4
        box = (left_in / _WIDTH_IN, bottom_in / (rows * height_in), width_in / _WIDTH_IN, inner_in / (rows * height_in))
        _draw_interaction(figure.add_axes(box), pair, -0.9 / width_in)
    return figure


def _packed(heights_in: Sequence[float]) -> tuple[list[tuple[int, float]], float]:
    """Column and upper end of each panel, one after the other in the column that has most room; and the height of all."""
    used_in = [0.0] * _COLUMNS
    places = []
    for height_in in heights_in:
        column = int(np.argmin(used_in))
        places.append((column, used_in[column]))
        used_in[column] += height_in
    return places, max(used_in)


def _draw_factor(axes: Axes, factor: FactorEffect, most: float) -> None:
    ys = np.arange(len(factor.levels))
    color = COLORS["fail"] if factor.significant else COLORS["not judged"]
    axes.hlines(
        ys, [level.interval.low for level in factor.levels], [level.interval.high for level in factor.levels],
        color=color, linewidth=4.5, alpha=0.45,
    )  # fmt: skip
    axes.plot(
        [level.rate for level in factor.levels], ys, "o", ms=6.5, mfc="none", mec=SOFT_INK, mew=0.9, clip_on=False
    )
    axes.plot(
        [level.adjusted for level in factor.levels], ys, "D", ms=4.5, color=INK, mec="white", mew=0.6, clip_on=False
    )
    axes.set_title(_cut(factor.name, 52), fontsize=9, color=INK, loc="left", fontweight="bold", x=-0.5, pad=6)
    axes.set_yticks(ys, [f"{_cut(level.level, 26)}" for level in factor.levels], fontsize=8)
    axes.set_ylim(len(ys) - 0.45, -0.55)
    axes.set_xlim(0, most)
    ticks = [tick for tick in axes.get_xticks() if 0 <= tick <= most][::2]
    axes.set_xticks(ticks, [f"{100 * tick:.0f} %" for tick in ticks], fontsize=7.5)
    axes.grid(axis="x", color=LINE, linewidth=0.8)
    axes.set_axisbelow(True)
    axes.tick_params(length=0, colors=INK)
    axes.spines[:].set_visible(False)


def _draw_interaction(axes: Axes, pair: InteractionEffect, title_x: float) -> None:
    down, across = _levels(pair, 0), _levels(pair, 1)
    grid = np.full((len(down), len(across)), np.nan)
    for cell in pair.cells:
        if cell.configurations:
            grid[down.index(cell.levels[0]), across.index(cell.levels[1])] = cell.rate
    axes.imshow(grid, cmap=matplotlib.colormaps[RATES], vmin=0, vmax=1, aspect="auto")
    for cell in pair.cells:
        row, column = down.index(cell.levels[0]), across.index(cell.levels[1])
        if cell.configurations:
            dark = cell.rate > 0.45
            unlike = not cell.interval.low <= cell.expected <= cell.interval.high
            axes.text(
                column, row, f"{100 * cell.rate:.0f} %", ha="center", va="center", fontsize=8,
                color="white" if dark else INK, fontweight="bold" if unlike else "normal",
            )  # fmt: skip
            if unlike:
                axes.add_patch(_frame(column, row))
    axes.set_xticks(range(len(across)), [_cut(level, 12) for level in across], fontsize=8)
    axes.set_yticks(range(len(down)), [_cut(level, 12) for level in down], fontsize=8)
    axes.set_title(
        f"{_cut(pair.names[0], 34)} ↓  ×  {_cut(pair.names[1], 34)} →", fontsize=8.5, color=INK, loc="left", x=title_x
    )
    axes.tick_params(length=0, colors=INK)
    axes.spines[:].set_visible(False)


def _frame(column: int, row: int) -> matplotlib.patches.Rectangle:
    return matplotlib.patches.Rectangle(
        (column - 0.47, row - 0.46), 0.94, 0.92, fill=False, edgecolor=INK, linewidth=1.6
    )


def _levels(pair: InteractionEffect, side: int) -> list[str]:
    """In the order of the analysis; numbers by their size, which cells that are missing would upset."""
    levels = list(dict.fromkeys(cell.levels[side] for cell in pair.cells))
    try:
        return sorted(levels, key=float)
    except ValueError:
        return levels


def _cut(text: str, most: int) -> str:
    return text if len(text) <= most else f"…{text[1 - most :]}"
