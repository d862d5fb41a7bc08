"""The Prefect flow of a campaign. Importing it imports Prefect; `vastflow.flows.run_campaign` does only when it must."""

from collections.abc import Callable, Container, Sequence
from typing import Any

from prefect import flow, get_run_logger, unmapped
from prefect.futures import PrefectFuture, wait

from vastflow.flows.computing.task_log import quiet_task_runs
from vastflow.flows.computing.task_runs import catch_up, entered, evaluator, log_known, runs_shown, settle, shards_shown
from vastflow.tasks import stages
from vastflow.tasks.engine import Engine
from vastflow.tasks.index import Member
from vastflow.tasks.instantiation import Evaluator
from vastflow.tasks.progress import Progress
from vastflow.tasks.shards import chunks
from vastflow.tasks.stages import Shard

Plan = Callable[[Evaluator], Sequence[Member]]
"""Gives the members of the campaign, instantiating it with the evaluator it is given if that has to be done."""


class Job:
    """What a campaign's flow is about. A plain object: neither Prefect nor its API looks into it."""

    __slots__ = ("engine", "incomplete", "more", "plan", "progress", "running")

    def __init__(
        self,
        engine: Engine,
        plan: Plan,
        incomplete: Callable[[], Container[str]],
        more: Callable[[], Sequence[Member]],
        running: Callable[[], None],
        progress: Callable[[], Progress] | None = None,
    ) -> None:
        """`incomplete` gives, after `plan`, the names of members of which something is missing in the store.

        `more` gives, when all that was submitted has ended, the members that want more runs by what was judged: the next wave.
        `progress` is for the flow run's page; None where the page of a flow run round this one has it.
        """
        self.engine = engine
        self.plan = plan
        self.incomplete = incomplete
        self.more = more
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
    with entered(), quiet_task_runs():
        _campaign(title, job)


def _campaign(title: str, job: Job) -> None:
    futures: list[PrefectFuture[Any]] = []
    ended: dict[str, list[PrefectFuture[Any]]] = {"execute": [], "observe": [], "judge": []}
    recorded = 0
    try:
        wave = job.plan(evaluator(job.engine, futures))
        job.running()
        name = title.rsplit(" ", 2)[0]
        show = shards_shown(name, "judged") if job.progress is None else runs_shown(name, job.progress)
        incomplete = job.incomplete()
        while wave:
            begun = _through(job.engine, missing_shards(wave, incomplete))
            for stage, of_stage in begun.items():
                ended[stage] += of_stage
                futures += of_stage
            show(begun["judge"])
            wait(futures)
            if not all(future.state.is_completed() for future in futures):
                break
            wave = job.more()
            incomplete = {member.name for member in wave}
            if wave:
                recorded = catch_up(futures, recorded)
    finally:
        wait(futures)
    for stage, of_stage in ended.items():
        log_known(stage, of_stage)
    settle(futures)


def _through(engine: Engine, shards: Sequence[Shard]) -> "dict[str, list[PrefectFuture[Any]]]":
    """Stage to the task runs in which shards go through it."""
    same = unmapped(engine)
    recorded = stages.execute.map(shards, engine=same)
    observed = stages.observe.map(shards, recorded, engine=same)
    judged = stages.judge.map(shards, observed, engine=same)
    return {"execute": recorded, "observe": observed, "judge": judged}
