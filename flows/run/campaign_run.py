"""A run of a campaign: what it was asked, what it has opened for that, and how far it is.

The flow finds the run that its process has opened already through a context variable, as Prefect does with its own contexts; where
there is none, as in a worker of Prefect's, it opens one from the request.
"""

import os
import pickle
import time
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from contextvars import ContextVar
from dataclasses import dataclass, field, replace
from datetime import datetime
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

from vastflow.flows.request.asked import SEQUENTIAL, Asked
from vastflow.flows.request.campaign_file import campaign_name, read_campaign
from vastflow.flows.request.campaign_keys import campaign_keys
from vastflow.flows.request.configurations import Runs, Selection, distinct_configurations, narrowed
from vastflow.flows.request.run_request import RunRequest
from vastflow.flows.results.address import Delivery, delivery_to
from vastflow.flows.results.directory import directory_name
from vastflow.flows.results.found import StoredResult
from vastflow.flows.results.inputs import Inputs, inputs_of
from vastflow.flows.results.provenance import ingredients_row
from vastflow.flows.results.summary import Results, Work
from vastflow.flows.search.progress import SearchProgress, search_progress
from vastflow.oracles.judgement.oracle import Oracle
from vastflow.producers.campaign import Campaign
from vastflow.producers.model.configuration import Configuration
from vastflow.sim.model.faults import FileError
from vastflow.tasks.engine import process
from vastflow.tasks.engine.engine import Engine, RunFault, block_size
from vastflow.tasks.engine.index import ConfigurationRuns, FoundRuns, Index
from vastflow.tasks.engine.instantiation import Instantiated, Instantiator
from vastflow.tasks.engine.machine_check import check_machine
from vastflow.tasks.engine.pool import Pool, cores
from vastflow.tasks.engine.process import few_collections
from vastflow.tasks.engine.progress import Observer, Reporter, Tally
from vastflow.tasks.engine.shards import Shard, missing_shards
from vastflow.tasks.keys.keys import Keys
from vastflow.tasks.keys.source import SourceTree, installed_tree
from vastflow.tasks.prefect import campaign_log
from vastflow.tasks.store.store import Lost, Store, open_store

if TYPE_CHECKING:
    from vastflow.flows.request.stopping import Stopping
    from vastflow.flows.search.progress import PointRuns

_CURRENT: Final = ContextVar["CampaignRun | None"]("vastflow_campaign_run", default=None)


@dataclass(frozen=True, slots=True)
class Round:
    """What is computed before it is asked again what is wanted.

    Attributes:
        configurations: Something may be missing of them.
        shards: Those in which something is missing.
    """

    configurations: Sequence[ConfigurationRuns]
    shards: Sequence[Shard]


@dataclass
class CampaignRun:
    """One run of a campaign.

    Attributes:
        delivery: Where the campaign directory is made, and where it is to be.
        record: What `metadata.json` says beside what every campaign directory has.
        stopping: Says how many runs a configuration wants; None where that is fixed.
        search: The search that proposes configurations; None where the file lists them.
        log: File for all that would be said on the terminal otherwise.
        instantiated: What is run of the campaign, once that is known.
        found: Of each configuration, by name, what the store has.
        results: Once they are written.
    """

    request: RunRequest
    campaign: Campaign = field(repr=False)
    oracles: Sequence[Oracle[Any]] = field(repr=False)
    inputs: Inputs = field(repr=False)
    asked: Asked
    record: Mapping[str, Any] = field(repr=False)
    store: Store
    delivery: Delivery
    tree: SourceTree = field(repr=False)
    keys: Keys = field(repr=False)
    stopping: "Stopping | PointRuns | None"
    search: SearchProgress | None = field(repr=False)
    engine: Engine = field(repr=False)
    tally: Tally = field(repr=False)
    log: Path
    created: datetime
    clock: "CampaignClock" = field(repr=False)
    instantiated: Instantiated | None = field(default=None, repr=False)
    found: dict[str, FoundRuns] = field(default_factory=dict, repr=False)
    results: Results | None = None

    @property
    def name(self) -> str:
        """The campaign's."""
        return campaign_name(self.campaign)

    @property
    def title(self) -> str:
        """Name of the flow run until the campaign's size is known."""
        return f"{self.name} {self.created:%Y-%m-%d %H:%M:%S}"

    @property
    def workers(self) -> int:
        """Worker processes on this machine."""
        return self.request.workers or cores()

    @property
    def instantiator(self) -> Instantiator:
        """Instantiates the campaign, of a search the points under way, from what the store has."""
        if self.search is None:
            return Instantiator(self.campaign, self.store, self.keys, self.tree)
        points = self.search.campaign(self.campaign)
        return Instantiator(points, self.store, self.keys, self.tree, refuse_empty=False)

    @property
    def runs(self) -> Runs:
        """Of each configuration: all that were asked, or as many as were found to be wanted."""
        return (
            self.asked.runs
            if self.stopping is None
            else {name: each.configuration.runs for name, each in self.found.items()}
        )

    @property
    def work(self) -> Work:
        """What was done so far."""
        done = self.tally.progress()
        return Work(done.executed, done.reused, done.simulated_s, self.clock.cpu_s(), self.clock.wall_s())

    @property
    def campaign_faults(self) -> list[RunFault]:
        """Faults that concern no single configuration."""
        faults = () if self.instantiated is None else self.instantiated.faults
        return [RunFault("", None, "instantiate", str(fault)) for fault in faults]

    @property
    def incomplete(self) -> list[FoundRuns]:
        """Configurations of which something is missing that no fault explains."""
        broken = self.engine.broken
        return [each for name, each in self.found.items() if not each.complete and name not in broken]

    def complete(self) -> bool:
        """Whether the store has everything already; nothing is computed to find out."""
        self.tally.begin("scanning")
        self.store.refresh()
        return all(self.instantiated is not None and not self.incomplete for _ in self.batches())

    def batches(self) -> Iterator[None]:
        """Come to each part of the campaign that begins when the one before is judged: the whole of it; or the batches of a search,
        and in the end all its points together. It is known already where the store has what producers make of it.

        Raises:
            Lost: verdicts are damaged.
        """
        while True:
            if self.instantiated is None and (stored := self.instantiator.stored()) is not None:
                self.know(stored)
            yield
            search, known, index = self.search, self.instantiated, self.engine.index
            if search is None or known is None or not search.take(known, self.found, index, self.engine.broken):
                return
            self.engine.forget(self.found)
            self.instantiated, self.found = None, {}

    def begin(self) -> None:
        """Let workers begin with what is missing; or where that is not known yet, at least with compiling kernels.

        Of controllers those that the families name: one that a producer chooses is compiled when a robot first drives by it.
        """
        if self.instantiated is None:
            driving = (family for family in self.campaign.families if family.drives)
            self.engine.warm_up({**family.values, **family.overrides} for family in driving)
        else:
            self.engine.begin(self.incomplete, self.workers)

    def know(self, instantiated: Instantiated) -> None:
        """Take the campaign's configurations, narrowed to what was asked, and look what the store has of them.

        Raises:
            FileError: a name in `only` is unknown.
        """
        if self.search is None:
            selection = Selection(self.request.only, self.request.sample, self.campaign.seed)
            self.instantiated = narrowed(instantiated, selection, self.campaign.document.file)
        else:
            self.instantiated = self.search.named(instantiated)
        configurations = distinct_configurations(self.instantiated.instantiation, self.asked.runs)
        if self.stopping is not None:
            first = self.stopping.wanted({})
            configurations = [replace(configuration, runs=first) for configuration in configurations]
        wanted = {configuration.name: configuration.runs for configuration in configurations}
        self.tally.expect(wanted if self.search is None else self.search.expected(wanted))
        self.tally.begin("scanning")
        self.found = self.engine.scan(configurations)

    def rounds(self) -> Iterator[Round]:
        """What is missing; then, where a rule says how many runs a configuration wants, what it wants next.

        Raises:
            Lost: something of a round is missing all the same, and no fault explains it.
        """
        cut, due = [each.configuration for each in self.found.values()], self.incomplete
        while due:
            self.tally.begin("running")
            self.engine.block_runs = block_size(sum(each.missing_runs for each in due), self.workers)
            if self.request.pool is None:
                self.engine.start([each.configuration for each in due if each.missing_runs])
            before = {each.configuration.name: each.configuration.runs for each in due}
            yield Round(cut, missing_shards(cut, before))
            self.engine.check()
            self.found |= self.engine.scan([each.configuration for each in due])
            # One that lacks something of a round does not go on.
            again = [each for each in self.incomplete if each.configuration.name in before]
            due = [each for each in again if each.configuration.runs > before[each.configuration.name]]
            cut = [each.configuration for each in due]
        if lost := self.incomplete:
            raise Lost(f"results of {lost[0].configuration.name}")

    def attempts(self) -> Iterator[int]:
        """As `Engine.attempts`; each begins with a look at everything, but for the first, which a look may have gone before."""
        for attempt in self.engine.attempts():
            if attempt:
                self.instantiated = None
            yield attempt

    def result_of(self, configuration: Configuration) -> StoredResult:
        """What was found of a configuration, to be read from the store. May be called from any thread."""
        found = self.found[configuration.name]
        faults = [fault for fault in self.engine.faults if fault.configuration == configuration.name]
        return StoredResult(self.store, found.stored, found.configuration.runs, faults)

    def contents(self) -> dict[str, list[str]]:
        """Keys and contents of the verdicts of each configuration by name, in order: all results of a campaign follow into them."""
        return {
            name: [
                text for each in found.stored if each.verdicts for text in (each.verdicts.key, each.verdicts.content)
            ]
            for name, found in self.found.items()
        }


@contextmanager
def running(request: RunRequest) -> Iterator[CampaignRun]:
    """The run that this process has opened for the request, or one that is opened for this context."""
    current = _CURRENT.get()
    if current is not None and current.request == request:
        yield current
        return
    with open_run(request) as run:
        yield run


def opened_run() -> CampaignRun | None:
    """The run that this process has opened, if it has."""
    return _CURRENT.get()


@contextmanager
def open_run(request: RunRequest, observer: Observer | None = None) -> Iterator[CampaignRun]:
    """Open all that a run needs: the campaign is read and checked, its store found, its keys made. Nothing is computed yet.

    Meanwhile SIGTERM interrupts as Ctrl-C does, and what vastflow says goes to the run's log.

    Args:
        observer: Is shown the progress, from one thread.

    Raises:
        FileError: faults of the file.
        StoreError: the store can't be used.
        MachineError: this machine lacks something that a computation needs.
    """
    clock, created, tally = CampaignClock(), datetime.now(), Tally()
    with process.terminable(), few_collections(), Reporter(tally, observer):
        map_dir = None if request.map_dir is None else Path(request.map_dir)
        campaign, oracles = read_campaign(Path(request.campaign), map_dir, as_v1=request.as_v1, strict=request.strict)
        if campaign.unexecutable:
            raise FileError(campaign.unexecutable)
        inputs = inputs_of(campaign, oracles)
        store = open_store(request.store)
        delivery = delivery_to(request.results, store)
        log = campaign_log.new_log(store.local / "logs", directory_name(campaign_name(campaign)), created)
        with campaign_log.own_log(log):
            tree = installed_tree()
            keys = campaign_keys(tree, campaign.seed, oracles)
            stopping = _stopping(campaign) if request.runs is None else None
            asked = _asked(request, campaign, inputs)
            rule = {} if stopping is None else {SEQUENTIAL: stopping.as_json}
            check_machine()
            search = search_progress(campaign, request, stopping, asked.runs, store, inputs.campaign, tally)
            rule_of_runs = stopping if search is None else search.runs
            engine = Engine(
                Index(store, keys),
                Pool(request.workers or cores(), log),
                tally,
                pickle.dumps(tuple(oracles)),
                rule_of_runs,
            )
            run = CampaignRun(
                request=request,
                campaign=campaign,
                oracles=oracles,
                inputs=inputs,
                asked=asked,
                record={"asked": asked.as_json(), **rule, **ingredients_row(tree, campaign.families, oracles)},
                store=store,
                delivery=delivery,
                tree=tree,
                keys=keys,
                stopping=rule_of_runs,
                search=search,
                engine=engine,
                tally=tally,
                log=log,
                created=created,
                clock=clock,
            )
            token = _CURRENT.set(run)
            try:
                yield run
            finally:
                _CURRENT.reset(token)
                engine.close()


def _stopping(campaign: Campaign) -> "Stopping | None":
    if campaign.sequential is None:
        return None
    from vastflow.flows.request.stopping import stopping_of  # imports statistics, which take a moment

    return stopping_of(campaign.sequential)


def _asked(request: RunRequest, campaign: Campaign, inputs: Inputs) -> Asked:
    runs = campaign.runs_asked(request.runs, request.sample)
    return Asked(campaign.path.name, runs, request.only, inputs.places, request.sample, request.as_v1)


class CampaignClock:
    """Time since it was made: on the wall, and of the CPU for this process and its children that have ended."""

    def __init__(self) -> None:
        self._began_s = time.perf_counter()
        self._before_s = sum(os.times()[:4])

    def wall_s(self) -> float:
        return time.perf_counter() - self._began_s

    def cpu_s(self) -> float:
        return sum(os.times()[:4]) - self._before_s
