"""Figures of a search: its progress, its archive, and the boundary that it found."""

from collections.abc import Mapping, Sequence
from typing import Any, Final, TypeAlias

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray

from vastflow.oracles.figures.style import COLORS, DPI, INK, SOFT_INK, axis_labels, plain_axes

Floats: TypeAlias = NDArray[np.float64]

_SIZE_IN: Final = (6.0, 3.2)


def progress_figure(
    rows: Sequence[Mapping[str, Any]], objective: str, direction: str, beside: Sequence[Mapping[str, Any]] = ()
) -> Figure:
    """Objective of each judged point over the runs spent by then, and the best so far.

    Args:
        rows: Of `evaluations.parquet`.
        beside: Of `baseline.parquet`, of which only the best so far is drawn.
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
    """Runs spent, objective, and best so far, for each judged point."""
    runs = np.cumsum([row["runs"] for row in rows])
    judged = np.array([row["objective"] is not None for row in rows])
    values = np.array([row["objective"] for row in rows if row["objective"] is not None], dtype=np.float64)
    best = (np.maximum if direction == "maximize" else np.minimum).accumulate(values)
    return runs[judged].astype(np.float64), values, best


def archive_figure(
    cells: Mapping[tuple[int, int], float],
    names: Sequence[str],
    ranges: Sequence[tuple[float, float, int]],
    objective: str,
) -> Figure:
    """The objective of the best point in each cell of a grid of two measures.

    Args:
        cells: Place along both measures to objective.
        ranges: Of each measure: low, high, bins.
    """
    figure, axes = _axes()
    (x_low, x_high, x_bins), (y_low, y_high, y_bins) = ranges
    grid = np.full((y_bins, x_bins), np.nan)
    for (x, y), value in cells.items():
        grid[y, x] = value
    look: dict[str, Any] = {"aspect": "auto", "cmap": "YlOrRd", "interpolation": "nearest"}
    drawn = axes.imshow(grid, origin="lower", extent=(x_low, x_high, y_low, y_high), **look)
    bar = figure.colorbar(drawn, ax=axes, fraction=0.05)
    bar.set_label(objective, fontsize=8, color=SOFT_INK)
    bar.ax.tick_params(length=0, labelsize=8)
    axis_labels(axes, names[0], names[1])
    axes.grid(visible=False)
    return figure


def boundary_figure(rows: Sequence[Mapping[str, Any]], names: Sequence[str], level: float, objective: str) -> Figure:
    """Draw the expected objective over one dimension, or the level's contour over two, with its uncertainty.

    Args:
        rows: Of `boundary.parquet`, each with its decoded `point`.
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
    figure = Figure(figsize=_SIZE_IN, dpi=DPI, layout="constrained")
    axes = figure.add_subplot()
    plain_axes(axes, labelsize=8)
    return figure, axes
