"""The page of all campaigns: their rates, what changed from one to the next, and trends."""

import hashlib
import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import Any, Final, TypeAlias

from starlette.requests import Request
from starlette.responses import RedirectResponse, Response
from starlette.routing import BaseRoute, Route

from vastflow.deployments.explorer.directories import CampaignDirectory, Directories, headline_of
from vastflow.deployments.explorer.file_change import FileChange, file_change
from vastflow.deployments.explorer.pages import Pages, address
from vastflow.flows.request.run_request import SEARCH, SEQUENTIAL
from vastflow.oracles.evidence.headline import robot_text
from vastflow.oracles.statistics.intervals import Counts, Interval
from vastflow.oracles.statistics.looks import Mean

MOST_POINTS: Final = 30
"""Campaigns in a drawing, the newest."""
MOST_RUNS: Final = 2**53
"""Runs of a verdict that arithmetic can take; a number beyond is not believed."""
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
        mean: Rate and interval of the headline `text`; None where they are not known, and for a search.
        change: None for the first campaign of its name, and for one that is not finished.
    """

    campaign: CampaignDirectory
    counts: Counts | None
    mean: Mean | None
    text: str
    change: FileChange | None


def counts_of(campaign: CampaignDirectory) -> Counts | None:
    """Return the runs of a finished campaign, or None where they are not known."""
    told = campaign.metadata.get("counts", {}) if campaign.state == "finished" else {}
    numbers = [told.get(name) for name in ("passed", "failed", "not_judged")]
    known = [number for number in numbers if isinstance(number, int) and 0 <= number <= MOST_RUNS]
    return Counts(*known) if len(known) == len(numbers) else None


def mean_of(campaign: CampaignDirectory) -> Mean | None:
    """Return rate and interval of a headline; without one, of the counts if runs were fixed."""
    if told := headline_of(campaign):
        ends = told.get("these")
        numbers = [told.get("rate"), *(ends.get(end) for end in ("low", "high"))] if isinstance(ends, dict) else []
        known = [float(n) for n in numbers if isinstance(n, int | float) and 0.0 <= n <= 1.0]
        return (known[0], Interval(*known[1:])) if len(known) == 3 else None
    counts = counts_of(campaign)
    if counts is None or counts.rate is None or campaign.metadata.get(SEARCH) or campaign.metadata.get(SEQUENTIAL):
        return None
    return counts.rate, counts.interval


def rows_of(found: Sequence[CampaignDirectory], change_of: Changes) -> Iterator[CampaignRow]:
    """Yield the rows of campaigns that are sorted newest first."""
    for k, each in enumerate(found):
        change = None
        if each.state == "finished":
            earlier = (other for other in found[k + 1 :] if other.name == each.name and other.state == "finished")
            previous = next(earlier, None)
            change = None if previous is None else change_of(previous, each)
        yield CampaignRow(each, counts_of(each), mean_of(each), str(headline_of(each).get("text", "")), change)


def trends_of(rows: Sequence[CampaignRow]) -> Iterator[Mapping[str, Any]]:
    """Yield the newest rates of each file and robot that several campaigns with judged runs have, the newest first.

    A trend has the rows of its campaigns, oldest first, the ends of the scale, and the number of older ones that are left out.
    """
    series: dict[tuple[str, str, str], list[CampaignRow]] = {}
    for row in rows:
        if row.mean is not None:
            said = row.campaign.metadata
            asked = said.get("asked")
            file = str(asked.get("file")) if isinstance(asked, dict) else ""
            series.setdefault((row.campaign.name, file, robot_text(said)), []).insert(0, row)
    for (name, file, robot), campaigns in series.items():
        if len(campaigns) > 1:
            drawn = campaigns[-MOST_POINTS:]
            ends = [row.mean[1] for row in drawn if row.mean is not None]
            low, high = min(each.low for each in ends), max(each.high for each in ends)
            scale = {
                "low": math.floor(round(low / _STEP, 6)) * _STEP,
                "high": math.ceil(round(high / _STEP, 6)) * _STEP,
            }
            yield {
                "name": name,
                "of": ", ".join(filter(None, (file, robot))),
                "campaigns": drawn,
                **scale,
                "left_out": len(campaigns) - len(drawn),
            }


def version_of(found: Sequence[CampaignDirectory]) -> str:
    """Return text that is another when a campaign comes, ends, or goes."""
    told = repr([(each.id, each.state, each.problem, each.created, each.progress) for each in found])
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
            trends=[*trends_of(rows)],
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
