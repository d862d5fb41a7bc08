"""Logs of a campaign: vastflow, Prefect, and its services write to one file, not to the user's terminal.

Several campaigns may run at once in one process: each removes its own file handler, the first one restores the loggers.
"""

import logging
import os
import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from datetime import datetime
from io import TextIOWrapper
from pathlib import Path
from typing import Any, Final

from vastflow.tasks.prefect.adapter import console_handlers, import_prefect
from vastflow.tasks.store.artifact import redacted

FORMAT: Final = "%(asctime)s %(levelname)s %(name)s: %(message)s"
MOST_LOGS: Final = 50

WARNINGS: Final = "py.warnings"

_CHATTY: Final = ("APILogWorker", "EventsWorker", "asyncio", "httpcore", "httpx", "websockets", WARNINGS)


def new_log(folder: Path, name: str, created: datetime) -> Path:
    """Return a path for a campaign's log in `folder`, and remove old logs there."""
    folder.mkdir(parents=True, exist_ok=True)
    for old in sorted(folder.glob("*.log"), key=lambda file: file.stat().st_mtime)[: -MOST_LOGS + 1]:
        old.unlink(missing_ok=True)
    return folder / f"{name}-{created:%Y-%m-%d-%H%M%S-%f}.log"


@contextmanager
def own_log(log: Path) -> Iterator[None]:
    """Send vastflow's records to `log`; the file is made with the first line."""
    handler = _handler(log)
    logger = logging.getLogger("vastflow")
    before, is_first = logger.propagate, _is_first(logger)
    logger.addHandler(handler)
    logger.propagate = False
    try:
        yield
    finally:
        logger.removeHandler(handler)
        if is_first:
            logger.propagate = before
        handler.close()


@contextmanager
def prefect_log(log: Path) -> Iterator[None]:
    """Import Prefect, and send the records of Prefect and its services to `log`.

    Afterwards all is as before if the user had imported Prefect. Otherwise Prefect's new console handler on the root logger
    goes, and Prefect writes to `log` until the process ends or the next log begins.
    """
    imported_before = import_prefect()
    handler = _handler(log)
    root = logging.getLogger()
    known = [logger for logger in logging.Logger.manager.loggerDict.values() if isinstance(logger, logging.Logger)]
    for logger in [root, *known]:
        for earlier in [each for each in logger.handlers if isinstance(each, _LogFile) and each.is_left]:
            logger.removeHandler(earlier)
            logger.addHandler(logging.NullHandler())  # else Prefect falls back to the terminal
            earlier.close()
    prefect_logger = logging.getLogger("prefect")
    is_first = _is_first(prefect_logger)
    before = {logger: (list(logger.handlers), logger.propagate) for logger in [root, *known]}
    for logger in before:
        for console in console_handlers(logger):
            logger.removeHandler(console)
            if logger is not root:
                logger.addHandler(handler)
    for name in ("prefect", *_CHATTY):
        logger = logging.getLogger(name)
        before.setdefault(logger, (list(logger.handlers), logger.propagate))
        logger.addHandler(handler)
        logger.propagate = False
    level = prefect_logger.level
    show = warnings.showwarning
    warnings.showwarning = _logged_warning
    raises = logging.raiseExceptions
    # Of a server that is gone, Prefect would write to the terminal that it can't log there.
    logging.raiseExceptions = False
    try:
        yield
    finally:
        if is_first:
            warnings.showwarning = show
            prefect_logger.setLevel(level)
        if imported_before:
            for logger, (handlers, propagate) in before.items():
                logger.removeHandler(handler)
                if is_first:
                    logger.handlers[:] = [*handlers, *(each for each in logger.handlers if each not in handlers)]
                    logger.propagate = propagate
            if is_first:
                logging.raiseExceptions = raises
            handler.close()
        handler.is_left = True


def _is_first(logger: logging.Logger) -> bool:
    return not any(isinstance(each, _LogFile) for each in logger.handlers)


def hush() -> None:
    """Silence Prefect: each task of an interrupted campaign would report its own failure at length."""
    logging.getLogger("prefect").setLevel(logging.CRITICAL + 1)


def _logged_warning(
    message: Warning | str, category: type[Warning], filename: str, lineno: int, *_: Any, **__: Any
) -> None:
    logging.getLogger(WARNINGS).warning("%s", warnings.formatwarning(message, category, filename, lineno))


class _LogFile(logging.FileHandler):
    """A campaign's log file; `is_left` once the campaign has ended, and only Prefect may still write."""

    is_left = False

    def format(self, record: logging.LogRecord) -> str:
        """Leave out passwords in addresses, as campaign directories have copies of the log."""
        return redacted(super().format(record))

    def _open(self) -> TextIOWrapper:
        try:
            return super()._open()
        except OSError:  # who deleted its folder wants no log
            return open(os.devnull, "a", encoding="utf-8")


def _handler(log: Path) -> _LogFile:
    handler = _LogFile(log, encoding="utf-8", delay=True)
    handler.setFormatter(logging.Formatter(FORMAT))
    return handler
