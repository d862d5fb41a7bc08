"""What is wrong with a scenario file, each fault with its place and what would be right."""

from collections.abc import Callable, Collection, Iterable
from dataclasses import dataclass
from difflib import get_close_matches
from typing import Final, TypeAlias

from vastflow.sim.osc.definition import Place

MOST_LISTED: Final = 20

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


class OscError(ValueError):
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


def nearest(found: str, known: Iterable[str]) -> str | None:
    """The known name that `found` was meant to be, if one is near."""
    names = sorted(known)
    if near := get_close_matches(found, names, n=1):
        return near[0]
    # Upper and lower case are far apart to difflib, and a frequent slip.
    return next((name for name in names if name.casefold() == found.casefold()), None)


def did_you_mean(found: str, known: Iterable[str], otherwise: str = "nothing of the kind is declared") -> str:
    """What to write in place of an unknown name: the nearest known one, all of them, or `otherwise` without any."""
    names = sorted(known)
    if near := nearest(found, names):
        return f"did you mean {near!r}?"
    more = f" and {len(names) - MOST_LISTED} more" if len(names) > MOST_LISTED else ""
    return f"known: {', '.join(names[:MOST_LISTED])}{more}" if names else otherwise
