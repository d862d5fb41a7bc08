"""A batch of a search as a flow run with a page of its own; importing this module imports Prefect."""

from collections.abc import Callable
from typing import Any, Final, TypeVar

from prefect import flow
from prefect.client.schemas.objects import State
from prefect.runtime import flow_run

from vastflow.flows.run.pages import INTERVAL_S, ProgressBar, key_of, show_text, tolerated
from vastflow.flows.run.search_progress import SearchProgress
from vastflow.flows.run.task_runs import TaskRuns, task_runs_of
from vastflow.tasks.engine.engine import Engine
from vastflow.tasks.engine.progress import Progress, Reporter, Tally
from vastflow.tasks.prefect.orphans import tagged

FLOW: Final = "search-batch"

T = TypeVar("T")


class BatchBar:
    """Shows the progress of a batch that follows `before` runs, as an observer of the campaign."""

    def __init__(self, bar: ProgressBar, before: int) -> None:
        self._bar = bar
        self._before = before

    def update(self, progress: Progress) -> None:
        """Show the batch's share of `progress`."""
        done, total = progress.runs_done - self._before, progress.runs_total - self._before
        if total > 0:
            with tolerated():
                self._bar.show(done / total, f"{done} of {'at most ' * progress.at_most}{total} runs of the batch done")


def compute_batch(
    name: str, search: SearchProgress, engine: Engine, tally: Tally, compute: Callable[[TaskRuns], T]
) -> T:
    """Compute the current points in a child of the calling flow run; return what `compute` returns, or raise its error."""
    title, made = f"{name}, {search.title}", list[T]()

    @flow(name=FLOW, flow_run_name=lambda: title, persist_result=False)
    def batch() -> None:
        with task_runs_of(name, engine) as task_runs:
            show_text(f"{key_of(name)}-search", standing_text(search), f"Progress of the search of **{name}**")
            bar = BatchBar(ProgressBar(f"{key_of(name)}-batch", str(flow_run.id)), tally.progress().runs_done)
            with Reporter(tally, bar, INTERVAL_S):
                made.append(compute(task_runs))

    with tagged():
        state: State[Any] = batch(return_state=True)
    if not state.is_completed():
        raise state.result(raise_on_failure=False)
    return made[0]


def standing_text(search: SearchProgress) -> str:
    """Return results and spent budgets in Markdown."""
    told = search.evaluations
    rejected = sum(each.standing == "rejected" for each in told)
    points = f"{len(told)} points, {rejected} of them rejected, {sum(each.runs for each in told)} runs"
    ended = [f"ended at {search.ended_by}"] if search.ended_by else []
    lines = [f"under way: {search.title}", f"before: {points}", search.found_text, *search.standing, *ended]
    return "\n".join(f"- {line}" for line in lines)
