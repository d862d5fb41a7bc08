"""Delta debugging: a failing set of things becomes one of which nothing can be left out."""

import itertools
from collections.abc import Callable, Sequence
from typing import Final, TypeVar

T = TypeVar("T")

LEVELS: Final = 8
"""Parts into which the distance of a value from its default is divided."""


def ddmin(things: Sequence[T], fails: Callable[[Sequence[T]], bool]) -> tuple[T, ...]:
    """A subset of `things` that fails, while it fails no more without any single one of them.

    The algorithm ddmin of Zeller and Hildebrandt, Simplifying and Isolating Failure-Inducing Input (IEEE Trans. Softw. Eng. 28
    (2002) 183), which asks for nothing at all first.

    Args:
        fails: Whether a subset, in the order of `things`, fails; all of them do. What can't be told counts as no.
    """
    left, parts = tuple(things), 2
    if not left or fails(()):
        return ()
    while len(left) > 1:
        chunks = _chunks(left, parts)
        # Of two chunks each is the complement of the other.
        subsets = [*chunks, *(_without(left, chunk) for chunk in chunks if parts > 2)]
        found = next((k for k, subset in enumerate(subsets) if fails(subset)), None)
        if found is not None:
            left, parts = subsets[found], 2 if found < parts else parts - 1
        elif parts == len(left):
            break
        else:
            parts = min(2 * parts, len(left))
    return left


def least_level(fails: Callable[[int], bool]) -> int:
    """The least of the levels 1 to `LEVELS` that fails, by bisection: `LEVELS` does, and 0 is taken not to."""
    passes, least = 0, LEVELS
    while least - passes > 1:
        middle = (passes + least) // 2
        if fails(middle):
            least = middle
        else:
            passes = middle
    return least


def _chunks(things: tuple[T, ...], parts: int) -> list[tuple[T, ...]]:
    """`things` in order, in parts of about equal size."""
    cuts = [len(things) * k // parts for k in range(parts + 1)]
    return [things[start:stop] for start, stop in itertools.pairwise(cuts)]


def _without(things: tuple[T, ...], chunk: tuple[T, ...]) -> tuple[T, ...]:
    return tuple(each for each in things if each not in chunk)
