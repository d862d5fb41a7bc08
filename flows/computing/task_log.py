"""The log of a campaign's flow run on Prefect's pages: a few lines of its own, and of its task runs what went wrong."""

import logging
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Final

from vastflow.tasks.engine import Engine
from vastflow.tasks.prefect_adapter import sent_only

TASK_RUNS: Final = "prefect.task_runs"
NEVER_BEGUN: Final = "Finished in state Pending("


@contextmanager
def quiet_task_runs(engine: Engine, flow_run_id: str) -> Iterator[None]:
    """Send nothing below a warning of task runs to Prefect's API; a flow run's page would list some lines for each.

    Once the engine is closed the task runs of the flow run say nothing at all: each would report that it was cancelled. Nor do those
    that never began, which Prefect reports as errors where a flow run is suspended.
    """

    def is_said(record: logging.LogRecord) -> bool:
        own = getattr(record, "flow_run_id", None) == flow_run_id
        return not (own and (engine.closed or record.getMessage().startswith(NEVER_BEGUN)))

    logger = logging.getLogger(TASK_RUNS)
    logger.addFilter(is_said)
    try:
        with sent_only(TASK_RUNS, _worth_sending):
            yield
    finally:
        logger.removeFilter(is_said)


def _worth_sending(record: logging.LogRecord) -> bool:
    return record.levelno >= logging.WARNING or not record.name.startswith(TASK_RUNS)
