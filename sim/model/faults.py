"""Faults and notes of files, each with its place, and the errors that a user can mend."""

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Literal, TypeAlias


@dataclass(frozen=True, slots=True)
class Place:
    """A place in a file.

    Attributes:
        line, column: From 1, as editors count; 0 for what is in no file.
        where: The value that stands there, such as `configuration[0].name`; may be empty.
    """

    file: str
    line: int = 1
    column: int = 1
    where: str = ""

    def __str__(self) -> str:
        return f"{self.file}:{self.line}:{self.column}"


FaultKind: TypeAlias = Literal["error", "missing", "warning", "unknown key", "not executed", "not modeled"]
"""`missing`: a named file is not there, or a list of goals is empty; what needs it can't be had, the rest can. `unknown key`: a warning that
`--strict` makes an error. `not executed`: the format knows the key and this version does nothing with it. `not modeled`: a Nav2
parameter file has what the simulator has not."""


@dataclass(frozen=True, slots=True)
class Fault:
    """A mistake in a file, or something that a user should know of a file that is valid.

    Attributes:
        problem: `got 3`, or the problem in other words.
        expected: What would be right or follows; may be empty.
    """

    place: Place
    problem: str
    expected: str = ""
    kind: FaultKind = "error"

    def __str__(self) -> str:
        where = f"{self.place.where}: " if self.place.where else ""
        warning = "warning: " if self.kind in ("warning", "unknown key") else ""
        place = f"{self.place}: " if self.place.line else ""
        return f"{place}{warning}{where}{complaint(self.problem, self.expected)}"


def complaint(problem: str, expected: str) -> str:
    """Return `expected a path, got 3` for `got 3` and `a path`, and both with a semicolon for other problems."""
    if problem.startswith("got ") and expected and not expected.startswith("did you mean"):
        return f"expected {expected.replace('known: ', 'one of ')}, {problem}"
    return f"{problem}; {expected}" if expected else problem


def parted(message: str) -> tuple[str, str]:
    """Split a complaint into the problem and the expected value; the latter may be empty."""
    if message.startswith("expected ") or ": expected " in message:
        return message, ""
    problem, _, expected = message.partition("; ")
    return problem, expected


class UserError(Exception):
    """A user's mistake: its place, the problem, and the expected value."""


class FileError(UserError, ValueError):
    """Files that can't be used, with all their faults by file and place."""

    def __init__(self, faults: Iterable[Fault]) -> None:
        distinct = dict.fromkeys(faults)
        files = list(dict.fromkeys(fault.place.file for fault in distinct))
        self.faults = tuple(sorted(distinct, key=lambda f: (files.index(f.place.file), f.place.line, f.place.column)))
        super().__init__(self.faults)  # as argument, so that it can be pickled

    def __str__(self) -> str:
        return "\n".join(map(str, self.faults))

    @property
    def brief(self) -> str:
        """The first fault, and the number of others."""
        others = len(self.faults) - 1
        return f"{self.faults[0]}{f' (and {others} more)' if others else ''}"


class ScenarioError(ValueError):
    """A scenario that can't be executed, for example because its program can't be started.

    The run is not recorded and not judged: that the scenario can't work says nothing of the system under test. The message says
    where, what was found, and what would be right.
    """
