"""Task runs of a flow: mapped over shards, shown as they end, recorded before the flow returns. Importing it imports Prefect."""

import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import AbstractContextManager, contextmanager
from typing import Any, Final, TypeAlias

from prefect import get_run_logger, unmapped
from prefect.futures import PrefectFuture
from prefect.runtime import flow_run

from vastflow.flows.computing.artifacts import INTERVAL_S, Page, ProgressBar, key_of, tag, tolerated
from vastflow.tasks import ledger, stages
from vastflow.tasks.engine import Engine
from vastflow.tasks.evaluation import packed
from vastflow.tasks.instantiation import Evaluator, Request
from vastflow.tasks.progress import Progress
from vastflow.tasks.server import configured_url, drain
from vastflow.tasks.shards import chunks
from vastflow.tasks.stages import CACHED, ProducerShard

MOST_UNRECORDED: Final = 1000
"""Task runs that may have ended without Prefect's server having recorded it; of thousands at a time it loses some silently."""


Show: TypeAlias = Callable[["Sequence[PrefectFuture[Any]]"], None]
"""Shows how far shards are until all are through; takes of each the last task run. Called for one wave after another."""


def entered() -> AbstractContextManager[None]:
    """Enter the flow run in the ledger, for its process may be killed."""
    return ledger.begun(str(flow_run.id), configured_url() or "")


@contextmanager
def held() -> Iterator[None]:
    """As `entered`, of a flow run whose end Prefect learns from its worker. Those of workers that are gone are ended first."""
    api = configured_url() or ""
    ledger.end_orphans(api)
    try:
        with entered():
            yield
    finally:
        ledger.leave(str(flow_run.id))


class TaskFailed(RuntimeError):
    """A task failed as a whole: a fault of ours in Prefect's shell, not in a member."""


def evaluator(engine: Engine, futures: "list[PrefectFuture[Any]]") -> Evaluator:
    """An evaluator that maps a task over shards of each producer's distinct inputs.

    Args:
        futures: Gets those of the task runs.
    """

    def evaluate(requests: Sequence[Request]) -> Mapping[str, str]:
        shards = [shard for request in requests for shard in _producer_shards(request)]
        mapped = stages.evaluate.map(shards, engine=unmapped(engine))
        futures.extend(mapped)
        return {key: error for future in mapped for key, error in future.result().items()}

    return evaluate


def shards_shown(name: str, done: str) -> Show:
    """Shows on the flow run's page how many shards are through.

    Args:
        name: The campaign's; tag of the flow run and part of the bar's key.
        done: What a shard is then, such as `judged`.
    """
    run = str(flow_run.id)
    bar = ProgressBar(f"{key_of(name)}-shards", run)
    through = 0
    with tolerated():
        tag(run, name)

    def show(last: "Sequence[PrefectFuture[Any]]") -> None:
        nonlocal through
        before, through = through, through + len(last)
        with tolerated():
            for count, future in enumerate(last, before):
                bar.show(count / through, f"{count} of {through} shards {done}")
                future.wait()
            bar.show(1.0, f"{through} shards {done}")

    return show


def runs_shown(name: str, progress: Callable[[], Progress]) -> Show:
    """Shows on the flow run's page how many runs are done, and in its name how many there are.

    Args:
        name: As `shards_shown` has it.
    """
    run = str(flow_run.id)
    page = Page(name, run, get_run_logger().info)
    with tolerated():
        tag(run, name)

    def show(last: "Sequence[PrefectFuture[Any]]") -> None:
        page.update(progress())
        for future in last:
            while not _ends_within(future, INTERVAL_S):
                page.update(progress())
        page.update(progress())

    return show


def _ends_within(future: "PrefectFuture[Any]", timeout_s: float) -> bool:
    """Wait; a future does not say whether it ended, and a task run that was never begun has no final state."""
    began_s = time.monotonic()
    future.wait(timeout_s)
    return time.monotonic() - began_s < timeout_s


def log_known(stage: str, ended: "Sequence[PrefectFuture[Any]]") -> None:
    """Say in the flow run's log how many of a stage's shards Prefect knew already."""
    known = sum(future.state.name == CACHED for future in ended)
    get_run_logger().info("%s: %d shards, %d of them known already", stage, len(ended), known)


def catch_up(futures: "Sequence[PrefectFuture[Any]]", recorded: int) -> int:
    """Wait for the server where there are many ended task runs that it may not have recorded.

    Args:
        recorded: How many of `futures`, the first ones, are known to be recorded.

    Returns:
        How many are now.
    """
    if len(futures) - recorded < MOST_UNRECORDED:
        return recorded
    drain(str(flow_run.id), sum(future.state.is_final() for future in futures))
    return len(futures)


def settle(futures: "Sequence[PrefectFuture[Any]]") -> None:
    """Wait until the server has recorded the ended task runs.

    Raises:
        TaskFailed: one of them failed.
    """
    failed = [future.state for future in futures if not future.state.is_completed()]
    drain(str(flow_run.id), sum(future.state.is_final() for future in futures))
    if failed:
        raise TaskFailed(f"{len(failed)} of {len(futures)} task runs failed, the first with: {failed[0].message}")


def _producer_shards(request: Request) -> list[ProducerShard]:
    evaluations, sent = request.evaluations, packed(request.producer)
    name = f"{request.family} by {type(request.producer).__name__}"
    parts = chunks([each.key.rpartition("/")[2] for each in evaluations])
    if len(parts) == 1:
        return [ProducerShard(name, sent, evaluations)]
    return [
        ProducerShard(f"{name}, {_places(part)} of {len(evaluations)}", sent, [evaluations[i] for i in part])
        for part in parts
    ]


def _places(part: range) -> str:
    return f"{part.start + 1}" if len(part) == 1 else f"{part.start + 1}–{part.stop}"
