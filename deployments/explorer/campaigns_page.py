"""The page of all campaigns: their rates, what changed from one to the next, and trends."""

import hashlib
import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import Final, TypeAlias

from starlette.requests import Request
from starlette.responses import RedirectResponse, Response
from starlette.routing import BaseRoute, Route

from vastflow.deployments.explorer.directories import CampaignDirectory, Directories
from vastflow.deployments.explorer.file_change import FileChange, file_change
from vastflow.deployments.explorer.pages import Pages, address
from vastflow.oracles.statistics.intervals import Counts

MOST_POINTS: Final = 30
"""Campaigns in a drawing, the newest."""
WIDTH_PX: Final = 260
HEIGHT_PX: Final = 64
_LEFT_PX: Final = 34
_MARGIN_PX: Final = 8
_STEP: Final = 0.1
"""Steps of the ends of the scale."""

Changes: TypeAlias = Callable[[CampaignDirectory, CampaignDirectory], FileChange]
_KEPT: Final = 1000
"""Changes in memory: finished campaigns stay as they are, and large files take a second."""


@dataclass(frozen=True, slots=True)
class CampaignRow:
    """A campaign in the list.

    Attributes:
        counts: Judged runs; None where they are not known.
        change: None for the first campaign of its name, and for one that is not finished.
    """

    campaign: CampaignDirectory
    counts: Counts | None
    change: FileChange | None

    @property
    def faults(self) -> int:
        """Number of faults, which are no failures of the system under test."""
        found = self.campaign.metadata.get("faults")
        return len(found) if isinstance(found, list) else 0


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


def counts_of(campaign: CampaignDirectory) -> Counts | None:
    """Return the runs of a finished campaign, or None where they are not known."""
    told = campaign.metadata.get("counts", {}) if campaign.state == "finished" else {}
    numbers = [told.get(name) for name in ("passed", "failed", "not_judged")]
    known = [number for number in numbers if isinstance(number, int) and number >= 0]
    return Counts(*known) if len(known) == len(numbers) else None


def rows_of(found: Sequence[CampaignDirectory], change_of: Changes) -> Iterator[CampaignRow]:
    """Yield the rows of campaigns that are sorted newest first."""
    for k, each in enumerate(found):
        change = None
        if each.state == "finished":
            earlier = (other for other in found[k + 1 :] if other.name == each.name and other.state == "finished")
            previous = next(earlier, None)
            change = None if previous is None else change_of(previous, each)
        yield CampaignRow(each, counts_of(each), change)


def trends_of(rows: Sequence[CampaignRow]) -> list[Trend]:
    """Return the trend of each name that several campaigns with judged runs have, the newest name first."""
    series: dict[str, list[tuple[CampaignDirectory, Counts]]] = {}
    for row in rows:
        if row.counts is not None and row.counts.judged:
            series.setdefault(row.campaign.name, []).insert(0, (row.campaign, row.counts))
    return [trend_of(name, campaigns) for name, campaigns in series.items() if len(campaigns) > 1]


def trend_of(name: str, campaigns: Sequence[tuple[CampaignDirectory, Counts]]) -> Trend:
    """Return the trend of campaigns with judged runs, oldest first; at least one."""
    drawn = campaigns[-MOST_POINTS:]
    ends = [(counts.interval.low, counts.interval.high) for _, counts in drawn]
    low = math.floor(round(min(low for low, _ in ends) / _STEP, 6)) * _STEP
    high = math.ceil(round(max(high for _, high in ends) / _STEP, 6)) * _STEP
    span_px, step_px = HEIGHT_PX - 2 * _MARGIN_PX, (WIDTH_PX - _LEFT_PX - 2 * _MARGIN_PX) / max(1, len(drawn) - 1)

    def at(rate: float) -> float:
        return round(HEIGHT_PX - _MARGIN_PX - span_px * (rate - low) / (high - low), 1)

    points = []
    for k, ((campaign, counts), end) in enumerate(zip(drawn, ends, strict=True)):
        x_px = round(_LEFT_PX + _MARGIN_PX + k * step_px, 1)
        points.append(Point(campaign, counts, x_px, at(counts.rate or 0.0), at(end[0]), at(end[1])))
    return Trend(name, tuple(points), low, high, len(campaigns) - len(drawn))


def version_of(found: Sequence[CampaignDirectory]) -> str:
    """Return text that is another when a campaign comes, ends, or goes."""
    told = repr([(each.id, each.state, each.problem, each.created) for each in found])
    return hashlib.sha256(told.encode(errors="surrogatepass")).hexdigest()[:16]


def routes(directories: Directories, pages: Pages) -> list[BaseRoute]:
    """Return the routes of the page."""
    change_of = lru_cache(_KEPT)(file_change)

    def campaigns(request: Request) -> Response:
        name = request.query_params.get("name")
        every = directories.all()
        rows = list(rows_of([each for each in every if name in (None, each.name)], change_of))
        return pages.page(
            request,
            "campaigns.html.j2",
            rows=rows,
            version=version_of(every),
            trends=trends_of(rows),
            roots=directories.roots,
            name=name,
            names=len({each.name for each in every}),
        )

    def chosen(request: Request) -> Response:
        ticked = request.query_params.getlist("c")
        if len(ticked) != 2:
            return pages.sentence(request, 400, f"Expected two ticked campaigns, got {len(ticked)}.")
        newer, older = sorted(map(directories.find, ticked), key=lambda each: each.created, reverse=True)
        return RedirectResponse(address("/compare", a=older.id, b=newer.id), 303)

    return [Route("/", campaigns), Route("/chosen", chosen)]
