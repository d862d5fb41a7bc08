"""The Prefect flows of single stages. Importing it imports Prefect; `vastflow.flows.stages.api` does only when it must."""

from collections.abc import Callable, Sequence
from typing import Any

from prefect import Task, flow, get_run_logger, unmapped
from prefect.futures import PrefectFuture, wait
from prefect.runtime import flow_run

from vastflow.flows.computing.artifacts import tag, tolerated
from vastflow.flows.computing.task_log import quiet_task_runs
from vastflow.flows.computing.task_runs import entered, evaluator, log_known, settle, shards_shown
from vastflow.tasks import stages
from vastflow.tasks.engine import Engine, Rows
from vastflow.tasks.instantiation import Evaluator
from vastflow.tasks.stages import Shard


class StageJob:
    """What a stage's flow is about. A plain object: neither Prefect nor its API looks into it.

    Attributes:
        name: The campaign's.
        upstream: Of each shard what the stage before it gave; empty for the first.
    """

    __slots__ = ("engine", "name", "shards", "upstream")

    def __init__(self, name: str, engine: Engine, shards: Sequence[Shard], upstream: Sequence[Rows] = ()) -> None:
        self.name = name
        self.engine = engine
        self.shards = shards
        self.upstream = upstream


@flow(name="instantiate", flow_run_name="{title}", validate_parameters=False, persist_result=False)
def instantiate(title: str, name: str, engine: Engine, plan: Callable[[Evaluator], None]) -> None:
    """Instantiate a campaign.

    Args:
        title: The flow run's name.
        name: The campaign's.
        plan: Instantiates with the evaluator that it is given.
    """
    with entered(), quiet_task_runs():
        futures: list[PrefectFuture[Any]] = []
        with tolerated():
            tag(str(flow_run.id), name)
        try:
            plan(evaluator(engine, futures))
        finally:
            wait(futures)
        log_known("instantiate", futures)
        settle(futures)


@flow(name="execute", flow_run_name="{title}", validate_parameters=False, persist_result=False)
def execute(title: str, job: StageJob) -> None:
    """Execute shards."""
    _through("executed", job, stages.execute)


@flow(name="observe", flow_run_name="{title}", validate_parameters=False, persist_result=False)
def observe(title: str, job: StageJob) -> None:
    """Observe shards' recordings."""
    _through("observed", job, stages.observe, job.upstream)


@flow(name="judge", flow_run_name="{title}", validate_parameters=False, persist_result=False)
def judge(title: str, job: StageJob) -> None:
    """Judge shards' traces."""
    _through("judged", job, stages.judge, job.upstream)


def _through(done: str, job: StageJob, stage: "Task[Any, Any]", *upstream: Sequence[Rows]) -> None:
    with entered(), quiet_task_runs():
        futures = stage.map(job.shards, *upstream, engine=unmapped(job.engine))
        try:
            get_run_logger().info(
                "%d configurations in %d shards", sum(len(shard.members) for shard in job.shards), len(job.shards)
            )
            shards_shown(job.name, done)(futures)
        finally:
            wait(futures)
        log_known(stage.name, futures)
        settle(futures)
