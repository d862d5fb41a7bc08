"""What is wrong with a floor plan or a variation file, each with its place."""

from collections.abc import Iterable
from typing import Final, NoReturn

from vastflow.producers.model.faults import Fault, Note
from vastflow.sim.model.faults import UserError

__all__ = ["START", "Fault", "FloorplanError", "Note", "Place", "complain"]

Place = tuple[int, int]
"""Line and column, from 1."""

START: Final[Place] = (1, 1)
MOST_FAULTS: Final = 50
"""A file with more is wrong in one way, many times."""


class FloorplanError(UserError, ValueError):
    """A file that can't be used; holds every fault that was found, in the order of the file."""

    def __init__(self, faults: Iterable[Fault]) -> None:
        found = sorted(dict.fromkeys(faults), key=lambda fault: (fault.line, fault.column))
        self.faults = tuple(found[:MOST_FAULTS])
        super().__init__(self.faults)  # as argument, so that it can be pickled

    def __str__(self) -> str:
        return "\n".join(map(str, self.faults))

    @property
    def brief(self) -> str:
        """The first fault, and how many there are beside it."""
        others = len(self.faults) - 1
        return f"{self.faults[0]}{f' (and {others} more)' if others else ''}"


def complain(file: str, place: Place, where: str, what: str, right: str, *, missing: bool = False) -> NoReturn:
    """Raise a fault that stands alone."""
    raise FloorplanError([Fault(file, *place, where, what, right, missing)])
