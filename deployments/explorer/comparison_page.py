"""The comparison page: baseline and candidate, the difference, and what newly fails."""

import math
import threading
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from functools import lru_cache
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING, Any, Final, get_args

import numpy as np
from starlette.exceptions import HTTPException
from starlette.requests import Request
from starlette.responses import Response
from starlette.routing import BaseRoute, Route

from vastflow.deployments.explorer.directories import CampaignDirectory, Directories
from vastflow.deployments.explorer.file_change import file_change
from vastflow.deployments.explorer.pages import Pages, address
from vastflow.oracles.results.tables import JUDGMENTS, Tables, read_tables
from vastflow.oracles.results.unusable import reading
from vastflow.oracles.statistics.comparison import Change, RateDifference, Target
from vastflow.sim.model.faults import UserError

if TYPE_CHECKING:
    from vastflow.flows.analysis.comparison import Compared

MOST_CHANGES: Final = 20
"""Configurations of a kind that are listed before all are asked for."""
MOST_LEVELS: Final = 24
TARGETS: Final[dict[str, Target]] = {name: name for name in get_args(Target)}
_KEPT: Final = 3
_KEPT_TABLES: Final = 2
"""Campaigns; one may take 100 MB, and a page with another question is of the same two."""


@dataclass(frozen=True, slots=True)
class Question:
    """A comparison as an address asks for it.

    Attributes:
        oracle: None for all oracles together.
        margin: Accepted loss, as a share of the runs.
    """

    before: CampaignDirectory
    after: CampaignDirectory
    oracle: str | None = None
    margin: float = 0.02
    target: Target = "these"

    def query(self, **more: object) -> dict[str, object]:
        """Return the names of an address, with `more`."""
        own = {"oracle": self.oracle, "margin": f"{100 * self.margin:g}", "target": self.target}
        return {"a": self.before.id, "b": self.after.id, **own, **more}


class Comparisons:
    """Comparisons by question; a few are kept, as a page asks for its pictures too."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._locks: dict[tuple[str, str], threading.Lock] = {}
        self._tables = lru_cache(_KEPT_TABLES)(_tables)
        self._compared = lru_cache(_KEPT)(self._compare)

    def of(self, question: Question) -> "Compared":
        """Return the comparison.

        Raises:
            UserError: a directory is damaged or unfinished, or there is nothing to compare.
        """
        # Two requests for one page compute it once, and those for other campaigns don't wait.
        with self._locks.setdefault((question.before.id, question.after.id), threading.Lock()):
            return self._compared(question)

    def _compare(self, question: Question) -> "Compared":
        from vastflow.flows.analysis.comparison import compared  # two seconds of imports

        before, after = self._tables(question.before), self._tables(question.after)
        with reading(question.after.path):
            return compared(before, after, question.oracle, question.margin, question.target)

    def picture(self, question: Question, configuration: str) -> bytes:
        """Return a PNG of a changed configuration's runs in both campaigns.

        Raises:
            UserError: there is none, with the reason.
        """
        from vastflow.flows.analysis.comparison_pictures import draw  # with matplotlib

        found = self.of(question)
        named = (each for each in found.changes if found.pairing.matches[each.configuration].after == configuration)
        if (change := next(named, None)) is None:
            raise UserError(f"{configuration}: expected a configuration with changed outcomes")
        with self._lock, TemporaryDirectory(prefix="vastflow-") as folder:  # matplotlib is not made for threads
            drawn, undrawn = draw(replace(found, changes=[change]), 1, Path(folder))
            if not drawn:
                raise UserError(f"{configuration} can't be drawn: {next(iter(undrawn))}")
            return drawn[configuration].read_bytes()


def _tables(campaign: CampaignDirectory) -> Tables:
    with reading(campaign.path):
        return read_tables(campaign.path)


def changed(found: "Compared", question: Question, changes: list[Change]) -> Iterator[Mapping[str, Any]]:
    """Yield configurations by their names in both campaigns, with the runs whose verdicts differ and their addresses."""
    pairing = found.pairing
    before, after = pairing.judged(found.oracle)
    for change in changes:
        match = pairing.matches[change.configuration]
        differ = np.flatnonzero((pairing.configuration == change.configuration) & (before != after))
        runs = []
        for k in differ.tolist():
            then, now = int(pairing.run_before[k]), int(pairing.run_after[k])
            # The baseline is A there, as it is here.
            candidate = {"with": match.after, "withrun": now, "withc": question.after.id}
            place = address("/run", c=question.before.id, configuration=match.before, run=then, **candidate)
            words = [JUDGMENTS.get(int(side[k]), "not judged") for side in (before, after)]
            runs.append({"run": now, "before": words[0], "after": words[1], "address": place})
        yield {"name": match.after, "was": match.before, "change": change, "runs": runs}


def routes(directories: Directories, pages: Pages) -> list[BaseRoute]:
    """Return the routes of the page and of its pictures."""
    comparisons = Comparisons()

    def asked(request: Request) -> Question:
        given = request.query_params
        before, after = (directories.find(given.get(side, "")) for side in ("a", "b"))
        if before.id == after.id:
            raise HTTPException(400, "Expected two campaigns, got one twice.")
        for each in (before, after):
            if each.state != "finished":
                raise HTTPException(409, f"{each.name} is {each.state}. Expected a finished campaign.")
        margin, target = _margin(given.get("margin") or "2"), TARGETS.get(named := given.get("target", "these"))
        if target is None:
            raise HTTPException(400, f"Expected `these` or `others` as the target, got {named!r}.")
        return Question(before, after, given.get("oracle") or None, margin, target)

    def page(request: Request) -> Response:
        question = asked(request)
        found = comparisons.of(question)
        whole = "all" in request.query_params
        worse, better = found.shown(worse=True), found.shown(worse=False)
        rest = [change for change in found.changes if not change.shown]
        groups = []
        for title, some in (("Newly failing", worse), ("Newly passing", better), ("Changed, possibly by chance", rest)):
            listed = some if whole else some[:MOST_CHANGES]
            groups.append((title, list(changed(found, question, listed)), len(some) - len(listed)))
        levels = sorted(found.levels, key=lambda one: 2.0 if one.adjusted is None else one.adjusted)
        return pages.page(
            request,
            "comparison.html.j2",
            found=found,
            question=question,
            judged=_order_by_oracle(found),
            change=file_change(question.before, question.after),
            groups=groups,
            levels=levels if whole else levels[:MOST_LEVELS],
            more_levels=0 if whole else max(0, len(levels) - MOST_LEVELS),
            scale=_scale(found),
        )

    def picture(request: Request) -> Response:
        content = comparisons.picture(asked(request), request.query_params.get("configuration", ""))
        return Response(content, media_type="image/png", headers={"Cache-Control": "private, max-age=600"})

    return [Route("/compare", page), Route("/api/compare.png", picture)]


def _margin(percent: str) -> float:
    try:
        margin = float(percent) / 100
    except ValueError:
        margin = math.nan
    if not 0.0 <= margin <= 1.0:  # also NaN
        raise HTTPException(400, f"Expected a margin of 0 to 100 points, got {percent!r}.")
    return margin


def _order_by_oracle(found: "Compared") -> dict[str, RateDifference]:
    whole = {} if len(found.oracles) == 1 and found.oracle is None else {found.oracle or "all oracles": found.whole}
    return whole | {name: each for name, each in found.oracles.items() if name != found.oracle}


def _scale(found: "Compared") -> float:
    """Return the largest difference that drawings have room for, at both sides of zero."""
    every = [*found.oracles.values(), found.whole, *(level.difference for level in found.levels)]
    ends = [abs(end) for each in every for end in each.interval if math.isfinite(end)]
    return max([*ends, 0.05])
