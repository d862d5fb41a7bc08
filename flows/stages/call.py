"""One call of a stage of the Python API: what is missing in the store is computed by a flow of Prefect's, all else is found."""

import pickle
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from datetime import datetime
from pathlib import Path
from typing import Any

from vastflow.flows.computing.computation import WAVES, Computation, cores
from vastflow.flows.request.opened import OpenCampaign
from vastflow.flows.results.directory import directory_name
from vastflow.flows.results.found import RunFault
from vastflow.oracles.oracle import Oracle
from vastflow.producers.instantiate import Instantiation
from vastflow.tasks import chatter, ending
from vastflow.tasks.engine import Engine, Rows
from vastflow.tasks.index import Index, Member
from vastflow.tasks.instantiation import Evaluator, Instantiated, Instantiator
from vastflow.tasks.progress import Observer, Reporter, Tally
from vastflow.tasks.server import PrefectUnavailable
from vastflow.tasks.shards import chunks
from vastflow.tasks.store import Lost, StoreError


@dataclass(frozen=True, slots=True)
class StageCall:
    """A call that has begun.

    Attributes:
        stage: `instantiate`, `execute`, `observe` or `judge`.
        oracles: Those that judge, if any do.
        title: Name of the flow run, if there is one.
        log: File for what would be said on the terminal otherwise.
    """

    opened: OpenCampaign
    stage: str
    oracles: Sequence[Oracle[Any]]
    workers: int
    tally: Tally
    title: str
    log: Path

    def instantiated(self, instantiator: Instantiator, index: Index) -> tuple[Instantiation, tuple[RunFault, ...]]:
        """The campaign's instantiation, and faults of producers.

        Raises:
            CampaignError: a constraint can't be evaluated, constraints leave nothing, or a design is too large.
            StoreError: the store can't be used.
            PrefectUnavailable: Prefect's API can't be had.
        """
        found: list[Instantiated] = []
        unavailable: PrefectUnavailable | None = None
        for _ in range(WAVES):
            self.opened.store.survey()
            if (stored := instantiator.stored()) is not None:
                found.append(stored)
                break
            if unavailable is not None:  # tasks end without Prefect's API, but these did not
                raise unavailable

            def plan(evaluator: Evaluator) -> None:
                self.tally.begin("instantiating")
                found.append(instantiator.instantiated(evaluator))

            def flow(engine: Engine) -> Any:
                from vastflow.flows.stages import flows as stage_flows

                return stage_flows.instantiate(self.title, self.opened.name, engine, plan, return_state=True)

            error = self._computation(index).run(flow)
            if error is None:
                break
            found.clear()
            if isinstance(error, PrefectUnavailable):
                unavailable = error
            elif not isinstance(error, Lost):
                raise error
        if not found:
            raise StoreError(
                f"store: {self.opened.store.place!r} loses what is written to it; is the disk full or broken?"
            )
        faults = (RunFault("", None, "instantiate", str(fault)) for fault in found[-1].faults)
        return found[-1].instantiation, tuple(faults)

    def completed(
        self,
        index: Index,
        members: Sequence[Member],
        whole: Callable[[Member], bool],
        upstream: Callable[[Member], list[list[Any]]] | None = None,
        begin: Callable[[Engine, Sequence[Member]], None] = lambda engine, members: None,
    ) -> tuple[RunFault, ...]:
        """Compute what is missing; gives the faults that are left.

        Args:
            members: All of them: they are cut into the same shards whatever is missing.
            whole: Whether the store has everything of a member.
            upstream: Of a member what the stage before gave, a row for each block; None for the first stage.
            begin: Lets workers begin with the members that miss something while Prefect starts.

        Raises:
            StoreError: the store can't be used.
            PrefectUnavailable: Prefect's API can't be had.
        """
        faults: tuple[RunFault, ...] = ()
        unavailable: PrefectUnavailable | None = None
        for _ in range(WAVES):
            self.tally.begin("scanning")
            self.opened.store.survey()
            absent = [member for member in members if not whole(member)]
            if {member.name for member in absent} <= {fault.configuration for fault in faults}:
                return faults
            if unavailable is not None:  # tasks end without Prefect's API, but these did not
                raise unavailable
            self.tally.begin("starting Prefect")
            computation = self._computation(index)
            error = computation.run(
                lambda engine, absent=absent: self._flow(engine, members, absent, upstream),
                lambda engine, absent=absent: begin(engine, absent),
            )
            faults = tuple(
                RunFault(each.member, each.run_index, each.stage, each.error) for each in computation.engine.faults
            )
            if isinstance(error, PrefectUnavailable):
                unavailable = error
            elif error is not None:
                from vastflow.flows.computing.task_runs import TaskFailed

                if not isinstance(error, TaskFailed):
                    raise error
                return (*faults, RunFault("", None, "flow", str(error)))
        if all(map(whole, members)):
            return faults
        raise StoreError(f"store: {self.opened.store.place!r} loses what is written to it; is the disk full or broken?")

    def _flow(
        self,
        engine: Engine,
        members: Sequence[Member],
        absent: Sequence[Member],
        upstream: Callable[[Member], list[list[Any]]] | None,
    ) -> Any:
        from vastflow.flows.stages import flows as stage_flows
        from vastflow.tasks.stages import Shard

        wanted = {member.name for member in absent}
        cut = [[members[i] for i in part] for part in chunks([member.scenario.digest for member in members])]
        shards = [Shard(part) for part in cut if any(member.name in wanted for member in part)]
        rows: list[Rows] = [[upstream(m) for m in shard.members] for shard in shards] if upstream else []
        self.tally.begin("running")
        flow = getattr(stage_flows, self.stage)
        return flow(self.title, stage_flows.StageJob(self.opened.name, engine, shards, rows), return_state=True)

    def _computation(self, index: Index) -> Computation:
        return Computation(index, pickle.dumps(tuple(self.oracles)), self.workers, self.tally, self.log)


@contextmanager
def stage_call(
    opened: OpenCampaign,
    stage: str,
    oracles: Sequence[Oracle[Any]] = (),
    workers: int | None = None,
    observer: Observer | None = None,
) -> Iterator[StageCall]:
    """Begin a call: Ctrl-C and SIGTERM end it within seconds, what it says goes to a log below the store's local folder."""
    created, tally = datetime.now(), Tally()
    with ending.terminable(), Reporter(tally, observer):
        log = chatter.new_log(opened.store.local / "logs", f"{directory_name(opened.name)}-{stage}", created)
        with chatter.own_log(log):
            title = f"{stage} {opened.name} {created:%Y-%m-%d %H:%M:%S}"
            yield StageCall(opened, stage, oracles, workers or cores(), tally, title, log)
