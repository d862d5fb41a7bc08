"""This process: its end within seconds and without orphans, its garbage collection, and its memory."""

import ctypes
import gc
import os
import signal
import sys
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from typing import Final

import psutil

INTERRUPTED: Final = 130
BOUND_S: Final = 4.0


@contextmanager
def terminable() -> Iterator[None]:
    """Let SIGTERM interrupt the body as Ctrl-C does, unless the program has its own idea of it.

    In another thread than the main one nothing changes: signals are not its business.
    """
    if threading.current_thread() is not threading.main_thread() or signal.getsignal(signal.SIGTERM) != signal.SIG_DFL:
        yield
        return
    signal.signal(signal.SIGTERM, signal.default_int_handler)
    try:
        yield
    finally:
        signal.signal(signal.SIGTERM, signal.SIG_DFL)


def bound(kill: Callable[[], None]) -> threading.Timer:
    """Call `kill` and end the process with code 130 after `BOUND_S`, unless it ends before or the timer is cancelled."""

    def end() -> None:
        with suppress(Exception):
            kill()
        os._exit(INTERRUPTED)

    timer = threading.Timer(BOUND_S, end)
    timer.daemon = True
    timer.start()
    return timer


def owns_process() -> bool:
    """True if an interrupt is meant for the whole process: in the main thread, unless an event loop runs there.

    A notebook's kernel runs one, and must survive the interruption of a cell.
    """
    import asyncio

    if threading.current_thread() is not threading.main_thread():
        return False
    try:
        asyncio.get_running_loop()
    except RuntimeError:
        return True
    return False


def cpu_s() -> float:
    """Return the CPU time of this process and all below it, ended or alive, such as Prefect's server and workers."""
    spent_s = sum(os.times()[:4])
    for process in psutil.Process().children(recursive=True):
        with suppress(psutil.Error):  # it ends just now, and counts as ended next time
            spent_s += sum(process.cpu_times()[:4])
    return spent_s


SAFE_PATH: Final = "PYTHONSAFEPATH"
"""Variable that has the effect of `python -P`: nothing is imported from the working directory."""
_HARMLESS: Final = ("PYTHONDONTWRITEBYTECODE", "PYTHONHASHSEED", "PYTHONIOENCODING", "PYTHONNOUSERSITE", "PYTHONUTF8")


def python_command(module: str, *arguments: str) -> list[str]:
    """Return the command of a module as a process of its own, which imports nothing from its working directory."""
    return [sys.executable, "-P", "-m", module, *arguments]


def own_environment() -> dict[str, str]:
    """Return this process's environment without what lets a folder decide which code a Python process executes."""
    kept = {name: value for name, value in os.environ.items() if not name.startswith("PYTHON") or name in _HARMLESS}
    folders = [each for each in os.environ.get("PYTHONPATH", "").split(os.pathsep) if os.path.isabs(each)]
    return kept | ({"PYTHONPATH": os.pathsep.join(folders)} if folders else {})


@contextmanager
def safe_path() -> Iterator[None]:
    """Let processes that libraries start in the body import nothing from the working directory."""
    if SAFE_PATH in os.environ:
        yield
        return
    os.environ[SAFE_PATH] = "1"
    try:
        yield
    finally:
        os.environ.pop(SAFE_PATH, None)


_THRESHOLDS: Final = (50_000, 20, 100)


@contextmanager
def few_collections() -> Iterator[None]:
    """Collect garbage seldom: modules and the values of a campaign live to its end.

    Looking at them again and again takes a third of a call in which nothing is missing.
    """
    before = gc.get_threshold()
    if not 0 < before[0] < _THRESHOLDS[0]:  # by a campaign that runs in another thread, which takes it back
        yield
        return
    gc.set_threshold(*_THRESHOLDS)
    try:
        yield
    finally:
        gc.set_threshold(*before)


_M_TRIM_THRESHOLD: Final = -1
"""`M_TRIM_THRESHOLD` of glibc's malloc.h."""


def return_freed_memory() -> None:
    """Give freed memory back to the system at once from now on; to be called before pyarrow is imported.

    Tables come and go in blocks of megabytes. Arrow's own allocator keeps them, and so does glibc once it has seen one: a fifth of
    the peak of a large campaign.
    """
    os.environ.setdefault("ARROW_DEFAULT_MEMORY_POOL", "system")
    with suppress(OSError, AttributeError, TypeError):  # other systems' allocators have no such choice
        ctypes.CDLL(None).mallopt(_M_TRIM_THRESHOLD, 1 << 17)
