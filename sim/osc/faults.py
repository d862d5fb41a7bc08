"""What is wrong with a scenario file, each fault with its place and what would be right."""

from collections.abc import Callable, Collection, Iterable
from dataclasses import dataclass
from typing import TypeAlias

from vastflow.sim.osc.definition import Place
from vastflow.sim.user_error import UserError

TypeHint: TypeAlias = Callable[[str, Collection[str]], str]
"""What to write in place of an unknown type, from its name and all that are known."""


@dataclass(frozen=True, slots=True)
class OscFault:
    """A mistake in a scenario file.

    Attributes:
        what: What was found.
        right: What would be right.
    """

    place: Place
    what: str
    right: str

    def __str__(self) -> str:
        return f"{self.place}: {self.what}; {self.right}"


class OscError(UserError, ValueError):
    """A scenario file that can't be used; holds every fault that was found, file by file and in the order of each."""

    def __init__(self, faults: Iterable[OscFault]) -> None:
        distinct = list(dict.fromkeys(faults))
        files = list(dict.fromkeys(fault.place.file for fault in distinct))
        self.faults = tuple(
            sorted(distinct, key=lambda fault: (files.index(fault.place.file), fault.place.line, fault.place.column))
        )
        super().__init__(self.faults)  # as argument, so that it can be pickled

    def __str__(self) -> str:
        return "\n".join(map(str, self.faults))


def too_long(file: str) -> OscFault:
    """For a file with more operators in one another than Python has room for."""
    return OscFault(Place(file, 1, 1), "found an expression that is too long", "several shorter ones")
