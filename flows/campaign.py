"""The flow of a campaign: from a campaign file to evidence. Importing it imports Prefect.

    instantiate ──▶ execute ──▶ observe ──▶ judge ──▶ assess ──▶ report

It is the only one: `vastflow run` calls it, deployments and schedules run it, with a work pool it drives the pool's workers. Each stage
maps a Prefect task over shards of what is missing in the store, and is chained shard by shard: nothing waits for a whole stage. Of a
search each batch of points goes through the first four, as a child of the flow run, before the next is proposed.
"""

from contextlib import suppress
from functools import partial
from pathlib import Path
from typing import Any

from prefect import flow, get_run_logger
from prefect.client.schemas.objects import State
from prefect.runtime import flow_run
from prefect.states import Cancelled, Completed, Failed

from vastflow.flows.flow_runs.mapped import compute, instantiate
from vastflow.flows.flow_runs.pages import Page, outcome_text, publish
from vastflow.flows.flow_runs.task_runs import TaskRuns, task_runs_of
from vastflow.flows.pool.campaign import CampaignPool, pool_of
from vastflow.flows.pool.shard import compute_bundle
from vastflow.flows.request.run_request import RunRequest
from vastflow.flows.results.directory import new_directory
from vastflow.flows.run.campaign_run import CampaignRun, opened_run, running
from vastflow.flows.run.reporting import assess, deliver, report
from vastflow.flows.search.batch_flow import compute_batch
from vastflow.tasks.engine.pool import PoolClosed
from vastflow.tasks.execution.deployment import FLOW
from vastflow.tasks.prefect.adapter import is_generated_name
from vastflow.tasks.store.store import Lost


def _title() -> str:
    """The campaign's name and when it was asked for; the file's name where the campaign is not read yet. A name that was given stays."""
    request, name = flow_run.parameters["request"], str(flow_run.name)
    return _own_title(request) if request.bundle is None and is_generated_name(name) else name


def _own_title(request: RunRequest) -> str:
    run = opened_run()
    return run.title if run else Path(request.campaign).stem


@flow(name=FLOW, flow_run_name=_title, persist_result=False)
def campaign(request: RunRequest) -> State[Any]:
    """Run a campaign and write its report. What the store has is not computed again.

    A request with a bundle is one of another run of this flow, to which this process's pool lends its workers: the bundle's
    configurations go through the same stages, and their campaign's report is written there.

    Args:
        request: The campaign file, and what of it is run, how and where.

    Raises:
        FileError: faults of the campaign file.
        StoreError: the store can't be used.
        WorkPoolError, WorkersFailed: the work pool that was asked can't compute it.
    """
    if request.bundle is not None:
        return compute_bundle(request, request.bundle)
    try:
        return _ended(request)
    except PoolClosed as error:  # by Ctrl-C
        return Cancelled(message=str(error))


def _ended(request: RunRequest) -> State[Any]:
    """The state in which the flow run ends."""
    renames = flow_run.name == _own_title(request)
    with running(request) as run:
        size = run.asked.runs, run.stopping is not None
        page = Page(run.name, str(flow_run.id), get_run_logger().info, size if renames else None)
        with task_runs_of(run.name, run.engine, run.tally, page) as task_runs, pool_of(run) as pool:
            for _ in run.attempts():
                # A damaged artifact is found when it is read, and computed again by the next attempt.
                with suppress(Lost):
                    for _batch in run.batches():
                        if run.search is None:
                            _compute(run, pool, task_runs)
                        elif run.instantiated is None or run.incomplete:
                            compute_batch(run.name, run.search, run.engine, run.tally, partial(_compute, run, pool))
                    with new_directory(run.delivery.folder, run.name, run.created) as directory:
                        written = report(run, assess(run, directory))
                    found = deliver(run, written)
                    break
    publish(found, run.name, request.reports)  # after the last of what the progress tells of
    if found.faults:
        first = found.faults[0]
        return Failed(message=f"{len(found.faults)} faults, the first in {first.stage}: {first.error}")
    return Completed(message=outcome_text(found))


def _compute(run: CampaignRun, pool: CampaignPool | None, task_runs: TaskRuns) -> None:
    """Bring what is missing of the configurations under way into the store.

    Raises:
        Lost: something is missing all the same, and no fault explains it.
    """
    if run.instantiated is None:
        run.tally.begin("instantiating")
        run.know(instantiate(task_runs, run.instantiator))
    for due in run.rounds():
        if pool is not None:
            pool.compute(due.configurations)
            continue
        compute(task_runs, due.shards)
