"""The Prefect flow of a single stage. Importing it imports Prefect; `vastflow.flows.stages.api` does only when it must."""

from collections.abc import Callable
from typing import Any

from prefect import Flow, flow

from vastflow.flows.computing.task_runs import TaskRuns, task_runs_of
from vastflow.flows.stages.call import StageRun


def stage_flow(run: StageRun, body: Callable[[TaskRuns], None]) -> Flow[[], Any]:
    """The flow that runs a stage alone: `body` maps it, by the function that the campaign's flow has for it."""

    @flow(name=run.stage, flow_run_name=run.title, persist_result=False)
    def stage() -> None:
        with task_runs_of(run.name, run.engine) as task_runs:
            run.tally.begin("instantiating" if run.stage == "instantiate" else "running")
            body(task_runs)

    return stage
