"""A session: one call's way from a campaign that was read to artifacts that are all in the store."""

import pickle
from collections.abc import Collection, Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from vastflow.flows.computing.computation import WAVES, Computation, begin_executing, end_orphans, inside_flow_run
from vastflow.flows.request.members import Runs, members_of, narrowed
from vastflow.flows.request.selection import Selection
from vastflow.flows.results.found import RunFault, StoredResult
from vastflow.oracles.oracle import Oracle
from vastflow.producers.configuration import Configuration
from vastflow.producers.instantiate import Instantiation
from vastflow.tasks.engine import Engine, MemberFault, block_size, judgements
from vastflow.tasks.index import Index, Member, Stored, missing
from vastflow.tasks.instantiation import Evaluator, Instantiated, Instantiator
from vastflow.tasks.progress import Tally
from vastflow.tasks.server import PrefectUnavailable
from vastflow.tasks.store import Lost

if TYPE_CHECKING:
    from vastflow.flows.pool.spread import Spread
    from vastflow.flows.request.stopping import Stopping


@dataclass(frozen=True, slots=True)
class CampaignFault:
    """Something that broke, of no single configuration."""

    stage: str
    error: str


class Session:
    """Completes a campaign's artifacts and reads them.

    Args:
        title: Name of Prefect's flow run.
        runs: Of each configuration, at most.
        only: What of the campaign is run.
        workers: Worker processes.
        log: File for all that would be said on the terminal otherwise.
        stopping: Says how many runs a configuration wants; None for all of them.

    Attributes:
        flow_run_id: Of the flow run on whose page the campaign's results belong, if there is one.
    """

    def __init__(
        self,
        title: str,
        instantiator: Instantiator,
        index: Index,
        oracles: Sequence[Oracle[Any]],
        runs: int,
        only: Selection,
        workers: int,
        tally: Tally,
        log: Path,
        spread: "Spread | None" = None,
        stopping: "Stopping | None" = None,
    ) -> None:
        self._runs = runs
        self._stopping = stopping
        self._title = title
        self._instantiator = instantiator
        self._index = index
        self._oracles = pickle.dumps(tuple(oracles))
        self._only = only
        self._workers = workers
        self._tally = tally
        self._log = log
        self._spread = spread
        self._instantiated: Instantiated | None = None
        self._members: dict[str, Member] = {}
        self._stored: dict[str, list[Stored]] = {}
        self._incomplete: set[str] = set()
        self._missing_runs = 0
        self._faults: tuple[MemberFault, ...] = ()
        self._flow_fault: CampaignFault | None = None
        self._unavailable: PrefectUnavailable | None = None
        self.flow_run_id: str | None = None

    @property
    def runs(self) -> Runs:
        """Of each configuration: all of them, or as many as `complete` found to be wanted."""
        return self._runs if self._stopping is None else {name: member.runs for name, member in self._members.items()}

    @property
    def campaign_faults(self) -> list[CampaignFault]:
        """Faults that concern no single configuration."""
        faults = [
            CampaignFault("instantiate", str(fault))
            for fault in (self._instantiated.faults if self._instantiated else ())
        ]
        return [*faults, *filter(None, [self._flow_fault])]

    def complete(self) -> Instantiation:
        """Compute all that is missing. Prefect starts only if something is.

        Raises:
            CampaignError: a name in `only` is unknown.
            StoreError: the store can't be used, or no longer.
            PrefectUnavailable: Prefect's API was gone before all was computed.
        """
        scanned: Instantiated | None = None
        for _ in range(WAVES):
            self._index.store.survey()
            if self._instantiated is None and (stored := self._instantiator.stored()) is not None:
                self._instantiate(stored)
            broken = {fault.member for fault in self._faults}
            if self._instantiated is not None:
                # What was complete is not looked at twice in a call: should it be lost by now, reading it tells.
                if self._scanned(self._incomplete if scanned is self._instantiated else self._members) <= broken:
                    end_orphans(self._log)
                    if self._unavailable is not None:
                        self._tally.notice(
                            f"all is computed, but Prefect's pages do not show the end: {self._unavailable}"
                        )
                    return self._instantiated.instantiation
                scanned = self._instantiated
            if self._unavailable is not None:  # tasks end without Prefect's API, but these did not
                raise self._unavailable
            self._compute()
        if self._instantiated is None:
            raise Lost("what the producers made is lost again and again")
        self._index.store.survey()
        self._scanned(self._members)
        return self._instantiated.instantiation

    @property
    def whole(self) -> bool:
        """Whether nothing broke."""
        return not self.campaign_faults and not self._faults

    def contents(self) -> Iterator[list[str]]:
        """Keys and contents of the verdicts that `complete` found, of each member in order: all its results follow into them."""
        for member in self._members:
            found = [each.verdicts for each in self._stored[member] if each.verdicts]
            yield [text for verdicts in found for text in (verdicts.key, verdicts.content)]

    def found(self, configuration: Configuration) -> StoredResult:
        """What `complete` found of a configuration, to be read from the store. May be called from any thread.

        Raises:
            Lost: something is missing that should not be.
        """
        member = self._members[configuration.name]
        stored = self._stored[member.name]
        faults = [
            RunFault(member.name, fault.run_index, fault.stage, fault.error)
            for fault in self._faults
            if fault.member == member.name
        ]
        if not faults and not _judged(stored).issuperset(range(member.runs)):
            if self._flow_fault is None:
                raise Lost(f"results of {member.name}")
            faults = [RunFault(member.name, None, self._flow_fault.stage, self._flow_fault.error)]
        return StoredResult(self._index.store, stored, member.runs, faults)

    def _instantiate(self, instantiated: Instantiated) -> None:
        self._instantiated = narrowed(instantiated, self._only, self._instantiator.campaign.document.file)
        members = members_of(self._instantiated.instantiation, self._runs)
        self._members = {member.name: member for member in members}
        if self._stopping is not None:
            first = self._stopping.wanted({})
            self._members = {name: replace(member, runs=first) for name, member in self._members.items()}
        self._tally.expect({name: member.runs for name, member in self._members.items()})

    def _scanned(self, names: Collection[str]) -> set[str]:
        """Look what is in the store of members and count it; give the names of those that are not complete."""
        self._tally.begin("scanning")
        return self._looked_at(names)

    def _looked_at(self, names: Collection[str]) -> set[str]:
        """As `_scanned`, in whatever phase; the members then want as many runs as their verdicts ask for."""
        members = [member for name, member in self._members.items() if name in names]
        broken = {fault.member for fault in self._faults}
        self._incomplete = set()
        self._missing_runs = 0
        for each in members:
            member, stored = self._wanting(each)
            absent = missing([found.block for found in stored], member.runs)
            self._missing_runs += len(absent)
            if absent or not all(found.verdicts for found in stored):
                self._incomplete.add(member.name)
            if self._stopping is not None:
                goes_on = member.name in self._incomplete and member.name not in broken
                most = self._runs if goes_on else member.runs
                self._tally.want(member.name, member.runs, most)
            for found in stored:
                self._tally.reuse(member.name, range(found.block.start, found.block.stop))
                if found.verdicts:
                    self._tally.judge(member.name, judgements(found.verdicts))
            self._members[member.name], self._stored[member.name] = member, stored
        return self._incomplete

    def _wanting(self, member: Member) -> tuple[Member, list[Stored]]:
        """A member with the runs that are wanted of it by now, and what the store has of these."""
        if self._stopping is None:
            return member, self._index.stored(member)
        return self._stopping.stored(self._index, member)

    def _more(self, engine: Engine) -> list[Member]:
        """Members that want more runs now that those of a wave are judged; one that lacks something of the wave does not go on."""
        if self._stopping is None:
            return []
        before = {name: self._members[name].runs for name in self._incomplete}
        self._faults = engine.faults
        self._looked_at(before)
        broken = {fault.member for fault in self._faults}
        engine.block_runs = block_size(self._missing_runs, self._workers)
        going_on = [name for name in before if name in self._incomplete and self._members[name].runs > before[name]]
        return [self._members[name] for name in going_on if name not in broken]

    def _compute(self) -> None:
        """One run of the flow."""
        self._tally.begin("starting Prefect")
        self._flow_fault = None
        if self._spread is not None:
            self._spread.check(self._log)
        computation = Computation(self._index, self._oracles, self._workers, self._tally, self._log)
        error = computation.run(self._flow, self._begin_early)
        self.flow_run_id = computation.flow_run_id
        self._faults = computation.engine.faults
        if error is None:
            return
        from vastflow.flows.computing.task_runs import TaskFailed

        if isinstance(error, Lost):
            self._instantiated = None
        elif isinstance(error, PrefectUnavailable):
            self._unavailable = error
        elif isinstance(error, TaskFailed):
            self._flow_fault = CampaignFault("flow", str(error))
        else:
            raise error

    def _begin_early(self, engine: Engine) -> None:
        """Let the workers begin while Prefect starts: with what is missing, or at least with compiling kernels."""
        if self._spread is not None:
            return
        if self._instantiated is None:
            engine.warm_up()
        elif self._missing_runs:
            members = [member for member in self._members.values() if member.name in self._incomplete]
            begin_executing(engine, members, self._missing_runs, self._workers)

    def _flow(self, engine: Engine) -> Any:
        from vastflow.flows.computing.campaign import Job, campaign

        job = Job(
            engine,
            plan=lambda evaluator: self._plan(engine, evaluator),
            incomplete=lambda: self._incomplete,
            more=lambda: self._more(engine),
            running=lambda: self._tally.begin("running"),
            progress=None if inside_flow_run() else self._tally.progress,
        )
        if self._spread is not None:
            from vastflow.flows.pool.campaign import PoolJob, pool_campaign

            return pool_campaign(self._title, PoolJob(job, self._spread, self._tally), return_state=True)
        return campaign(self._title, job, return_state=True)

    def _plan(self, engine: Engine, evaluator: Evaluator) -> list[Member]:
        if self._instantiated is None:
            self._tally.begin("instantiating")
            self._instantiate(self._instantiator.instantiated(evaluator))
            self._scanned(self._members)
            engine.block_runs = block_size(self._missing_runs, self._workers)
        return list(self._members.values())


def _judged(stored: Sequence[Stored]) -> set[int]:
    """Indices of the runs on which there are verdicts."""
    return {run for each in stored if each.verdicts for run in judgements(each.verdicts)}
