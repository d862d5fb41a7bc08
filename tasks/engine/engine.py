"""The engine: computes the artifacts of a campaign that the store lacks, in a pool of worker processes.

Prefect is not needed here: `vastflow.tasks.prefect.stages` puts its tasks round these methods.
"""

import threading
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence
from concurrent.futures import Future
from contextlib import suppress
from dataclasses import dataclass
from typing import Any, Final, Generic, Protocol, TypeAlias, TypeVar

from vastflow.sim.model.digest import Value
from vastflow.sim.model.faults import FileError
from vastflow.sim.nav2.parameter_files.chosen import CONTROLLER_KEY, parameters_of
from vastflow.sim.nav2.parameter_files.parameter_file import FILE_KEY
from vastflow.tasks.engine import work
from vastflow.tasks.engine.evaluation import PackedProducer
from vastflow.tasks.engine.index import ConfigurationRuns, FoundRuns, Index, missing, run_blocks
from vastflow.tasks.engine.instantiation import Evaluation
from vastflow.tasks.engine.pool import Pool, PoolClosed, Priority, WorkerDied
from vastflow.tasks.engine.progress import Tally
from vastflow.tasks.engine.work import Broken, Executed, WorkStage
from vastflow.tasks.store.artifact import Block, Stored
from vastflow.tasks.store.store import Artifact, StoreError


def controllers_in(systems: Iterable[Mapping[str, Value]]) -> list[dict[str, Value]]:
    """Return the part of system dimensions that chooses a controller, once for each controller that can be read."""
    found: dict[type, dict[str, Value]] = {}
    for system in systems:
        choice = {key: system[key] for key in (FILE_KEY, CONTROLLER_KEY) if key in system}
        try:
            found.setdefault(type(parameters_of(choice).controller), choice)
        except FileError:
            continue
    return list(found.values())


ATTEMPTS: Final = 3
"""Maximum number of attempts at artifacts that the store loses."""

MOST_RUNS_A_BLOCK: Final = 20
_BLOCKS_A_WORKER: Final = 4

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
        """Return the configuration with the runs that are wanted by now, and what the store has of these."""


@dataclass(frozen=True, slots=True)
class _Job:
    """Runs in the pool."""

    start: int
    stop: int
    future: "Future[Any]"


class Engine:
    """Brings one campaign's artifacts into the store, stage by stage, by a pool of worker processes.

    A stage computes only what the store lacks, and keeps faults.

    Args:
        oracles: The pickled oracles.
        stopping: None where the number of runs of a configuration is fixed.

    Attributes:
        index: The campaign's artifacts in the store.
        block_runs: Maximum number of runs of a new block, see `block_size`.
        store_error: The error that made the store unusable and ended everything.
    """

    def __init__(
        self, index: Index, pool: Pool, tally: Tally, oracles: bytes, stopping: RunsWanted | None = None
    ) -> None:
        self.index = index
        self.block_runs = MOST_RUNS_A_BLOCK
        self.store_error: StoreError | None = None
        self._store = index.store.for_sources(index.keys.sources)
        self._pool = pool
        self._tally = tally
        self._oracles = oracles
        self._stopping = stopping
        self._lock = threading.Lock()
        self._warm: Future[Any] | None = None
        self._executing: dict[tuple[str, int], list[_Job]] = {}
        self._faults: list[RunFault] = []

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
        """Maximum number of worker processes."""
        return self._pool.workers

    @property
    def closed(self) -> bool:
        """True once the campaign was ended or its store is unusable."""
        return self._pool.closed

    def close(self) -> None:
        """End the workers and all jobs. May be called twice."""
        self._pool.close()

    def rest(self) -> None:
        """Let idle workers go; the next job starts new ones."""
        self._pool.rest()

    def check(self) -> None:
        """Raise an error if the engine is closed.

        Raises:
            StoreError: the store can't be used.
            PoolClosed: the campaign was ended.
        """
        if self.store_error is not None:
            raise self.store_error
        if self.closed:
            raise PoolClosed

    def attempts(self) -> Iterator[int]:
        """Count attempts at the same artifacts; each computes what the store lost during the one before.

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
        raise StoreError(f"store: {place!r} loses what is written to it; is the disk full or broken?")

    def scan(self, configurations: Iterable[ConfigurationRuns]) -> dict[str, FoundRuns]:
        """Return what the store has of configurations, by name, and count it."""
        broken, scanned = self.broken, {}
        for each in configurations:
            stopping = self._stopping
            configuration, stored = stopping.stored(self.index, each) if stopping else (each, self.index.stored(each))
            found = scanned[each.name] = FoundRuns(configuration, tuple(stored))
            if stopping is not None:
                goes_on = not found.complete and each.name not in broken
                self._tally.want(each.name, configuration.runs, stopping.most if goes_on else configuration.runs)
            for one in stored:
                self._tally.reuse(each.name, range(one.block.start, one.block.stop))
                if one.verdicts:
                    self._tally.judge(each.name, judgements(one.verdicts))
        return scanned

    def begin(self, found: Iterable[FoundRuns], workers: int) -> None:
        """Hand the missing runs to the workers, after the compilation of kernels where a robot drives.

        Args:
            workers: Number of workers, each of which gets several blocks.
        """
        absent = [each for each in found if each.missing_runs]
        self.warm_up(each.configuration.scenario.system for each in absent if each.configuration.drives)
        self.block_runs = block_size(sum(each.missing_runs for each in absent), workers)
        self.start([each.configuration for each in absent])

    def start(self, configurations: Sequence[ConfigurationRuns]) -> None:
        """Hand the missing runs of configurations to the workers, in order, from a thread."""

        def start() -> None:
            with suppress(PoolClosed, StoreError):  # who waits for it meets the same
                for configuration in configurations:
                    self.start_executing(configuration)

        threading.Thread(target=start, daemon=True).start()

    def forget(self, configurations: Collection[str]) -> None:
        """Forget faults and jobs of configurations, so that they are computed again when asked for."""
        with self._lock:
            self._faults = [fault for fault in self._faults if fault.configuration not in configurations]
            self._executing = {key: jobs for key, jobs in self._executing.items() if key[0] not in configurations}

    def add_faults(self, faults: Sequence[RunFault]) -> None:
        """Add faults from elsewhere."""
        with self._lock:
            self._faults += faults

    def evaluate(self, producer: PackedProducer, evaluations: Sequence[Evaluation]) -> StageOutcome[dict[str, str]]:
        """Evaluate a producer where the store lacks it; return the errors by key."""
        store = self.index.store
        jobs = {
            each.key: self._submit(Priority.EVALUATE, work.evaluate, self._store, each.key, producer, each.inputs)
            for each in evaluations
            if store.find(each.key) is None
        }
        answers = {key: self._answer(job) for key, job in jobs.items()}
        for key in jobs:
            store.changed(key)
        errors = {key: answer.error for key, answer in answers.items() if isinstance(answer, Broken)}
        return StageOutcome(errors, len(evaluations) - len(jobs), len(evaluations))

    def warm_up(self, systems: Iterable[Mapping[str, Value]]) -> None:
        """Compile the kernels for some systems in one worker, as two at once would compile the same.

        Args:
            systems: System dimensions of scenarios in which a robot drives.
        """
        if needed := controllers_in(systems):
            self._warm = self._submit(Priority.EVALUATE, work.compile_kernels, needed)

    def start_executing(self, configuration: ConfigurationRuns) -> list["_Job"]:
        """Hand the missing runs of a configuration to the pool, once per wanted number of runs."""
        if self._warm is not None and configuration.drives:
            self._answer(self._warm)
        with self._lock:
            key = configuration.name, configuration.runs
            if key not in self._executing:
                wanted = missing(self.index.blocks(configuration), configuration.runs)
                self._executing[key] = [
                    self._start(configuration, start, stop) for start, stop in run_blocks(wanted, self.block_runs)
                ]
            return self._executing[key]

    def _start(self, configuration: ConfigurationRuns, start: int, stop: int) -> "_Job":
        keys = self.index.keys
        home = keys.recordings(configuration.checked)
        future = self._submit(
            Priority.EXECUTE, work.execute, self._store, home, configuration.scenario, start, stop, keys.seed
        )
        future.add_done_callback(lambda done: self._count(configuration, done))
        return _Job(start, stop, future)

    def _count(self, configuration: ConfigurationRuns, done: "Future[Any]") -> None:
        if done.exception() is None and isinstance(answer := done.result(), Executed):
            self._tally.execute(configuration.name, answer.simulated_s)

    def execute(self, configurations: Sequence[ConfigurationRuns]) -> StageOutcome[Rows]:
        """Execute missing runs; return start, stop, and content digest of each configuration's blocks."""
        started = [(configuration, list(self.start_executing(configuration))) for configuration in configurations]
        there = sum(not jobs for _, jobs in started)
        for configuration, jobs in started:
            for job in jobs:
                answer = self._answer(job.future)
                if isinstance(answer, Broken) and answer.died and job.stop - job.start > 1:
                    # One run may have killed the workers of all: each gets a block of its own.
                    jobs += [self._start(configuration, run, run + 1) for run in range(job.start, job.stop)]
                elif isinstance(answer, Broken):
                    self._fault(configuration, range(job.start, job.stop), "execute", answer)
                elif isinstance(answer, Executed):
                    for run_index, error in answer.broken.items():
                        self._fault(configuration, [run_index], "execute", error)
            if jobs:
                self.index.store.changed(self.index.keys.recordings(configuration.checked))
        found = [self.index.blocks(configuration) for configuration in configurations]
        rows = [[[block.start, block.stop, block.content] for block in blocks] for blocks in found]
        return StageOutcome(rows, there, len(configurations))

    def observe(self, configurations: Sequence[ConfigurationRuns], recorded: Rows) -> StageOutcome[Rows]:
        """Observe recorded blocks; rows gain the content digest of the trace."""

        def submit(configuration: ConfigurationRuns, block: Block, key: str) -> "Future[Any]":
            arguments = (self._store, block.key, key, configuration.scenario)
            return self._submit(Priority.OBSERVE, work.observe, *arguments)

        keys = [self.index.trace_key(*each) for each in self._blocks(configurations, recorded)]
        return self._derived("observe", configurations, recorded, keys, submit)

    def judge(self, configurations: Sequence[ConfigurationRuns], observed: Rows) -> StageOutcome[Rows]:
        """Judge observed blocks; rows gain the content digest of the verdicts."""

        def submit(configuration: ConfigurationRuns, block: Block, key: str) -> "Future[Any]":
            trace = self.index.trace_key(configuration, block)
            arguments = (self._store, block.key, trace, key, configuration.scenario, self._oracles)
            return self._submit(Priority.JUDGE, work.judge, *arguments)

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
        following = iter(keys)
        made: Rows = []
        for configuration, of_configuration in zip(configurations, rows, strict=True):
            found = [(row, store.find(next(following))) for row in of_configuration]
            made.append([[*row, artifact.content] for row, artifact in found if artifact is not None])
            if stage == "judge":
                for _, verdicts in found:
                    self._tally.judge(configuration.name, judgements(verdicts) if verdicts is not None else {})
        return StageOutcome(made, jobs.count(None), len(blocks))

    def _blocks(self, configurations: Sequence[ConfigurationRuns], rows: Rows) -> list[tuple[ConfigurationRuns, Block]]:
        return [
            (configuration, self.index.block(configuration, int(row[0]), int(row[1]), str(row[2])))
            for configuration, of_configuration in zip(configurations, rows, strict=True)
            for row in of_configuration
        ]

    def _fault(self, configuration: ConfigurationRuns, runs: Sequence[int], stage: WorkStage, broken: Broken) -> None:
        with self._lock:
            self._faults += [
                RunFault(configuration.name, run, stage, broken.error) for run in runs if run < configuration.runs
            ]
        self._tally.judge(configuration.name, dict.fromkeys(runs, "not judged"))

    def _submit(self, priority: Priority, function: Callable[..., Any], *arguments: Any) -> "Future[Any]":
        return self._pool.submit(priority, work.answered, function, *arguments)

    def _answer(self, job: "Future[Any]") -> Any:
        """Return the answer of a job; the death of a worker is `Broken` like other errors."""
        try:
            return job.result()
        except PoolClosed:
            raise
        except StoreError as error:
            self.store_error = error
            self._pool.close()  # the other jobs would find out one by one
            raise
        except WorkerDied as error:
            return Broken(str(error), died=True)
        except Exception as error:  # noqa: BLE001 - what can't be pickled, say: one configuration's fault
            return work.broken(error)


def block_size(runs: int, workers: int) -> int:
    """Return the maximum number of runs of a block, so that every worker gets several blocks."""
    return max(1, min(MOST_RUNS_A_BLOCK, -(-runs // (_BLOCKS_A_WORKER * workers))))


def judgements(verdicts: Artifact) -> dict[int, str]:
    """Return run index to the judgement of all oracles together."""
    return {int(run_index): str(judgement) for run_index, judgement in verdicts.info["runs"]}
