"""The Prefect flow of a single stage. Importing it imports Prefect; `vastflow.flows.stages.api` does only when it must."""

from collections.abc import Callable
from typing import Any

from prefect import Flow, flow

from vastflow.flows.flow_runs.task_runs import TaskRuns, task_runs_of
from vastflow.tasks.engine.engine import Engine


def stage_flow(stage: str, title: str, name: str, engine: Engine, body: Callable[[TaskRuns], None]) -> Flow[[], Any]:
    """The flow that runs a stage alone.

    Args:
        title: The flow run's name.
        name: The campaign's.
        body: Maps the stage, by the function that the campaign's flow has for it.
    """

    @flow(name=stage, flow_run_name=title, persist_result=False)
    def alone() -> None:
        with task_runs_of(name, engine) as task_runs:
            body(task_runs)

    return alone
