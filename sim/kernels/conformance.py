"""Shared conformance checks of plug-ins in the loop: errors at the author's line, and costs of calls."""

import math
import time
import traceback
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any, Final

from numba.core.runtime import _nrt_python, rtsys

from vastflow.sim.kernels.plug_in import line_of, written_file
from vastflow.sim.plug_ins.conformance import must

SEED: Final = 20
REPEATED: Final = 20
_TIMED: Final = 5


def must_at(kept: object, kind: type, main: str, what: str) -> None:
    """Raise an AssertionError at a plug-in's kernel `main` that says `what` it must do, unless it is kept."""
    must(kept, f"{line_of(getattr(getattr(kind, main), 'py_func', kind))}: {kind.__name__} {what}")


def guarded(kind: type, name: str, call: Callable[[], Any]) -> Any:
    """Call; what the kernel `name` of a plug-in raises is an AssertionError at its line."""
    try:
        return call()
    except Exception as error:
        raise AssertionError(_raised(kind, name, error)) from error


def _raised(kind: type, name: str, error: Exception) -> str:
    """Describe what a plug-in's code raised, at its line where that is known."""
    code = getattr(kind, name)
    function = getattr(code, "py_func", code)
    frames = [frame for frame in traceback.extract_tb(error.__traceback__) if "vastflow/sim" not in frame.filename]
    last = frames[-1] if frames else None
    own = last is not None and last.filename == function.__code__.co_filename
    where = f"{written_file(function, last.filename)}:{last.lineno}" if own and last else line_of(function)
    return f"{where}: {kind.__name__}.{name} must not raise, and raised {type(error).__name__}: {error}"


def allocations_of(call: Callable[[int], object]) -> float:
    """Return how often each of the calls that `call` makes, so many times, allocates."""
    call(1)
    with _counted() as allocations:
        counts = []
        for times in (1, 1 + REPEATED):
            before = allocations()
            call(times)
            counts.append(allocations() - before)
    return (counts[1] - counts[0]) / REPEATED


def least_us(call: Callable[[], object]) -> float:
    """Return the CPU time of the fastest of several calls (µs)."""
    call()
    least = math.inf
    for _ in range(_TIMED):
        began = time.thread_time()
        call()
        least = min(least, 1e6 * (time.thread_time() - began))
    return least


@contextmanager
def _counted() -> Iterator[Callable[[], int]]:
    """Count allocations of compiled code; numba counts only on request."""
    counting = _nrt_python.memsys_stats_enabled()
    _nrt_python.memsys_enable_stats()

    def allocations() -> int:
        stats = rtsys.get_allocation_stats()
        return int(stats.alloc)

    try:
        yield allocations
    finally:
        if not counting:
            _nrt_python.memsys_disable_stats()
