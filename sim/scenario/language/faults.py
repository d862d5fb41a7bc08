"""Faults of scenario files."""

from collections.abc import Callable, Collection, Iterable
from typing import TypeAlias

from vastflow.sim.model.faults import Fault, Place, UserError

TypeHint: TypeAlias = Callable[[str, Collection[str]], str]
"""What to write in place of an unknown type, from its name and all that are known."""


class OscError(UserError, ValueError):
    """A scenario file with faults, sorted by file and place."""

    def __init__(self, faults: Iterable[Fault]) -> None:
        distinct = list(dict.fromkeys(faults))
        files = list(dict.fromkeys(fault.place.file for fault in distinct))
        self.faults = tuple(
            sorted(distinct, key=lambda fault: (files.index(fault.place.file), fault.place.line, fault.place.column))
        )
        super().__init__(self.faults)  # as argument, so that it can be pickled

    def __str__(self) -> str:
        return "\n".join(map(str, self.faults))


def too_long(file: str) -> Fault:
    """For a file with more operators in one another than Python has room for."""
    return Fault(Place(file, 1, 1), "got an expression that is too long", "several shorter ones")
