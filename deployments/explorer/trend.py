"""The success rate over campaigns of one name, as a drawing."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

from vastflow.deployments.explorer.directories import CampaignDirectory
from vastflow.oracles.statistics.intervals import Counts

MOST_CAMPAIGNS: Final = 30
"""Campaigns in a drawing, the newest."""
WIDTH_PX: Final = 260
HEIGHT_PX: Final = 64
_LEFT_PX: Final = 34
_MARGIN_PX: Final = 8
_STEP: Final = 0.1
"""Steps of the ends of the scale."""


@dataclass(frozen=True, slots=True)
class Point:
    """A campaign in the drawing; places in pixels, y downwards."""

    campaign: CampaignDirectory
    counts: Counts
    x_px: float
    y_px: float
    low_px: float
    high_px: float


@dataclass(frozen=True, slots=True)
class Trend:
    """Success rates of the campaigns of one name, oldest first.

    Attributes:
        low, high: Ends of the scale, which the intervals are within.
        left_out: Number of older campaigns that are not drawn.
    """

    name: str
    points: tuple[Point, ...]
    low: float
    high: float
    left_out: int

    @property
    def line(self) -> str:
        """The points as SVG has them."""
        return " ".join(f"{point.x_px:g},{point.y_px:g}" for point in self.points)


def trend_of(name: str, campaigns: Sequence[tuple[CampaignDirectory, Counts]]) -> Trend:
    """Return the trend of campaigns with judged runs, oldest first; at least one."""
    drawn = campaigns[-MOST_CAMPAIGNS:]
    ends = [(counts.interval.low, counts.interval.high) for _, counts in drawn]
    low = math.floor(round(min(low for low, _ in ends) / _STEP, 6)) * _STEP
    high = math.ceil(round(max(high for _, high in ends) / _STEP, 6)) * _STEP
    span_px, step_px = HEIGHT_PX - 2 * _MARGIN_PX, (WIDTH_PX - _LEFT_PX - 2 * _MARGIN_PX) / max(1, len(drawn) - 1)

    def at(rate: float) -> float:
        return round(HEIGHT_PX - _MARGIN_PX - span_px * (rate - low) / (high - low), 1)

    points = [
        Point(
            campaign,
            counts,
            round(_LEFT_PX + _MARGIN_PX + k * step_px, 1),
            at(counts.rate or 0.0),
            at(end[0]),
            at(end[1]),
        )
        for k, ((campaign, counts), end) in enumerate(zip(drawn, ends, strict=True))
    ]
    return Trend(name, tuple(points), low, high, len(campaigns) - len(drawn))
