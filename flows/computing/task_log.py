"""The log of a campaign's flow run on Prefect's pages: a few lines of its own, and of its task runs what went wrong."""

import logging
from contextlib import AbstractContextManager
from typing import Final

from vastflow.tasks.prefect_adapter import sent_only

TASK_RUNS: Final = "prefect.task_runs"


def quiet_task_runs() -> AbstractContextManager[None]:
    """Send nothing below a warning of task runs to Prefect's API; a flow run's page would list some lines for each."""
    return sent_only(TASK_RUNS, _worth_sending)


def _worth_sending(record: logging.LogRecord) -> bool:
    return record.levelno >= logging.WARNING or not record.name.startswith(TASK_RUNS)
