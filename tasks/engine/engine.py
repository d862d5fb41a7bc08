"""The engine: computes the artifacts of a campaign that the store lacks, by units that an executor runs.

Prefect is not needed here: `vastflow.tasks.prefect.stages` puts its tasks round these methods.
"""

import functools
import threading
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence
from concurrent.futures import Future
from dataclasses import dataclass, replace
from typing import Any, Final, Generic, Protocol, TypeAlias, TypeVar

from vastflow.oracles.judgment.oracle import Oracle
from vastflow.sim.model.digest import Value
from vastflow.sim.model.faults import FileError
from vastflow.sim.system.keys import CONTROLLER_KEY, FILE_KEY
from vastflow.sim.system.robot import NAMESPACE_KEY
from vastflow.sim.system.system import system_of
from vastflow.tasks.engine import work
from vastflow.tasks.engine.evaluation import PackedProducer
from vastflow.tasks.engine.executor import ClusterError, Executor, PoolClosed, Priority, Shared, WorkerDied
from vastflow.tasks.engine.index import ConfigurationRuns, FoundRuns, Index, missing
from vastflow.tasks.engine.instantiation import Evaluation
from vastflow.tasks.engine.progress import Tally
from vastflow.tasks.engine.units import Feeder, Unit, Units
from vastflow.tasks.engine.work import Broken, Executed, WorkStage
from vastflow.tasks.store.artifact import Block, Stored
from vastflow.tasks.store.store import Artifact, StoreError


def controllers_in(systems: Iterable[Mapping[str, Value]]) -> list[dict[str, Value]]:
    """Return the part of system dimensions that chooses a controller, once for each controller that can be read."""
    found: dict[str, dict[str, Value]] = {}
    for system in systems:
        choice = {key: system[key] for key in (FILE_KEY, NAMESPACE_KEY, CONTROLLER_KEY) if key in system}
        try:
            found.setdefault(system_of(choice).software, choice)
        except FileError:
            continue
    return list(found.values())


ATTEMPTS: Final = 3
"""Maximum number of attempts at artifacts that the store loses."""

Rows: TypeAlias = list[list[list[Any]]]
"""Start, stop, and content digests of each block of each configuration."""

T = TypeVar("T")


@dataclass(frozen=True, slots=True)
class StageOutcome(Generic[T]):
    """The outcome of a stage.

    Attributes:
        made: Its results, without those that broke.
        there: Number of its `wanted` artifacts that the store had before.
    """

    made: T
    there: int
    wanted: int


@dataclass(frozen=True, slots=True)
class RunFault:
    """A fault: the run is not judged, and never counted as a failure of the robot.

    Attributes:
        configuration: Its name; empty for the whole campaign.
        run_index: None for all runs of the configuration.
        stage: A stage of the campaign, `report` or `postprocessing`.
        error: The cause in one line: a scenario that can't work, or an error of ours.
    """

    configuration: str
    run_index: int | None
    stage: str
    error: str


class RunsWanted(Protocol):
    """A stopping rule: the number of runs that a configuration wants by the verdicts it has."""

    @property
    def most(self) -> int:
        """Maximum number of runs of a configuration."""

    def stored(self, index: Index, configuration: ConfigurationRuns) -> tuple[ConfigurationRuns, list[Stored]]:
        """Return the configuration with its wanted runs, and the store's artifacts of them."""


class Engine:
    """Computes a campaign's artifacts that the store lacks, stage by stage.

    Args:
        oracles: Oracles that judge the runs.
        stopping: None where the number of runs of a configuration is fixed.
        whole_units: Whether a unit of runs is observed and judged where it was executed: verdicts are known unit by unit, and the later
            stages find them in the store. Else it is executed only.
        pace: Is given the scenario and the seed of each unit before it is executed, see `Pace.keep`.

    Attributes:
        index: The campaign's artifacts in the store.
        ended_by: The error that ended everything: the store or the cluster can't be used.
    """

    def __init__(
        self,
        index: Index,
        executor: Executor,
        tally: Tally,
        oracles: Sequence[Oracle[Any]],
        stopping: RunsWanted | None = None,
        *,
        whole_units: bool = False,
        pace: Callable[..., object] = lambda *_: None,
    ) -> None:
        self.index = index
        self.ended_by: StoreError | ClusterError | None = None
        self._store = index.store.for_sources(index.keys.sources)
        self._executor = executor
        self._tally = tally
        self._given = tuple(oracles)
        self._stopping = stopping
        self._whole_units, self._pace = whole_units, pace
        self._lock = threading.Lock()
        self._ready: Future[Any] | None = None
        self._feeder = Feeder(lambda: executor.workers, self._execute)
        self._executing: dict[tuple[str, int], Units | None] = {}
        self._made: set[str] = set()
        self._faults: list[RunFault] = []

    @functools.cached_property
    def _oracles(self) -> Shared:
        return self._executor.shared(self._given)

    @property
    def faults(self) -> tuple[RunFault, ...]:
        """All faults so far."""
        with self._lock:
            return tuple(dict.fromkeys(self._faults))  # a flow that is begun again meets them again

    @property
    def broken(self) -> frozenset[str]:
        """Names of the configurations with a fault."""
        return frozenset(fault.configuration for fault in self.faults)

    @property
    def workers(self) -> int:
        return self._executor.workers

    def workers_table(self) -> list[dict[str, Any]]:
        return self._executor.workers_table()

    @property
    def closed(self) -> bool:
        """True once the campaign was ended or its store is unusable."""
        return self._executor.closed

    def close(self) -> None:
        """End the workers and all units; may be called twice."""
        self._executor.close()

    def rest(self) -> None:
        """Let idle workers go; the next unit starts new ones."""
        self._executor.rest()

    def check(self) -> None:
        """Raise an error if the engine is closed.

        Raises:
            StoreError, ClusterError: the store or the cluster can't be used.
            PoolClosed: the campaign was ended.
        """
        if self.ended_by is not None:
            raise self.ended_by
        if self.closed:
            raise PoolClosed

    def attempts(self) -> Iterator[int]:
        """Yield attempts at the same artifacts; each computes those lost during the previous one.

        Raises:
            StoreError: all failed.
        """
        for attempt in range(ATTEMPTS):
            if attempt:
                with self._lock:
                    self._executing.clear()  # what was computed then is lost
            self.index.store.refresh()
            yield attempt
        place = self.index.store.place
        raise StoreError(f"store: {place!r} loses what is written to it. Is the disk full or broken?")

    def scan(self, configurations: Iterable[ConfigurationRuns]) -> dict[str, FoundRuns]:
        """Return the store's artifacts of configurations, by name, and count them."""
        broken, scanned = self.broken, {}
        for each in configurations:
            stopping = self._stopping
            configuration, stored = stopping.stored(self.index, each) if stopping else (each, self.index.stored(each))
            found = scanned[each.name] = FoundRuns(configuration, tuple(stored))
            if stopping is not None:
                # Configurations with a fault are not scheduled again.
                goes_on = not found.complete and each.name not in broken
                self._tally.want(each.name, configuration.runs, stopping.most if goes_on else configuration.runs)
            for one in stored:
                self._tally.reuse(each.name, range(one.block.start, one.block.stop))
                if one.verdicts:
                    self._tally.judge(each.name, *said(one.verdicts))
        return scanned

    def begin(self, found: Iterable[FoundRuns]) -> None:
        """Let workers compute missing runs, after the compilation of kernels where a robot drives."""
        absent = [each.configuration for each in found if each.missing_runs]
        self.warm_up(configuration.scenario.system for configuration in absent if configuration.drives)
        self.start(absent)

    def warm_up(self, systems: Iterable[Mapping[str, Value]]) -> None:
        """Compile the kernels for some systems.

        Args:
            systems: System dimensions of scenarios in which a robot drives.
        """
        if needed := controllers_in(systems):
            self._ready = self._executor.prepare(work.answered, work.compile_kernels, needed)

    def start(self, configurations: Sequence[ConfigurationRuns]) -> list[Units | None]:
        """Let workers compute missing runs, once per wanted number of runs; None for units that `execute` has waited for."""
        with self._lock:
            keys = [(each.name, each.runs) for each in configurations]
            # Stages of several shards ask for the same units: who comes first starts them, the others wait for the same
            # futures.
            new = [each for key, each in zip(keys, configurations, strict=True) if key not in self._executing]
            wanted = [(each, missing(self.index.blocks(each), each.runs)) for each in new]
            for configuration, units in zip(new, self._feeder.add(wanted), strict=True):
                self._executing[configuration.name, configuration.runs] = units
            return [self._executing[key] for key in keys]

    def forget(self, configurations: Collection[str]) -> None:
        """Forget faults and units of configurations, so that a request computes them again."""
        with self._lock:
            self._faults = [fault for fault in self._faults if fault.configuration not in configurations]
            self._executing = {key: units for key, units in self._executing.items() if key[0] not in configurations}

    def add_faults(self, faults: Sequence[RunFault]) -> None:
        with self._lock:
            self._faults += faults
        for fault in faults:
            self._tally.fault(fault.configuration, fault.run_index, fault.stage, fault.error)

    def evaluate(self, producer: PackedProducer, evaluations: Sequence[Evaluation]) -> StageOutcome[dict[str, str]]:
        """Evaluate a producer where the store lacks it; return the errors by key."""
        store = self.index.store
        jobs = {
            each.key: self._submit(Priority.EVALUATE, work.evaluate, self._store, each.key, producer, each.inputs)
            for each in evaluations
            if store.find(each.key) is None
        }
        # All are submitted before the first is waited for.
        answers = {key: self._answer(job) for key, job in jobs.items()}
        for key in jobs:
            store.changed(key)
        errors = {key: answer.error for key, answer in answers.items() if isinstance(answer, Broken)}
        return StageOutcome(errors, len(evaluations) - len(jobs), len(evaluations))

    def execute(self, configurations: Sequence[ConfigurationRuns]) -> StageOutcome[Rows]:
        """Execute missing runs; return start, stop, and content digest of each configuration's blocks."""
        started = [(units.configuration, units.wait()) for units in self.start(configurations) if units is not None]
        there = len(configurations) - sum(bool(units) for _, units in started)
        for configuration, begun in started:
            units, told = list(begun), True
            for unit in units:
                answer = self._answer(unit.future)
                # An answer that lists its artifacts spares looking them up; one without makes the store look again.
                told = told and isinstance(answer, Executed) and bool(answer.artifacts)
                if isinstance(answer, Broken):
                    runs = self._lost_runs(configuration, unit)
                    if answer.died and unit.stop - unit.start > 1:
                        # One run may have killed the workers of all: each gets a unit of its own.
                        units += [Unit(run, run + 1, self._execute(configuration, run, run + 1)) for run in runs]
                    else:
                        self._fault(configuration, runs, "execute", answer)
                elif isinstance(answer, Executed):
                    for run_index, error in answer.broken.items():
                        self._fault(configuration, [run_index], "execute", error)
            if units and not told:
                self.index.store.changed(self.index.keys.recordings(configuration.checked))
            with self._lock:  # answers would stay in memory to the end of the campaign
                self._executing[configuration.name, configuration.runs] = None
        found = [self.index.blocks(configuration) for configuration in configurations]
        rows = [[[block.start, block.stop, block.content] for block in blocks] for blocks in found]
        return StageOutcome(rows, there, len(configurations))

    def _lost_runs(self, configuration: ConfigurationRuns, unit: Unit) -> list[int]:
        """Return the runs of a unit without a recording; what an oracle killed has them, and its stage names it."""
        self.index.store.changed(self.index.keys.recordings(configuration.checked))
        return [run for run in missing(self.index.blocks(configuration), unit.stop) if run >= unit.start]

    def _execute(self, configuration: ConfigurationRuns, start: int, stop: int) -> "Future[Any]":
        """Hand a unit to the executor."""
        # Workers that compiled at once would each compile the same kernels: one fills the cache first.
        if self._ready is not None and configuration.drives:
            self._answer(self._ready)
        self._pace(configuration.scenario, self.index.keys.seed)
        # Workers need no sources: their digests are in the keys.
        keys, scenario = replace(self.index.keys, sources=None), configuration.scenario
        priority, checked = Priority.EXECUTE, configuration.checked
        if self._whole_units:
            unit = self._store, keys, checked, scenario, start, stop, self._oracles
            future = self._submit(priority, work.compute, *unit)
        else:
            recordings = keys.recordings(checked)
            future = self._submit(priority, work.execute, self._store, recordings, scenario, start, stop, keys.seed)
        future.add_done_callback(lambda done: self._count(configuration, done))
        return future

    def _count(self, configuration: ConfigurationRuns, done: "Future[Any]") -> None:
        if done.cancelled() or done.exception() is not None or not isinstance(answer := done.result(), Executed):
            return
        self._tally.execute(configuration.name, answer.simulated_s)
        self._feeder.took(configuration.family, len(answer.simulated_s), answer.took_s)
        self.index.store.learn(answer.artifacts)
        # What was made here does not count as found in the store, or a report would claim cache hits.
        self._made.update(artifact.key for artifact in answer.artifacts)
        for artifact in answer.artifacts:
            if artifact.key.startswith("judge/"):
                self._tally.judge(configuration.name, *said(artifact))

    def observe(self, configurations: Sequence[ConfigurationRuns], recorded: Rows) -> StageOutcome[Rows]:
        """Observe recorded blocks; rows gain the content digest of the trace."""

        def submit(configuration: ConfigurationRuns, block: Block, key: str) -> "Future[Any]":
            arguments = (self._store, block.key, key, configuration.scenario)
            return self._submit(Priority.OBSERVE, work.observe, *arguments)

        keys = [self.index.trace_key(*each) for each in self._blocks(configurations, recorded)]
        return self._derived("observe", configurations, recorded, keys, submit)

    def judge(self, configurations: Sequence[ConfigurationRuns], observed: Rows) -> StageOutcome[Rows]:
        """Judge observed blocks; rows gain the content digest of the verdicts."""
        keyed = self.index.keys.by_oracle

        def submit(configuration: ConfigurationRuns, block: Block, key: str) -> "Future[Any]":
            trace = self.index.trace_key(configuration, block)
            arguments = (self._store, block.key, trace, key, configuration.scenario, self._oracles)
            return self._submit(Priority.JUDGE, work.judge, *arguments, keyed, self.index.held(key))

        traces = [str(row[3]) for of_configuration in observed for row in of_configuration]
        blocks = self._blocks(configurations, observed)
        keys = [self.index.verdicts_key(*each, trace) for each, trace in zip(blocks, traces, strict=True)]
        return self._derived("judge", configurations, observed, keys, submit)

    def _derived(
        self,
        stage: WorkStage,
        configurations: Sequence[ConfigurationRuns],
        rows: Rows,
        keys: Sequence[str],
        submit: Callable[[ConfigurationRuns, Block, str], "Future[Any]"],
    ) -> StageOutcome[Rows]:
        """Compute the missing artifacts of `keys`, one for each row; rows gain their content digests."""
        store, blocks = self.index.store, self._blocks(configurations, rows)
        jobs = [submit(*each, key) if store.find(key) is None else None for each, key in zip(blocks, keys, strict=True)]
        for (configuration, block), job in zip(blocks, jobs, strict=True):
            if job is not None and isinstance(answer := self._answer(job), Broken):
                self._fault(configuration, range(block.start, block.stop), stage, answer)
        for key, job in zip(keys, jobs, strict=True):
            if job is not None:
                store.changed(key)
        # Rows and keys are in one order; a row without an artifact has a fault, and is left out for the stages that
        # follow.
        following = iter(keys)
        made: Rows = []
        for configuration, of_configuration in zip(configurations, rows, strict=True):
            found = [(row, store.find(next(following))) for row in of_configuration]
            made.append([[*row, artifact.content] for row, artifact in found if artifact is not None])
            if stage == "judge":
                for _, verdicts in found:
                    if verdicts is not None:
                        self._tally.judge(configuration.name, *said(verdicts))
        there = sum(job is None and key not in self._made for key, job in zip(keys, jobs, strict=True))
        return StageOutcome(made, there, len(blocks))

    def _blocks(self, configurations: Sequence[ConfigurationRuns], rows: Rows) -> list[tuple[ConfigurationRuns, Block]]:
        return [
            (configuration, self.index.block(configuration, int(row[0]), int(row[1]), str(row[2])))
            for configuration, of_configuration in zip(configurations, rows, strict=True)
            for row in of_configuration
        ]

    def _fault(self, configuration: ConfigurationRuns, runs: Sequence[int], stage: WorkStage, broken: Broken) -> None:
        self.add_faults(
            [RunFault(configuration.name, run, stage, broken.error) for run in runs if run < configuration.runs]
        )
        self._tally.judge(configuration.name, dict.fromkeys(runs, "not judged"))

    def _submit(self, priority: Priority, function: Callable[..., Any], *arguments: Any) -> "Future[Any]":
        # Before anything is computed that could not be stored.
        if self._store.unwritable is not None:
            raise self._store.unwritable
        return self._executor.submit(work.answered, function, *arguments, priority=priority)

    def _answer(self, job: "Future[Any]") -> Any:
        """Return the answer of a job; the death of a worker is `Broken` like other errors."""
        try:
            return job.result()
        except PoolClosed:
            raise
        except (StoreError, ClusterError) as error:
            self.ended_by = error
            self._executor.close()  # the other jobs would find out one by one
            raise
        except WorkerDied as error:
            return Broken(str(error), died=True)
        except Exception as error:  # noqa: BLE001 - what can't be pickled, say: one configuration's fault
            return work.broken(error)


def judgments(verdicts: Artifact) -> dict[int, str]:
    """Return run index to the judgment of all oracles together."""
    return said(verdicts)[0]


def said(verdicts: Artifact) -> tuple[dict[int, str], dict[int, str]]:
    """Return run index to the judgment of all oracles together, and failed run to its cause."""
    info = verdicts.info
    judged = {int(run_index): str(judgment) for run_index, judgment in info["runs"]}
    return judged, {int(run_index): str(cause) for run_index, cause in info.get("causes", ())}
