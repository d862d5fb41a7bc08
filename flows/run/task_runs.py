"""Task runs of a flow run: stages mapped over shards, awaited, logged, and recorded by Prefect's server."""

import contextvars
import logging
import threading
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from typing import TYPE_CHECKING, Any, Final
from uuid import UUID

from vastflow.tasks.engine.engine import Engine, RunFault
from vastflow.tasks.engine.evaluation import packed
from vastflow.tasks.engine.executor import PoolClosed
from vastflow.tasks.engine.index import FoundRuns
from vastflow.tasks.engine.instantiation import EvaluationRequest, Instantiated, Instantiator
from vastflow.tasks.engine.progress import Observer, Reporter, Tally
from vastflow.tasks.engine.shards import ProducerShard, Shard, shard_ranges
from vastflow.tasks.prefect.adapter import sent_only
from vastflow.tasks.prefect.server import drain, is_embedded

if TYPE_CHECKING:
    from prefect.futures import PrefectFuture


TASK_RUNS: Final = "prefect.task_runs"
NEVER_BEGUN: Final = "Finished in state Pending("


@contextmanager
def quiet_task_runs(engine: Engine, flow_run_id: str) -> Iterator[None]:
    """Send only warnings and errors of task runs to Prefect's API.

    Once the engine is closed the task runs of the flow run say nothing at all: each would report that it was cancelled. Nor do those
    that never began, which Prefect reports as errors where a flow run is suspended.
    """

    def is_said(record: logging.LogRecord) -> bool:
        own = getattr(record, "flow_run_id", None) == flow_run_id
        return not (own and (engine.closed or record.getMessage().startswith(NEVER_BEGUN)))

    logger = logging.getLogger(TASK_RUNS)
    logger.addFilter(is_said)
    try:
        with sent_only(TASK_RUNS, lambda each: each.levelno >= logging.WARNING or not each.name.startswith(TASK_RUNS)):
            yield
    finally:
        logger.removeFilter(is_said)


MOST_UNRECORDED: Final = 1000
"""Task runs that may have ended without Prefect's server having recorded it; of thousands at a time it loses some silently."""

CANCEL_S: Final = 5.0
"""Maximum time to tell Prefect of canceled task runs."""


class TaskRuns:
    """The task runs of the flow run that makes this object."""

    def __init__(self, engine: Engine) -> None:
        from prefect.runtime import flow_run

        self.engine = engine
        self._flow_run_id = str(flow_run.id)
        self._futures: list[PrefectFuture[Any]] = []
        self._free: dict[str, threading.Semaphore] = {}
        self._evaluations: dict[str, list[PrefectFuture[Any]]] = {}
        self._ended = self._recorded = 0

    def map(self, stage: str, shards: Sequence[Any], *upstream: Sequence[Any]) -> "list[PrefectFuture[Any]]":
        """Submit a task run for each shard, with one active task run per worker at most.

        Args:
            stage: Name of a task of `vastflow.tasks.prefect.stages`.
            upstream: Result of an earlier stage for each shard, or a future of it.

        Raises:
            StoreError, PoolClosed: see `Engine.check`.
        """
        if not shards:
            return []
        from vastflow.tasks.prefect import stages

        free = self._free.setdefault(stage, threading.Semaphore(self.engine.workers))
        mapped: list[PrefectFuture[Any]] = []
        for shard, *made in zip(shards, *upstream, strict=True):
            free.acquire()
            self.engine.check()
            follows = () if made else (each for name in shard.families for each in self._evaluations.get(name, ()))
            # In lists: of a future that is an argument itself, Prefect asks its API the state, and fails where that is away.
            before = [[each] for each in made]
            mapped.append(getattr(stages, stage).submit(shard, *before, engine=self.engine, wait_for=list(follows)))
            self._futures.append(mapped[-1])
            mapped[-1].add_done_callback(lambda _: free.release())
        if stage == "evaluate":
            families = {name for shard in shards for name in shard.families}
            pairs = list(zip(shards, mapped, strict=True))
            self._evaluations |= {name: [each for shard, each in pairs if name in shard.families] for name in families}
        return mapped

    def wait(self, shards: Sequence[Shard], *stages: "Sequence[PrefectFuture[Any]]") -> None:
        """Wait until all task runs have ended, and the server has recorded most of them.

        One that failed as a whole, which is an internal error, is a fault of its shard's configurations.

        Raises:
            StoreError, PoolClosed: see `Engine.check`.
        """
        for of_stage in stages:
            for future in of_stage:
                future.wait()
        self.engine.check()
        for of_shard in zip(shards, *stages, strict=True):
            shard, states = of_shard[0], [future.state for future in of_shard[1:]]
            if failed := next((state for state in states if not state.is_completed()), None):
                error = f"a task run ended as {failed.name}: {failed.message}"
                self.engine.add_faults(
                    [RunFault(configuration.name, None, "flow", error) for configuration in shard.configurations]
                )
        left = [future for future in self._futures if not future.state.is_final()]
        self._ended += len(self._futures) - len(left)
        self._futures = left  # the others hold their shards and what they made
        if self._ended - self._recorded >= MOST_UNRECORDED:
            self.record()

    def end(self) -> None:
        """Wait until all have ended; a flow run that is suspended says so at each of them."""
        from prefect.exceptions import Pause

        for future in self._futures:
            with suppress(Pause):
                future.wait()

    def cancel(self) -> None:
        """Cancel pending task runs, which Prefect would show as `Pending` forever."""
        from prefect.client.orchestration import get_client
        from prefect.exceptions import ObjectNotFound
        from prefect.states import Cancelled

        deadline_s = time.monotonic() + CANCEL_S
        with get_client(sync_client=True) as client:
            for future in self._futures:
                while not future.state.is_final() and time.monotonic() < deadline_s:
                    try:
                        client.set_task_run_state(future.task_run_id, Cancelled(message=str(PoolClosed())), force=True)
                        break
                    except ObjectNotFound:  # not recorded yet
                        time.sleep(CANCEL_S / 10)

    def record(self) -> None:
        """Wait until the server has recorded the task runs that have ended."""
        self.end()
        self._recorded = self._ended + sum(future.state.is_final() for future in self._futures)
        drain(self._flow_run_id, self._recorded)


@contextmanager
def task_runs_of(
    name: str, engine: Engine, tally: Tally | None = None, page: Observer | None = None
) -> Iterator[TaskRuns]:
    """Open the task runs of the current flow run, tagged with the campaign's name.

    Args:
        tally: Its progress is shown on `page`.
    """
    from prefect.runtime import flow_run

    from vastflow.flows.run.pages import INTERVAL_S, key_of, tolerated, update
    from vastflow.tasks.prefect.deployment import TAG
    from vastflow.tasks.prefect.orphans import mark_orphans, process_tags, untagged

    with untagged(), quiet_task_runs(engine, str(flow_run.id)):
        with tolerated():
            update(str(flow_run.id), tags=[TAG, key_of(name), *process_tags()])
            mark_orphans()
        task_runs = TaskRuns(engine)
        with Reporter(tally or Tally(), page, INTERVAL_S):
            try:
                yield task_runs
            except BaseException as error:
                if not isinstance(error, Exception):  # an interrupt: else what still waits would be computed first
                    engine.close()
                task_runs.end()
                if engine.closed and not is_embedded():
                    with tolerated():
                        task_runs.cancel()
                raise
            task_runs.record()


SUSPENSION_S: Final = 5.0
"""Time between two looks whether the flow run is suspended."""


@contextmanager
def suspendable(engine: Engine) -> Iterator[None]:
    """End the engine when the current flow run is suspended on Prefect's pages; when resumed, it begins again.

    Raises:
        Pause: Prefect's signal of a suspended flow run, in place of the engine's `PoolClosed`.
    """
    from prefect.client.orchestration import get_client
    from prefect.client.schemas.objects import State
    from prefect.exceptions import Pause
    from prefect.runtime import flow_run

    suspended: list[State] = []
    ended = threading.Event()
    id_ = UUID(str(flow_run.id))

    def watch() -> None:
        while not ended.wait(SUSPENSION_S):
            with (
                suppress(Exception),
                get_client(sync_client=True) as client,
            ):  # an API that is away is reported elsewhere
                state = client.read_flow_run(id_).state
                if state is not None and state.is_paused():
                    suspended.append(state)
                    engine.close()
                    return

    if not is_embedded():
        context = contextvars.copy_context()  # has Prefect's settings
        threading.Thread(target=context.run, args=(watch,), name="vastflow suspension", daemon=True).start()
    try:
        yield
    except PoolClosed:
        if suspended:
            raise Pause(state=suspended[0]) from None
        raise
    finally:
        ended.set()


def instantiate(
    task_runs: TaskRuns,
    instantiator: Instantiator,
    note: Callable[[Sequence[EvaluationRequest]], None] = lambda requests: None,
) -> Instantiated:
    """Evaluate each producer once per distinct input.

    C^i = { c ⊕ f : c ∈ C^{i-1}, f ∈ p_i(c) }

    Args:
        note: Is given the evaluations before they are made.

    Raises:
        FileError: a constraint can't be evaluated, constraints leave nothing, or a design is too large.
        Lost: an evaluation is damaged.
    """

    def evaluated(requests: Sequence[EvaluationRequest]) -> Mapping[str, str]:
        note(requests)
        shards = [shard for request in requests for shard in _producer_shards(request)]
        return {key: error for future in task_runs.map("evaluate", shards) for key, error in future.result().items()}

    return instantiator.instantiated(evaluated)


def compute_round(task_runs: TaskRuns, due: Sequence[FoundRuns], shards: Sequence[Shard]) -> None:
    """Start the missing runs of all configurations that are due, and compute their shards."""
    task_runs.engine.start([each.configuration for each in due if each.missing_runs])
    compute(task_runs, shards)


def compute(task_runs: TaskRuns, shards: Sequence[Shard]) -> None:
    """Execute, observe, and judge shards, each through all stages as soon as possible, and wait for all."""
    recordings: list[PrefectFuture[Any]] = []
    traces: list[PrefectFuture[Any]] = []
    verdicts: list[PrefectFuture[Any]] = []
    for shard in shards:
        recordings += task_runs.map("execute", [shard])
        traces += task_runs.map("observe", [shard], recordings[-1:])
        verdicts += task_runs.map("judge", [shard], traces[-1:])
    task_runs.wait(shards, recordings, traces, verdicts)


def _producer_shards(request: EvaluationRequest) -> list[ProducerShard]:
    evaluations, sent = request.evaluations, packed(request.producer)
    name = f"{request.family} by {type(request.producer).__name__}"
    parts = shard_ranges(len(evaluations))
    if len(parts) == 1:
        return [ProducerShard(request.family, name, sent, evaluations)]
    shards = []
    for part in parts:
        places = f"{part.start + 1}" if len(part) == 1 else f"{part.start + 1}–{part.stop}"
        some = [evaluations[i] for i in part]
        shards.append(ProducerShard(request.family, f"{name}, {places} of {len(evaluations)}", sent, some))
    return shards
