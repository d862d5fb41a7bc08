"""Garbage collection of a process that makes very many values, and drops few of them."""

import gc
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Final

_THRESHOLDS: Final = (50_000, 20, 100)


@contextmanager
def few_collections() -> Iterator[None]:
    """Let Python look for cycles seldom: what is imported stays, and the hundred thousands of values of a campaign live to its
    end. They would be looked at again and again, for a third of the time that a call takes in which nothing is missing."""
    before = gc.get_threshold()
    if not 0 < before[0] < _THRESHOLDS[0]:  # by a campaign that runs in another thread, which takes it back
        yield
        return
    gc.set_threshold(*_THRESHOLDS)
    try:
        yield
    finally:
        gc.set_threshold(*before)
