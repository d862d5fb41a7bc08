"""The log of a campaign's flow run on Prefect's pages: a few lines of its own, and of its task runs what went wrong."""

import logging
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Final

TASK_RUNS: Final = "prefect.task_runs"


@contextmanager
def quiet_task_runs() -> Iterator[None]:
    """Send nothing below a warning of task runs to Prefect's API; a flow run's page would list some lines for each."""
    from prefect.logging.handlers import APILogHandler

    handlers = [each for each in logging.getLogger(TASK_RUNS).handlers if isinstance(each, APILogHandler)]
    for handler in handlers:
        handler.addFilter(_worth_sending)
    try:
        yield
    finally:
        for handler in handlers:
            handler.removeFilter(_worth_sending)


def _worth_sending(record: logging.LogRecord) -> bool:
    return record.levelno >= logging.WARNING or not record.name.startswith(TASK_RUNS)
