"""The Prefect flow of a campaign. Importing it imports Prefect; `vastflow.flows.run_campaign` does only when it must."""

from collections.abc import Callable, Mapping, Sequence
from typing import Any

from prefect import flow, get_run_logger, unmapped
from prefect.futures import PrefectFuture, wait
from prefect.runtime import flow_run

from vastflow.flows.artifacts import ProgressBar, key_of, tag, tolerated
from vastflow.flows.task_log import quiet_task_runs
from vastflow.tasks import stages
from vastflow.tasks.evaluation import packed
from vastflow.tasks.instantiation import Evaluator, Request
from vastflow.tasks.server import drain
from vastflow.tasks.shards import chunks
from vastflow.tasks.shelf import Member
from vastflow.tasks.stages import Bench, ProducerShard, Shard

Plan = Callable[[Evaluator], Sequence[Member]]
"""Gives the members of the campaign, instantiating it with the evaluator it is given if that has to be done."""


class Job:
    """What a campaign's flow is about. A plain object: neither Prefect nor its API looks into it."""

    __slots__ = ("bench", "plan", "running")

    def __init__(self, bench: Bench, plan: Plan, running: Callable[[], None]) -> None:
        self.bench = bench
        self.plan = plan
        self.running = running


class TaskFailed(RuntimeError):
    """A task failed as a whole: a fault of ours in Prefect's shell, not in a member."""


@flow(name="campaign", flow_run_name="{title}", validate_parameters=False, persist_result=False)
def campaign(title: str, job: Job) -> None:
    """Instantiate, execute, observe and judge a campaign, shard by shard and without a barrier between stages.

    Args:
        title: The flow run's name.
    """
    with quiet_task_runs():
        _campaign(title, job)


def _campaign(title: str, job: Job) -> None:
    log = get_run_logger()
    futures: list[PrefectFuture[Any]] = []
    try:
        members = job.plan(_mapped(job.bench, futures))
        job.running()
        shards = [Shard([members[i] for i in part]) for part in chunks([member.scenario.digest for member in members])]
        bench = unmapped(job.bench)
        recorded = stages.stored_in(job.bench, stages.execute).map(shards, bench=bench)
        observed = stages.stored_in(job.bench, stages.observe).map(shards, recorded, bench=bench)
        judged = stages.stored_in(job.bench, stages.judge).map(shards, observed, bench=bench)
        futures += [*recorded, *observed, *judged]
        log.info("%d configurations in %d shards", len(members), len(shards))
        _show(title, judged)
    finally:
        wait(futures)
    for name, ended in (("execute", recorded), ("observe", observed), ("judge", judged)):
        cached = sum(future.state.name == "Cached" for future in ended)
        log.info("%s: %d shards, %d of them known already", name, len(ended), cached)
    failed = [future.state for future in futures if not future.state.is_completed()]
    drain(str(flow_run.id), sum(future.state.is_final() for future in futures))
    if failed:
        raise TaskFailed(f"{len(failed)} of {len(futures)} task runs failed, the first with: {failed[0].message}")


def _show(title: str, judged: Sequence[PrefectFuture[Any]]) -> None:
    """Show how many shards are through, until all are."""
    name, run = title.rsplit(" ", 2)[0], str(flow_run.id)
    bar = ProgressBar(f"{key_of(name)}-shards", run)
    with tolerated():
        tag(run, name)
        for done, future in enumerate(judged):
            bar.show(done / len(judged), f"{done} of {len(judged)} shards judged")
            future.wait()
        bar.show(1.0, f"{len(judged)} shards judged")


def _mapped(bench: Bench, futures: "list[PrefectFuture[Any]]") -> Evaluator:
    """An evaluator that maps a task over shards of each producer's distinct inputs."""

    def evaluate(requests: Sequence[Request]) -> Mapping[str, str]:
        shards = [shard for request in requests for shard in _producer_shards(request)]
        mapped = stages.stored_in(bench, stages.evaluate).map(shards, bench=unmapped(bench))
        futures.extend(mapped)
        return {key: error for future in mapped for key, error in future.result().items()}

    return evaluate


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
