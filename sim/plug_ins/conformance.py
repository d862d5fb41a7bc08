"""Shared conformance checks of all kinds of plug-ins."""

import pickle
import random
from collections.abc import Callable, Iterator
from contextlib import contextmanager

import numpy as np


def must(kept: object, what: str) -> None:
    """Raise an AssertionError that says `what` a plug-in must do, unless it is kept."""
    if not kept:
        raise AssertionError(what)


@contextmanager
def watched_generators() -> Iterator[Callable[[], bool]]:
    """Tell whether a global random generator was used in the body; restore all of them afterward."""
    ours, numpys = random.getstate(), np.random.get_state()
    # A state that no seed of the plug-in's own leads to.
    random.seed("vastflow.sim.plug_ins.conformance")
    np.random.seed([0x76617374, 0x666C6F77])
    before = _states()
    try:
        yield lambda: _states() != before
    finally:
        random.setstate(ours)
        np.random.set_state(numpys)


def _states() -> tuple[object, ...]:
    return random.getstate(), pickle.dumps(np.random.get_state())
