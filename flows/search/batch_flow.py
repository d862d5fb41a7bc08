"""A batch of a search as a flow run of its own, whose page says how the search stands and how far the batch is. Importing it imports Prefect."""

from collections.abc import Callable
from typing import Any, Final

from prefect import flow
from prefect.client.schemas.objects import State
from prefect.runtime import flow_run

from vastflow.flows.flow_runs.pages import INTERVAL_S, ProgressBar, key_of, show_text, tolerated
from vastflow.flows.flow_runs.task_runs import TaskRuns, task_runs_of
from vastflow.flows.search.progress import SearchProgress
from vastflow.tasks.engine.engine import Engine
from vastflow.tasks.engine.progress import Progress, Reporter, Tally
from vastflow.tasks.prefect.orphans import tagged

FLOW: Final = "search-batch"


class BatchBar:
    """Shows how far a batch is, as an observer of the campaign.

    Args:
        before: Runs that were done when it began.
    """

    def __init__(self, bar: ProgressBar, before: int) -> None:
        self._bar = bar
        self._before = before

    def update(self, progress: Progress) -> None:
        """Show the runs of the batch among those of `progress`."""
        done, total = progress.runs_done - self._before, progress.runs_total - self._before
        if total > 0:
            with tolerated():
                self._bar.show(done / total, f"{done} of {'at most ' * progress.at_most}{total} runs of the batch done")


def compute_batch(
    name: str, search: SearchProgress, engine: Engine, tally: Tally, compute: Callable[[TaskRuns], None]
) -> None:
    """Have the points under way computed, in a child of the flow run that calls this.

    Args:
        name: The campaign's.
        compute: Brings what is missing of the points into the store, by task runs of the child.

    Raises:
        Exception: what `compute` raises.
    """
    title = f"{name}, {search.title}"

    @flow(name=FLOW, flow_run_name=lambda: title, persist_result=False)
    def batch() -> None:
        with task_runs_of(name, engine) as task_runs:
            show_text(f"{key_of(name)}-search", standing_text(search), f"How the search of **{name}** stands")
            bar = BatchBar(ProgressBar(f"{key_of(name)}-batch", str(flow_run.id)), tally.progress().runs_done)
            with Reporter(tally, bar, INTERVAL_S):
                compute(task_runs)

    with tagged():
        state: State[Any] = batch(return_state=True)
    if not state.is_completed():
        raise state.result(raise_on_failure=False)


def standing_text(search: SearchProgress) -> str:
    """What was found, and how far each budget is spent, in Markdown."""
    told = search.evaluations
    rejected = sum(each.standing == "rejected" for each in told)
    points = f"{len(told)} points, {rejected} of them rejected, {sum(each.runs for each in told)} runs"
    ended = [f"ended at {search.ended_by}"] if search.ended_by else []
    lines = [f"under way: {search.title}", f"before: {points}", search.found_text, *search.standing, *ended]
    return "\n".join(f"- {line}" for line in lines)
