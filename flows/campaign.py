"""The flow of a campaign: from a campaign file to evidence. Importing it imports Prefect.

    instantiate ──▶ execute ──▶ observe ──▶ judge ──▶ report

It is the only one: `vastflow run` calls it, deployments and schedules run it. Each stage maps a Prefect task over shards of what is
missing in the store, and is chained shard by shard: nothing waits for a whole stage. Of a search each batch of points goes through
the first four, as a child of the flow run, before the next is proposed.
"""

from collections.abc import Callable, Sequence
from contextlib import suppress
from functools import partial
from pathlib import Path
from typing import Any

from prefect import Flow, flow, get_run_logger
from prefect.client.schemas.objects import State
from prefect.runtime import flow_run
from prefect.states import Cancelled, Completed, Failed

from vastflow.flows.request.run_request import RunRequest
from vastflow.flows.results.summary import Results
from vastflow.flows.run.batch_flow import compute_batch
from vastflow.flows.run.computing import Computing
from vastflow.flows.run.event_log import EventLog, open_log
from vastflow.flows.run.judged import Judged, compute_missing, read_store, run_batches, scan_store
from vastflow.flows.run.pages import Page, outcome_text, publish
from vastflow.flows.run.prepared import PreparedCampaign, open_run
from vastflow.flows.run.reporting import write_campaign
from vastflow.flows.run.task_runs import TaskRuns, compute_round, instantiate, suspendable, task_runs_of
from vastflow.tasks.engine.executor import PoolClosed
from vastflow.tasks.engine.index import FoundRuns
from vastflow.tasks.engine.shards import Shard
from vastflow.tasks.prefect.adapter import is_generated_name
from vastflow.tasks.prefect.deployment import FLOW
from vastflow.tasks.store.store import Lost


def _title() -> str:
    """The file's name until the campaign is read. A name that was given stays."""
    request, name = flow_run.parameters["request"], str(flow_run.name)
    return _stem(request) if is_generated_name(name) else name


def _stem(request: RunRequest) -> str:
    return Path(request.campaign).stem


@flow(name=FLOW, flow_run_name=_title, persist_result=True, result_serializer="json")
def campaign(request: RunRequest) -> State[Any]:
    """Run a campaign and write its report; stored results are not computed again.

    Its result is the summary as `vastflow run --json` prints it, with the campaign directory as `results`.

    Args:
        request: The campaign file, and what of it is run, how and where.

    Raises:
        FileError: faults of the campaign file.
        StoreError: the store can't be used.
        ClusterError: the Dask cluster that was asked can't compute it.
    """
    with open_run(request) as (run, computing), open_log(run, computing) as log:
        return _finish_flow_run(run, computing, None, log, flow_run.name == _stem(request))


def flow_of(
    run: PreparedCampaign,
    computing: Computing,
    judged: Judged | None,
    log: EventLog,
    deliver: Callable[[Results], object],
) -> Flow[[RunRequest], State[Any]]:
    """Return the flow of a campaign that this process has prepared; `deliver` is given the results."""

    @flow(name=FLOW, flow_run_name=computing.title, persist_result=False)
    def campaign(request: RunRequest) -> State[Any]:
        return _finish_flow_run(run, computing, judged, log, True, deliver)

    return campaign


def _finish_flow_run(
    run: PreparedCampaign,
    computing: Computing,
    judged: Judged | None,
    log: EventLog,
    renames: bool,
    deliver: Callable[[Results], object] = lambda results: None,
) -> State[Any]:
    """Return the final state of the flow run, which `renames` names after the size of the campaign."""
    size = run.asked.runs, run.stopping is not None
    engine = computing.engine
    page = Page(run.name, str(flow_run.id), get_run_logger().info, size if renames else None, engine.workers_table)
    try:
        with suspendable(engine), task_runs_of(run.name, engine, computing.tally, page) as task_runs:
            results = _results(run, computing, judged, log, task_runs)
            deliver(results)
    except PoolClosed as error:  # by Ctrl-C, or by a reader
        return Cancelled(message=str(error) if log.stopped_by is None else f"stopped: {log.stopped_by}")
    publish(results, run.name, run.request.reports)  # after the last of what the progress tells of
    if results.faults:
        first = results.faults[0]
        return Failed(message=f"{len(results.faults)} faults, the first in {first.stage}: {first.error}")
    return Completed(message=outcome_text(results), data=results.summary.as_json())


def _results(
    run: PreparedCampaign, computing: Computing, judged: Judged | None, log: EventLog, task_runs: TaskRuns
) -> Results:

    def stages(task_runs: TaskRuns, judged: Judged | None) -> Judged:
        if judged is None:
            computing.tally.begin("instantiating")
            note = partial(run.due.evaluate, run.store)
            judged = scan_store(run, computing, instantiate(task_runs, run.instantiator, note))
        return compute_missing(judged, computing, partial(_compute, run, judged, task_runs))

    def completed(judged: Judged | None) -> Judged:
        if run.search is None:
            return stages(task_runs, judged)
        if judged is not None and not judged.incomplete(computing.engine):
            return judged
        return compute_batch(run.name, run.search, computing.engine, computing.tally, partial(stages, judged=judged))

    for attempt in computing.engine.attempts():
        # A damaged artifact is found when it is read, and computed again by the next attempt.
        with suppress(Lost):
            known = read_store(run, computing) if attempt or judged is None else judged
            found = run_batches(run, computing, known, completed)
            assert found is not None
            return write_campaign(run, computing, found, log)
    raise AssertionError("attempts end with an error")


def _compute(
    run: PreparedCampaign, judged: Judged, task_runs: TaskRuns, due: Sequence[FoundRuns], shards: Sequence[Shard]
) -> None:
    run.due.compute(due, judged.instantiated.instantiation.configurations)
    compute_round(task_runs, due, shards)
