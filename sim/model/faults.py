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


FaultKind: TypeAlias = Literal[
    "error", "missing", "contradiction", "warning", "drawn", "unknown key", "not executed", "not modeled"
]
"""`missing`: a named file is not there, or a list of goals is empty; what needs it can't be had, the rest can. `contradiction`: an error of
values that are valid on their own. `drawn`: a warning on a drawn floor plan, which may not hold for the file as written. `unknown key`: a
warning that `--strict` makes an error. `not executed`: the format knows the key and this version does nothing with it. `not modeled`: a
Nav2 parameter file has what the simulator has not."""


@dataclass(frozen=True, slots=True)
class Got:
    """A value in place of the expected one, as the author of a file recognizes it."""

    given: str


Problem: TypeAlias = str | Got
"""A value in place of the expected one, or a sentence such as `unknown key 'runz'`."""
Complaint: TypeAlias = tuple[Problem, str]
"""A problem and the expected value, see `Fault`."""


def message_of(problem: Problem, expected: str = "") -> str:
    """Return `expected a path, got 3`, or the problem and what to do as two sentences."""
    if isinstance(problem, Got):
        return f"expected {expected}, got {problem.given}"
    return f"{_sentence(problem)} {_sentence(expected)}" if expected else problem


def _sentence(text: str) -> str:
    """Return a text with a full stop, and with a capital unless it begins with a name."""
    is_word = text.split(maxsplit=1)[0].rstrip(",").isalpha()
    return f"{text[:1].upper() if is_word else text[:1]}{text[1:]}{'' if text.endswith(('.', '?', '!')) else '.'}"


@dataclass(frozen=True, slots=True)
class Fault:
    """A mistake in a file, or something that a user should know of a file that is valid.

    Attributes:
        expected: A noun phrase for a value that is `Got`, else a sentence that says what to do or what follows; may be empty.
    """

    place: Place
    problem: Problem
    expected: str = ""
    kind: FaultKind = "error"

    def __str__(self) -> str:
        where = f"{self.place.where}: " if self.place.where else ""
        warning = "warning: " if self.kind in ("warning", "drawn", "unknown key") else ""
        place = f"{self.place}: " if self.place.line else ""
        return f"{place}{warning}{where}{message_of(self.problem, self.expected)}"


class Invalid(ValueError):
    """A value that can't be used, raised where its place is not known; for the attributes see `Fault`."""

    def __init__(self, problem: Problem, expected: str = "") -> None:
        super().__init__(problem, expected)
        self.problem, self.expected = problem, expected

    def __str__(self) -> str:
        return message_of(self.problem, self.expected)


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
