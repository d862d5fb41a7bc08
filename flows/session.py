"""A session: one call's way from a campaign that was read to artifacts that are all in the store."""

import contextvars
import functools
import pickle
import threading
from collections.abc import Callable, Sequence
from contextlib import ExitStack, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

from vastflow.flows.members import members_of, narrowed
from vastflow.flows.results import ConfigurationResult, RunFault
from vastflow.oracles.oracle import Oracle
from vastflow.oracles.verdict import read_verdicts
from vastflow.producers.configuration import Configuration
from vastflow.producers.instantiate import Instantiation
from vastflow.tasks import chatter, ending
from vastflow.tasks.instantiation import Evaluator, Instantiated, Instantiator
from vastflow.tasks.pool import Pool, PoolClosed
from vastflow.tasks.progress import Tally
from vastflow.tasks.server import ApiServer, configured_url, embedded, end_services
from vastflow.tasks.shelf import Member, Shelf, Shelved, missing
from vastflow.tasks.store import Lost, StoreError
from vastflow.tasks.work import BEHAVIORS, OUTPUTS, RECORDINGS, RUN_LOG, TRACES, VERDICTS
from vastflow.tasks.workshop import MemberFault, Workshop, block_size, judgements

WAVES: Final = 3
"""How often what got lost meanwhile is computed again before it is given up."""

_JOIN_S: Final = 3.0


@dataclass(frozen=True, slots=True)
class CampaignFault:
    """Something of ours that broke, of no single configuration."""

    stage: str
    error: str


class Session:
    """Completes a campaign's artifacts and reads them.

    Args:
        title: Name of Prefect's flow run.
        runs: Of each configuration.
        only: Names of families or configurations; empty for all.
        workers: Worker processes.
        prefect_results: Folder for the results of Prefect's tasks.
        log: File for all that would be said on the terminal otherwise.
    """

    def __init__(
        self,
        title: str,
        instantiator: Instantiator,
        shelf: Shelf,
        oracles: Sequence[Oracle[Any]],
        runs: int,
        only: Sequence[str],
        workers: int,
        tally: Tally,
        prefect_results: Path,
        log: Path,
    ) -> None:
        self.runs = runs
        self._title = title
        self._instantiator = instantiator
        self._shelf = shelf
        self._oracles = pickle.dumps(tuple(oracles))
        self._only = only
        self._workers = workers
        self._tally = tally
        self._prefect_results = prefect_results
        self._log = log
        self._instantiated: Instantiated | None = None
        self._members: dict[str, Member] = {}
        self._shelved: dict[str, list[Shelved]] = {}
        self._missing_runs = 0
        self._faults: tuple[MemberFault, ...] = ()
        self._flow_fault: CampaignFault | None = None

    @property
    def campaign_faults(self) -> list[CampaignFault]:
        """Faults that concern no single configuration."""
        faults = [
            CampaignFault("instantiate", f"{fault.producer} of {fault.family}: {fault.error}")
            for fault in (self._instantiated.faults if self._instantiated else ())
        ]
        return [*faults, *filter(None, [self._flow_fault])]

    def complete(self) -> Instantiation:
        """Compute all that is missing. Prefect starts only if something is.

        Raises:
            CampaignError: a name in `only` is unknown.
            StoreError: the store can't be used, or no longer.
        """
        for _ in range(WAVES):
            self._shelf.store.survey()
            if self._instantiated is None and (stored := self._instantiator.stored()) is not None:
                self._instantiate(stored)
            broken = {fault.member for fault in self._faults}
            if self._instantiated is not None and self._scan() <= broken:
                return self._instantiated.instantiation
            self._compute()
        if self._instantiated is None:
            raise Lost("what the producers made is lost again and again")
        self._shelf.store.survey()
        self._scan()
        return self._instantiated.instantiation

    def found(self, configuration: Configuration) -> ConfigurationResult:
        """Read what `complete` found of a configuration.

        Raises:
            Lost: something is missing that should not be.
        """
        member = self._members[configuration.name]
        faults = [
            RunFault(member.name, fault.run_index, fault.stage, fault.error)
            for fault in self._faults
            if fault.member == member.name
        ]
        load = self._shelf.store.load
        shelved = self._shelved[member.name]
        recordings = [load(each.recordings, RECORDINGS) for each in shelved]
        traces = [load(each.trace, TRACES) for each in shelved if each.trace]
        verdicts = [v for each in shelved if each.verdicts for v in read_verdicts(load(each.verdicts, VERDICTS))]
        if not faults and not {verdict.run_index for verdict in verdicts}.issuperset(range(member.runs)):
            if self._flow_fault is None:
                raise Lost(f"results of {member.name}")
            faults = [RunFault(member.name, None, self._flow_fault.stage, self._flow_fault.error)]
        behaviors = [load(each.recordings, BEHAVIORS) for each in shelved]
        outputs = [load(each.recordings, OUTPUTS) for each in shelved if OUTPUTS in each.recordings.files]
        logs = [log for each in shelved if (log := self._shelf.store.beside(each.recordings.key, RUN_LOG))]
        return ConfigurationResult(recordings, traces, verdicts, faults, behaviors, outputs, logs)

    def _instantiate(self, instantiated: Instantiated) -> None:
        instantiation = narrowed(instantiated.instantiation, self._only, self._instantiator.campaign.path)
        self._instantiated = Instantiated(instantiation, instantiated.faults)
        self._members = {member.name: member for member in members_of(instantiation, self.runs)}
        self._tally.expect(dict.fromkeys(self._members, self.runs))

    def _scan(self) -> set[str]:
        """Look what is in the store and count it; give the names of members that are not complete."""
        self._tally.begin("scanning")
        incomplete = set()
        self._missing_runs = 0
        for member in self._members.values():
            shelved = self._shelf.shelved(member)
            for each in shelved:
                self._tally.reuse(member.name, range(each.block.start, each.block.stop))
                if each.verdicts:
                    self._tally.judge(member.name, judgements(each.verdicts))
            absent = missing([each.block for each in shelved], member.runs)
            self._missing_runs += len(absent)
            if absent or not all(each.verdicts for each in shelved):
                incomplete.add(member.name)
            self._shelved[member.name] = shelved
        return incomplete

    def _compute(self) -> None:
        """One run of the flow, with a pool of its own and, where none is configured, an API of its own."""
        self._tally.begin("starting Prefect")
        self._flow_fault = None
        server = ApiServer(self._log)
        pool = Pool(self._workers, self._log)
        workshop = Workshop(self._shelf, pool, self._tally, self._oracles)
        flow = _Thread(lambda: self._run_flow(workshop, server))
        try:
            self._begin_early(workshop)
            flow.start()
            try:
                flow.outcome()
            finally:
                if workshop.store_error is not None:  # what else broke follows from it
                    raise workshop.store_error
            self._faults = workshop.faults
        except KeyboardInterrupt:
            bound = ending.bound(lambda: server.stop(0)) if ending.owns_process() else None
            chatter.hush()
            pool.close()
            if not server.answers:
                server.stop(0)  # the flow waits for it
            if flow.ended(_JOIN_S) and bound is not None:
                bound.cancel()
            server.stop(0)
            raise
        finally:
            pool.close()
            server.stop()

    def _begin_early(self, workshop: Workshop) -> None:
        """Let the workers begin while Prefect starts: with what is missing, or at least with compiling kernels."""
        if self._instantiated is None:
            workshop.warm_up()
        elif self._missing_runs:
            workshop.warm_up()
            workshop.block_runs = block_size(self._missing_runs, self._workers)
            members = list(self._members.values())
            threading.Thread(target=_start_all, args=(workshop, members), daemon=True).start()

    def _run_flow(self, workshop: Workshop, server: ApiServer) -> None:
        with ExitStack() as stack:
            stack.enter_context(chatter.prefect_log(self._log))
            from vastflow.flows.campaign import Job, TaskFailed, campaign
            from vastflow.tasks.stages import Bench

            if configured_url() is None:
                stack.enter_context(embedded(server.url()))
            else:
                server.stop(0)
            bench = Bench(workshop, self._prefect_results)
            job = Job(bench, lambda evaluator: self._plan(workshop, evaluator), lambda: self._tally.begin("running"))
            state = campaign(self._title, job, return_state=True)
            end_services()
        error = None if state.is_completed() else state.result(raise_on_failure=False)
        if isinstance(error, Lost):
            self._instantiated = None
        elif isinstance(error, TaskFailed):
            self._flow_fault = CampaignFault("flow", str(error))
        elif error is not None:
            raise error

    def _plan(self, workshop: Workshop, evaluator: Evaluator) -> list[Member]:
        if self._instantiated is None:
            self._tally.begin("instantiating")
            self._instantiate(self._instantiator.instantiated(evaluator))
            self._scan()
            workshop.block_runs = block_size(self._missing_runs, self._workers)
        return list(self._members.values())


class _Thread:
    """A call in a thread of its own: Prefect's flow must not find a notebook's event loop, nor Ctrl-C.

    What the caller's context holds goes along, so that inside a flow run of Prefect's this one is its child.
    """

    def __init__(self, function: Callable[[], None]) -> None:
        self._function = functools.partial(contextvars.copy_context().run, function)
        self._error: BaseException | None = None
        self._done = threading.Event()
        self._thread = threading.Thread(target=self._call, name="vastflow flow", daemon=True)

    def start(self) -> None:
        self._thread.start()

    def ended(self, timeout_s: float) -> bool:
        """Whether it ends within `timeout_s`."""
        return self._done.wait(timeout_s)

    def outcome(self) -> None:
        """Wait for the end; raises what the function raised."""
        while not self._done.wait(1.0):  # with a time limit, so that Ctrl-C is heard on every system
            pass
        if self._error is not None:
            raise self._error

    def _call(self) -> None:
        try:
            self._function()
        except BaseException as error:  # noqa: BLE001 - raised again in the thread that waits
            self._error = error
        finally:
            self._done.set()


def _start_all(workshop: Workshop, members: Sequence[Member]) -> None:
    with suppress(PoolClosed, StoreError):  # the flow meets the same
        for member in members:
            workshop.start_executing(member)
