"""Rate figures: success rates with intervals, and pass rates at other thresholds."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Final, Literal

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from vastflow.oracles.evidence.criteria import Criterion, Score
from vastflow.oracles.evidence.evidence import Evidence
from vastflow.oracles.evidence.rates import Counts, Interval
from vastflow.oracles.figures.style import COLORS, DPI, INK, SOFT_INK, axis_labels, plain_axes

MAX_RATE_ROWS: Final = 60
"""Rows of the rate figure; beyond, it shows only families, and of these the worst."""
_WIDTH_IN: Final = 10.0


def rates_figure(evidence: Mapping[str | None, Evidence]) -> Figure:
    """Draw rates and intervals of campaign, families and few configurations, in a panel for each oracle.

    Bars are Wilson intervals of these configurations, thin black lines those for others of their kind.
    """
    families = _shown_families(evidence[None])
    labels = [label for label, _ in _rate_rows(evidence[None], families)]
    panels = list(evidence)
    height_in = 0.6 + 0.21 * len(labels)
    figure = Figure(figsize=(_WIDTH_IN, height_in), dpi=DPI)
    left = min(0.02 + 0.0075 * max(map(len, labels)), 0.4)
    width = (0.99 - left) / len(panels)
    for i, oracle in enumerate(panels):
        axes = figure.add_axes((left + i * width, 0.3 / height_in, width - 0.025, 1 - 0.6 / height_in))
        title = (oracle or "all oracles").rpartition(":")[2]  # of an oracle in a file the class: panels are narrow
        axes.set_title(title, fontsize=10, color=INK, loc="left", fontweight="bold")
        _draw_rates(axes, [bars for _, bars in _rate_rows(evidence[oracle], families)])
        axes.set_ylim(len(labels) - 0.4, -0.6)
        axes.set_yticks(range(len(labels)) if i == 0 else [], labels if i == 0 else [], fontsize=8)
    for text, (_, bars) in zip(figure.axes[0].get_yticklabels(), _rate_rows(evidence[None], families), strict=True):
        text.set_fontweight("bold" if bars.group else "normal")
    return figure


@dataclass(frozen=True, slots=True)
class _Bars:
    """A row of the rate figure; `others` is the interval for other configurations."""

    counts: Counts
    others: Interval | None
    group: bool


def _shown_families(evidence: Evidence) -> list[str]:
    """Families in their order; only those with most failures if there are many."""
    worst = sorted(evidence.families, key=lambda family: -evidence.families[family].counts.failed)
    shown = {*worst[: MAX_RATE_ROWS - 1]}
    return [family for family in evidence.families if family in shown]


def _rate_rows(evidence: Evidence, families: Sequence[str]) -> Iterator[tuple[str, _Bars]]:
    singles = len(evidence.configurations) + len(evidence.families) < MAX_RATE_ROWS
    yield "whole campaign", _Bars(evidence.campaign.counts, evidence.campaign.clustered, True)
    for family in families:
        group = evidence.families[family]
        yield family, _Bars(group.counts, group.clustered, True)
        if singles:
            for name in group.by_name:
                yield name, _Bars(evidence.configurations[name], None, False)


def _draw_rates(axes: Axes, rows: Sequence[_Bars]) -> None:
    color = COLORS["pass"]
    judged = [(y, row) for y, row in enumerate(rows) if row.counts.rate is not None]
    for group in (False, True):
        at = [y for y, row in judged if row.group == group]
        intervals = [row.counts.interval for _, row in judged if row.group == group]
        low, high = [i.low for i in intervals], [i.high for i in intervals]
        axes.hlines(at, low, high, color=color, linewidth=5.0 if group else 2.6, alpha=0.75 if group else 0.4)
    others = [(y, row.others) for y, row in judged if row.others is not None]
    axes.hlines([y for y, _ in others], [i.low for _, i in others], [i.high for _, i in others], color=INK, linewidth=1)
    for group, marker, fill in ((False, "o", color), (True, "D", INK)):
        points = [(r, y) for y, row in judged if row.group == group and (r := row.counts.rate) is not None]
        axes.plot(
            [rate for rate, _ in points], [y for _, y in points], marker, markersize=5, color=fill,
            markeredgecolor="white", markeredgewidth=0.7,
        )  # fmt: skip
    for y, row in enumerate(rows):
        if row.counts.rate is None:
            text = "not judged" if row.counts.not_judged else "not run"
            axes.text(0.5, y, text, ha="center", va="center", fontsize=7.5, color=SOFT_INK)
    axes.set_xlim(-0.03, 1.03)
    axes.set_xticks([0, 0.25, 0.5, 0.75, 1], ["0", "25", "50", "75", "100 %"], fontsize=8)
    plain_axes(axes, "x")


_SIZE_IN: Final = (5.0, 2.1)


def threshold_figure(criterion: Criterion, score: Score) -> Figure:
    """Draw the pass rate over thresholds, and the oracle's own threshold; in multiples where it differs between runs."""
    figure = Figure(figsize=_SIZE_IN, dpi=DPI)
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
    axis_labels(axes, _axis(score))
    axes.set_xlim(low - room, high + room)
    axes.set_ylim(-0.04, 1.04)
    axes.set_yticks([0, 0.5, 1], ["0", "50", "100 %"])
    plain_axes(axes, labelsize=8)
    return figure


def _axis(score: Score) -> str:
    name = score.metric.replace("_", " ")
    if score.threshold is None:
        return f"{name}, in multiples of the threshold"
    return f"{name} ({score.unit})" if score.unit not in ("", "1") else name
