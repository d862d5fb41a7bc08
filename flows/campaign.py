"""The Prefect flow of a campaign. Importing it imports Prefect; `vastflow.flows.run_campaign` does only when it must."""

from collections.abc import Callable, Container, Sequence
from typing import Any

from prefect import flow, get_run_logger, unmapped
from prefect.futures import PrefectFuture, wait

from vastflow.flows.task_log import quiet_task_runs
from vastflow.flows.task_runs import entered, evaluator, log_known, settle, show_ending, show_progress
from vastflow.tasks import stages
from vastflow.tasks.instantiation import Evaluator
from vastflow.tasks.progress import Progress
from vastflow.tasks.shards import chunks
from vastflow.tasks.shelf import Member
from vastflow.tasks.stages import Bench, Shard

Plan = Callable[[Evaluator], Sequence[Member]]
"""Gives the members of the campaign, instantiating it with the evaluator it is given if that has to be done."""


class Job:
    """What a campaign's flow is about. A plain object: neither Prefect nor its API looks into it."""

    __slots__ = ("bench", "incomplete", "plan", "progress", "running")

    def __init__(
        self,
        bench: Bench,
        plan: Plan,
        incomplete: Callable[[], Container[str]],
        running: Callable[[], None],
        progress: Callable[[], Progress] | None = None,
    ) -> None:
        """`incomplete` gives, after `plan`, the names of members of which something is missing in the store.

        `progress` is for the flow run's page; None where the page of a flow run round this one has it.
        """
        self.bench = bench
        self.plan = plan
        self.incomplete = incomplete
        self.running = running
        self.progress = progress


def missing_shards(members: Sequence[Member], incomplete: Container[str]) -> list[Shard]:
    """Shards in which something is missing; where they are cut depends on all members, so that an edit moves one cut."""
    parts = chunks([member.scenario.digest for member in members])
    missing = [part for part in parts if any(members[i].name in incomplete for i in part)]
    known = len(parts) - len(missing)
    get_run_logger().info("%d configurations in %d shards, %d of them known already", len(members), len(parts), known)
    return [Shard([members[i] for i in part]) for part in missing]


@flow(name="campaign", flow_run_name="{title}", validate_parameters=False, persist_result=False)
def campaign(title: str, job: Job) -> None:
    """Instantiate, execute, observe and judge a campaign, shard by shard and without a barrier between stages.

    Args:
        title: The flow run's name.
    """
    entered(job.bench.api)
    with quiet_task_runs():
        _campaign(title, job)


def _campaign(title: str, job: Job) -> None:
    futures: list[PrefectFuture[Any]] = []
    try:
        members = job.plan(evaluator(job.bench, futures))
        job.running()
        shards = missing_shards(members, job.incomplete())
        bench = unmapped(job.bench)
        recorded = stages.stored_in(job.bench, stages.execute).map(shards, bench=bench)
        observed = stages.stored_in(job.bench, stages.observe).map(shards, recorded, bench=bench)
        judged = stages.stored_in(job.bench, stages.judge).map(shards, observed, bench=bench)
        futures += [*recorded, *observed, *judged]
        name = title.rsplit(" ", 2)[0]
        if job.progress is None:
            show_ending(name, judged, "judged")
        else:
            show_progress(name, judged, job.progress)
    finally:
        wait(futures)
    for stage, ended in (("execute", recorded), ("observe", observed), ("judge", judged)):
        log_known(stage, ended)
    settle(futures)
