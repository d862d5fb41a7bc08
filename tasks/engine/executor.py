"""Executors: where units of work run, in processes of this machine or on a cluster."""

from collections.abc import Callable
from concurrent.futures import Future, InvalidStateError
from contextlib import suppress
from enum import IntEnum
from typing import Any, Protocol, TypeAlias


class Priority(IntEnum):
    """Priorities of units: the nearest to a verdict goes first."""

    EVALUATE = 0
    JUDGE = 1
    OBSERVE = 2
    EXECUTE = 3


Shared: TypeAlias = Callable[[], Any]
"""Returns a value that was pickled once for all units, where they run; raises what unpickling it raises."""


class WorkerDied(RuntimeError):
    """The process of a unit died each time, at last with this unit alone."""


class PoolClosed(RuntimeError):
    """The executor was closed before this unit was done."""

    def __init__(self) -> None:
        super().__init__("the campaign was ended before this was computed")


class ClusterError(RuntimeError):
    """The cluster can't compute the campaign; says why and what would help."""


class Executor(Protocol):
    """Runs units, survives the death of workers, and returns futures of `concurrent.futures`."""

    @property
    def workers(self) -> int:
        """Number of units that run at the same time at most."""

    @property
    def closed(self) -> bool:
        """Whether it takes no more units."""

    def submit(self, function: Callable[..., Any], /, *arguments: Any, priority: Priority) -> "Future[Any]":
        """Queue a call of a module-level function; a canceled call that has not begun never runs.

        The future ends with its result, its exception, `WorkerDied`, `ClusterError`, or `PoolClosed`.
        """

    def shared(self, value: object) -> Shared:
        """Return a value for the arguments of many units."""

    def prepare(self, function: Callable[..., Any], /, *arguments: Any) -> "Future[Any]":
        """Call a function on workers before the units that need its effects; they wait for the future."""

    def workers_table(self) -> list[dict[str, Any]]:
        """Return a row about each worker of a cluster, the longest busy first; empty for this machine's own."""

    def rest(self) -> None:
        """Let idle workers go, if no unit is open; the next unit starts new ones."""

    def close(self) -> None:
        """End the workers, and all open units with `PoolClosed`; may be called twice."""


def end(future: "Future[Any]", error: BaseException | None, result: Any = None) -> None:
    """End a future with an error or a result, unless it has ended before."""
    with suppress(InvalidStateError):
        if error is None:
            future.set_result(result)
        else:
            future.set_exception(error)
