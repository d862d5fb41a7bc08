"""Factor figures: failure rates at the levels of factors, and of pairs that act together."""

from collections.abc import Sequence
from typing import Any, Final

import matplotlib
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Rectangle

from vastflow.oracles.figures.style import COLORS, DPI, INK, RATES, SOFT_INK, place, plain_axes
from vastflow.oracles.statistics.effects import FactorEffect
from vastflow.oracles.statistics.interactions import InteractionEffect

MAX_FACTORS: Final = 12
MAX_INTERACTIONS: Final = 4
_COLUMNS: Final = 2
_WIDTH_IN: Final = 10.0
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
    sizes = [(len(_levels(pair, 0)), len(_levels(pair, 1))) for pair in shown]
    columns = min(2, len(shown))
    rows = -(-len(shown) // columns)
    height_in = 0.95 + 0.42 * max(rows_ for rows_, _ in sizes)
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
    for rate, shift in zip(rates, aside, strict=True):
        known = np.isfinite(rate)
        axes.plot(
            (xs + shift)[known], rate[known], "o-", ms=3.5, lw=1, color=SOFT_INK, mfc="white", mew=0.9,
            alpha=max(0.25, min(1.0, 12 / len(rates))), clip_on=False,
        )  # fmt: skip
    color = COLORS["fail"] if factor.matters else INK
    means = [level.failed / max(level.runs, 1) for level in factor.levels]
    axes.plot(xs, means, "D-", ms=7, lw=2.4, color=color, mec="white", mew=0.8, zorder=3, clip_on=False)
    axes.set_title(_cut(factor.name, 48), fontsize=9, color=INK, loc="left", fontweight="bold", pad=9)
    axes.set_xticks(xs, [_cut(level.level, 84 // len(xs)) for level in factor.levels], fontsize=8)
    axes.set_xlim(-0.4, len(xs) - 0.6)
    axes.set_ylim(0, 1)
    axes.set_yticks([0, 0.25, 0.5, 0.75, 1], ["0 %", "", "50 %", "", "100 %"], fontsize=7.5)
    axes.set_ylabel("runs that failed", fontsize=8, color=SOFT_INK)
    plain_axes(axes, "y", pad=6)


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
            look: dict[str, Any] = {"color": "white" if dark else INK, "fontweight": "bold" if unlike else "normal"}
            axes.text(column, row, f"{100 * cell.rate:.0f} %", ha="center", va="center", fontsize=8, **look)
            if unlike:
                frame = (column - 0.47, row - 0.46), 0.94, 0.92
                axes.add_patch(Rectangle(*frame, fill=False, edgecolor=INK, linewidth=1.6))
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
