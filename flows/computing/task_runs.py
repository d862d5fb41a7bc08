"""Task runs of a flow run: mapped over shards, waited for, and recorded by Prefect's server before the flow returns."""

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any, Final

from vastflow.tasks.engine import Engine, MemberFault
from vastflow.tasks.progress import Reporter, Tally
from vastflow.tasks.server import drain
from vastflow.tasks.shards import Shard

if TYPE_CHECKING:
    from prefect.futures import PrefectFuture

MOST_UNRECORDED: Final = 1000
"""Task runs that may have ended without Prefect's server having recorded it; of thousands at a time it loses some silently."""


class TaskRuns:
    """The task runs of the flow run that makes this object.

    Args:
        engine: What they compute with.
    """

    def __init__(self, engine: Engine) -> None:
        from prefect.runtime import flow_run

        self.engine = engine
        self._flow_run_id = str(flow_run.id)
        self._futures: list[PrefectFuture[Any]] = []
        self._recorded = 0

    def map(self, stage: str, shards: Sequence[Any], *upstream: Sequence[Any]) -> "list[PrefectFuture[Any]]":
        """A task run for each shard.

        Args:
            stage: Name of a task of `vastflow.tasks.stages`.
            upstream: Of each shard what the stage before it made, or a future of that.
        """
        if not shards:
            return []
        from prefect import unmapped

        from vastflow.tasks import stages

        mapped = list(getattr(stages, stage).map(shards, *upstream, engine=unmapped(self.engine)))
        self._futures += mapped
        return mapped

    def wait(self, shards: Sequence[Shard], *stages: "Sequence[PrefectFuture[Any]]") -> None:
        """Wait until all task runs have ended, and the server has recorded most of them.

        One that failed as a whole, which is an internal error, is a fault of its shard's members.

        Raises:
            StoreError, PoolClosed: see `Engine.check`.
        """
        for of_stage in stages:
            for future in of_stage:
                future.wait()
        self.engine.check()
        for of_shard in zip(shards, *stages, strict=True):
            shard, states = of_shard[0], [future.state for future in of_shard[1:]]
            if failed := next((state for state in states if not state.is_completed()), None):
                error = f"a task run ended as {failed.name}: {failed.message}"
                self.engine.add_faults([MemberFault(member.name, None, "flow", error) for member in shard.members])
        if len(self._futures) - self._recorded >= MOST_UNRECORDED:
            self.record()

    def end(self) -> None:
        """Wait until all have ended."""
        for future in self._futures:
            future.wait()

    def record(self) -> None:
        """Wait until the server has recorded the task runs that have ended."""
        self.end()
        drain(self._flow_run_id, sum(future.state.is_final() for future in self._futures))
        self._recorded = len(self._futures)


@contextmanager
def task_runs_of(name: str, engine: Engine, tally: Tally | None = None) -> Iterator[TaskRuns]:
    """The task runs of the flow run that this is called from, which is found by the campaign's name and logs faults only.

    Args:
        name: The campaign's.
        tally: Its progress is shown on the flow run's page; None shows none.
    """
    from prefect import get_run_logger
    from prefect.runtime import flow_run

    from vastflow.flows.computing.artifacts import INTERVAL_S, Page, tag, tolerated
    from vastflow.flows.computing.flow_call import entered
    from vastflow.flows.computing.task_log import quiet_task_runs

    with entered(), quiet_task_runs():
        with tolerated():
            tag(str(flow_run.id), name)
        task_runs = TaskRuns(engine)
        page = None if tally is None else Page(name, str(flow_run.id), get_run_logger().info)
        with Reporter(tally or Tally(), page, INTERVAL_S):
            try:
                yield task_runs
            except BaseException as error:
                if not isinstance(error, Exception):  # an interrupt: else what still waits would be computed first
                    engine.close()
                task_runs.end()
                raise
            task_runs.record()
