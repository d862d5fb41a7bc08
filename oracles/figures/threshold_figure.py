"""The threshold figure: which share of runs would pass an oracle, had it another threshold."""

from typing import Final

import numpy as np
from matplotlib.figure import Figure

from vastflow.oracles.evidence.criteria import Criterion, Score
from vastflow.oracles.figures.palette import COLORS, INK, LINE, SOFT_INK

_DPI: Final = 120
_SIZE_IN: Final = (5.0, 2.1)


def threshold_figure(criterion: Criterion, score: Score) -> Figure:
    """Pass rate over thresholds, and a line at the oracle's own; as multiples of it where runs differ in it."""
    figure = Figure(figsize=_SIZE_IN, dpi=_DPI)
    axes = figure.add_axes((0.12, 0.27, 0.84, 0.6))
    values = np.sort(score.slacks)
    shares = np.arange(1, len(values) + 1) / len(values)
    own = 1.0 if score.threshold is None else score.threshold
    low, high = min(values[0], own), max(values[-1], own)
    room = 0.06 * (high - low or abs(high) or 1.0)
    if score.is_margin:
        at, rate = np.r_[low - room, values, high + room], np.r_[1.0, 1.0 - shares + 1 / len(values), 0.0]
        axes.step(at, rate, where="pre", color=COLORS["pass"], linewidth=1.8)
    else:
        at, rate = np.r_[low - room, values, high + room], np.r_[0.0, shares, 1.0]
        axes.step(at, rate, where="post", color=COLORS["pass"], linewidth=1.8)
    axes.axvline(own, color=INK, linewidth=1)
    side, offset = ("right", -4) if own > (low + high) / 2 else ("left", 4)
    axes.annotate("threshold", (own, 0.5), (offset, 0), textcoords="offset points", ha=side, fontsize=8, color=INK)
    axes.set_title(criterion.oracle.rpartition(":")[2], fontsize=10, color=INK, loc="left", fontweight="bold")
    axes.set_xlabel(_axis(score), fontsize=8, color=SOFT_INK)
    axes.set_xlim(low - room, high + room)
    axes.set_ylim(-0.04, 1.04)
    axes.set_yticks([0, 0.5, 1], ["0", "50", "100 %"])
    axes.grid(color=LINE, linewidth=0.8)
    axes.set_axisbelow(True)
    axes.tick_params(length=0, colors=INK, labelsize=8)
    axes.spines[:].set_visible(False)
    return figure


def _axis(score: Score) -> str:
    name = score.metric.replace("_", " ")
    if score.threshold is None:
        return f"{name}, in multiples of the threshold"
    return f"{name} ({score.unit})" if score.unit not in ("", "1") else name
