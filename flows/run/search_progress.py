"""The progress of a search: proposals and evaluations batch by batch, and the confirmation of the best.

Only results are stored: a resumed search asks its strategy from the beginning and finds the runs of each batch in the store.
"""

import hashlib
import time
from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, Final

from vastflow.flows.request.run_request import RunRequest
from vastflow.flows.request.stopping import Stopping
from vastflow.oracles.judgment.verdict import RunQuantity, Verdict, read_verdicts
from vastflow.producers.campaign import Campaign
from vastflow.producers.campaign_file.search import SearchSpec
from vastflow.producers.instantiation.instantiate import Family, Instantiation
from vastflow.producers.search.criteria import Criterion, best_of, criteria
from vastflow.producers.search.search import Search
from vastflow.producers.search.strategy import FAMILY, Evaluation, Proposal, Strategy, asked
from vastflow.sim.model.digest import digest
from vastflow.sim.model.faults import FileError
from vastflow.tasks.engine.index import ConfigurationRuns, FoundRuns, Index
from vastflow.tasks.engine.instantiation import Instantiated
from vastflow.tasks.engine.progress import Tally
from vastflow.tasks.engine.work import VERDICTS
from vastflow.tasks.store.artifact import Stored
from vastflow.tasks.store.store import Store


@dataclass
class PointRuns:
    """The number of runs of a point, see `vastflow.tasks.engine.engine.RunsWanted`: `runs`, or fewer by a rule.

    The point named `confirmed`, empty before, has `confirm` more, whose indices the search never used.
    """

    rule: Stopping | None
    runs: int
    confirm: int = 0
    confirmed: str = ""

    @property
    def most(self) -> int:
        """Maximum number of runs of a point."""
        return self.runs + (self.confirm if self.confirmed else 0)

    def wanted(self, judgments: Mapping[int, str]) -> int:
        """Return the number of runs of a point with these judgments."""
        return self.runs if self.rule is None else self.rule.wanted(judgments)

    def stored(self, index: Index, configuration: ConfigurationRuns) -> tuple[ConfigurationRuns, list[Stored]]:
        """Return the configuration with the runs that it needs now, and their stored blocks."""
        if self.rule is not None:
            configuration, stored = self.rule.stored(index, configuration)
        else:
            configuration = replace(configuration, runs=self.runs)
            stored = index.stored(configuration)
        if configuration.name != self.confirmed or not FoundRuns(configuration, tuple(stored)).complete:
            return configuration, stored
        more = replace(configuration, runs=configuration.runs + self.confirm)
        return more, index.stored(more)


_BATCHES: Final = "batches"


@dataclass
class BatchClock:
    """Measures a time budget; there is none without a key.

    The number of batches that fit it is stored, so that a search with the same key has as many and the same result.
    """

    store: Store
    key: str
    _began_s: float = field(default_factory=time.monotonic)

    def elapsed_s(self, batches: int, spec: SearchSpec) -> float:
        """Return the time spent (s), or none or all of the budget if its number of batches is stored."""
        if not self.key:
            return 0.0
        if (kept := self._kept()) is None:
            return time.monotonic() - self._began_s
        return max(each.time or 0.0 for each in spec.budget) if batches >= kept else 0.0

    def keep(self, batches: int) -> None:
        """Store the number of batches, unless it is stored."""
        if self.key and self._kept() is None:
            self.store.put(self.key, {}, {_BATCHES: batches})

    def _kept(self) -> int | None:
        found = self.store.find(self.key)
        return None if found is None else int(found.info[_BATCHES])


BROKEN: Final = "a point broke twice"


@dataclass(frozen=True, slots=True)
class Confirmation:
    """Fresh runs of the best point, with the objective of each run that has one."""

    proposal: Proposal
    found: float
    samples: Sequence[float]
    runs: int


@dataclass
class SearchProgress:
    """A running search.

    Attributes:
        proposals: Proposals of the current batch; all of them at the end.
        batches: Evaluations by batch; `baseline` has those of the baseline.
        ended_by: Why the search ended; empty before.
        strategy: The strategy, which was told all batches.
    """

    search: Search
    runs: PointRuns
    clock: BatchClock
    tally: Tally
    proposals: Sequence[Proposal] = ()
    batches: list[list[Evaluation]] = field(default_factory=list)
    baseline: list[Evaluation] = field(default_factory=list)
    ended_by: str = ""
    confirmation: Confirmation | None = None
    strategy: Strategy[Any] = field(init=False)
    _quantities: Mapping[str, RunQuantity] = field(init=False)
    _again: bool = field(default=False, init=False)
    _wanted: dict[str, int] = field(default_factory=dict, init=False)
    _families: dict[str, Family] = field(default_factory=dict, init=False)

    def __post_init__(self) -> None:
        self.strategy = self.search.strategy()
        self._quantities = {
            name: RunQuantity(each.oracle, each.metric, each.aggregate, each.q)
            for name, each in self.search.quantities.items()
        }
        self._ask()

    @property
    def evaluations(self) -> list[Evaluation]:
        """All evaluations in the order of the proposals."""
        return [each for batch in self.batches for each in batch]

    @property
    def best(self) -> Evaluation | None:
        """The best evaluation."""
        return best_of(self.evaluations, self.search.spec.direction)

    @property
    def title(self) -> str:
        """The current batch, such as `batch 3, point-0009 to point-0012`."""
        if self.ended_by:
            return f"confirmation of {self.runs.confirmed}" if self.runs.confirmed else "all points"
        names = [each.name for each in self.proposals if each.family == FAMILY]
        points = f"{names[0]} to {names[-1]}"
        return f"batch {len(self.batches) + 1}, {points}{', once more' * self._again}"

    @property
    def found_text(self) -> str:
        """The best so far, such as `best failure_rate 0.667 at point-0004`."""
        best, name = self.best, self.search.spec.objective.name
        return "nothing judged" if best is None else f"best {name} {best.objective:.3g} at {best.proposal.name}"

    @property
    def standing(self) -> list[str]:
        """Each budget and criterion against its limit, such as `batches 2 of 3`."""
        return [each.text for each in self._criteria()]

    def campaign(self, campaign: Campaign) -> Campaign:
        """Return the campaign with the current points as its families."""
        return replace(campaign, families=tuple(map(self._family, self.proposals)))

    def named(self, instantiated: Instantiated) -> Instantiated:
        """Return the instantiated points, named as their proposals; raises as `Search.instantiation`."""
        made: Instantiation = self.search.instantiation(self.proposals, instantiated.instantiation)
        return replace(instantiated, instantiation=made)

    def expected(self, configurations: Mapping[str, int]) -> Mapping[str, int]:
        """Return the runs of these configurations and of all earlier points."""
        self._wanted |= configurations
        return self._wanted

    def take(
        self, instantiated: Instantiated, found: Mapping[str, FoundRuns], index: Index, broken: Collection[str]
    ) -> bool:
        """Add the results of the current points and ask for the next; return whether there are any.

        A broken batch is computed once more; if it breaks again, the search ends. `broken` are names of configurations with a fault.

        Raises:
            Lost: verdicts are damaged.
        """
        is_broken = bool(instantiated.faults) or not set(broken).isdisjoint(found)
        if is_broken and not self._again:
            self._again = True
            return True
        if self.ended_by:
            self._confirm(found, index, broken)
            return False
        if is_broken:
            return self._end(BROKEN)
        told = self._evaluations(instantiated.instantiation, found, index)
        evaluations = [each for each in told if each.proposal.family == FAMILY]
        self.baseline += told[len(evaluations) :]
        self._again = False
        self.batches.append(evaluations)
        self.strategy.tell(evaluations)
        standing = list(self._criteria())
        said = ", ".join(each.text for each in standing[:-1])
        self.tally.notice(f"batch {len(self.batches)}: {self.found_text}; {said}")
        if met := [each.text for each in standing if each.met]:
            return self._end(met[0])
        return self._ask()

    def _criteria(self) -> Iterator[Criterion]:
        elapsed_s = self.clock.elapsed_s(len(self.batches), self.search.spec)
        return criteria(self.search.spec, self.batches, self.strategy.metrics, elapsed_s)

    def _ask(self) -> bool:
        batch, first = len(self.batches), sum(map(len, self.batches)) + 1
        count = min(self.search.spec.per_batch, self.search.spec.max_proposals - first + 1)
        points = asked(self.strategy, batch, count)
        proposals = [Proposal(first + k, batch, point) for k, point in enumerate(points)]
        self.proposals = [*proposals, *self.search.baseline(proposals)]
        return bool(points) or self._end("the strategy proposes nothing more")

    def _end(self, why: str) -> bool:
        """Ask for all points at once, the best with its confirming runs; return whether there are any."""
        self.ended_by, self._again = why, False
        self.clock.keep(len(self.batches))
        told = [each.proposal for each in (*self.evaluations, *self.baseline)]
        self.proposals = [*told, *(self.proposals if why == BROKEN else ())]
        if why != BROKEN and (best := self.best) is not None:
            self.runs.confirmed = best.proposal.name
        return bool(self.proposals)

    def _family(self, proposal: Proposal) -> Family:
        if proposal.name not in self._families:
            self._families[proposal.name] = self.search.family(proposal)
        return self._families[proposal.name]

    def _evaluations(
        self, instantiation: Instantiation, found: Mapping[str, FoundRuns], index: Index
    ) -> list[Evaluation]:
        made = {each.name: each.duplicate_of or each.name for each in instantiation.configurations}
        why = {each.parent: each.reason for each in instantiation.rejections}
        why |= {each.name: f"the constraint {each.constraint} excludes it" for each in instantiation.excluded}
        return [
            self._evaluated(proposal, found[made[proposal.name]], index)
            if proposal.name in made
            else Evaluation(proposal, "rejected", reason=why.get(proposal.name, "nothing could be made of it"))
            for proposal in self.proposals
        ]

    def _evaluated(self, proposal: Proposal, found: FoundRuns, index: Index) -> Evaluation:
        verdicts, used = verdicts_of(found, index), range(found.configuration.runs)
        numbers: dict[str, float] = {}
        for name in {self.search.spec.objective.name, *self.search.measures}:
            if (quantity := self._quantities.get(name)) is not None:
                value = quantity.value(quantity.samples(verdicts, used))
            else:
                value = float(proposal.point[name])  # type: ignore[arg-type]
            if value is not None:
                numbers[name] = value
        objective = numbers.get(self.search.spec.objective.name)
        simulated = {
            int(run): float(s) for each in found.stored for run, s in each.recordings.info["runs"] if int(run) in used
        }
        return Evaluation(
            proposal,
            "not judged" if objective is None else "judged",
            objective,
            {name: numbers[name] for name in self.search.measures if name in numbers},
            len(used),
            sum(simulated.values()),
            "" if objective is not None else "its runs do not give the objective",
        )

    def _confirm(self, found: Mapping[str, FoundRuns], index: Index, broken: Collection[str]) -> None:
        best = self.best
        if best is None or best.objective is None or best.proposal.name in broken or not self.runs.confirm:
            return
        if (configuration := found.get(best.proposal.name)) is None:
            return
        fresh = range(best.runs, configuration.configuration.runs)
        samples = self._quantities[self.search.spec.objective.name].samples(verdicts_of(configuration, index), fresh)
        self.confirmation = Confirmation(best.proposal, best.objective, samples, len(fresh))


def verdicts_of(found: FoundRuns, index: Index) -> list[Verdict]:
    """Return all verdicts on a configuration's runs; raises `Lost` if they are damaged."""
    contents = (index.store.load(each.verdicts, VERDICTS) for each in found.stored if each.verdicts)
    return [verdict for content in contents for verdict in read_verdicts(content)]


def search_progress(
    campaign: Campaign,
    request: RunRequest,
    stopping: "Stopping | None",
    runs: int,
    store: Store,
    content: bytes,
    tally: Tally,
) -> SearchProgress | None:
    """Return the search of a campaign at its beginning, or None if the file lists its configurations.

    Args:
        runs: Runs of each point, at most with `stopping`.
        content: Content of the campaign file.

    Raises:
        UserError: the request selects configurations, which a search does not know, or a library is not installed.
    """
    if (search := campaign.search) is None:
        return None
    if part := next((name for name in ("only", "sample") if getattr(request, name)), None):
        what = f"--{part} does not go with a search, which proposes its configurations one after the other"
        raise FileError([campaign.fault(("search",), what, at="key")])
    timed = any(each.time is not None for each in search.spec.budget)
    hashed = digest("search", hashlib.sha256(content).hexdigest(), runs)
    clock = BatchClock(store, f"search/{hashed[:2]}/{hashed}" if timed else "")
    return SearchProgress(search, PointRuns(stopping, runs, search.spec.confirm), clock, tally)
