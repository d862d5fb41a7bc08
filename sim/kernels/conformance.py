"""Shared conformance checks of plug-ins in the loop: errors at the author's line, and costs of calls."""

import time
import traceback
from collections.abc import Callable
from typing import Final, TypeVar

from numba.core.runtime import _nrt_python, rtsys

from vastflow.sim.kernels.plug_in import ContractError, line_of, written_file
from vastflow.sim.plug_ins.conformance import must

Result = TypeVar("Result")

SEED: Final = 20
REPEATED: Final = 20
_TIMED: Final = 5


def must_at(main: str, kept: object, plug_in: object, what: str) -> None:
    """Raise an AssertionError at a plug-in's kernel `main` that says `what` it must do, unless it is kept."""
    kind = type(plug_in)
    must(kept, f"{line_of(getattr(getattr(kind, main), 'py_func', kind))}: {kind.__name__} {what}")


def guarded(plug_in: object, name: str, call: Callable[[], Result]) -> Result:
    """Call the kernel `name` of a plug-in; report its errors and broken contracts as AssertionErrors at its line."""
    try:
        return call()
    except ContractError as error:
        raise AssertionError(str(error)) from None
    except Exception as error:
        code = getattr(type(plug_in), name)
        function = getattr(code, "py_func", code)
        frames = [frame for frame in traceback.extract_tb(error.__traceback__) if "vastflow/sim" not in frame.filename]
        where = line_of(function)
        if frames and frames[-1].filename == function.__code__.co_filename:
            where = f"{written_file(function, frames[-1].filename)}:{frames[-1].lineno}"
        right = f"{type(plug_in).__name__}.{name} must not raise, and raised {type(error).__name__}: {error}"
        raise AssertionError(f"{where}: {right}") from error


def allocations_of(call: Callable[[int], object]) -> float:
    """Return how often each of the calls that `call` makes, so many times, allocates."""
    call(1)
    counting, counts = _nrt_python.memsys_stats_enabled(), []
    _nrt_python.memsys_enable_stats()  # numba counts only on request
    try:
        for times in (1, 1 + REPEATED):
            before = rtsys.get_allocation_stats().alloc
            call(times)
            counts.append(rtsys.get_allocation_stats().alloc - before)
    finally:
        if not counting:
            _nrt_python.memsys_disable_stats()
    return float(counts[1] - counts[0]) / REPEATED


def least_us(call: Callable[[], object]) -> float:
    """Return the CPU time of the fastest of several calls (µs)."""
    call()
    took_s = []
    for _ in range(_TIMED):
        began = time.thread_time()
        call()
        took_s.append(time.thread_time() - began)
    return 1e6 * min(took_s)
