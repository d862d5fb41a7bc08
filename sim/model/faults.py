"""Faults and errors: a mistake with its place, the root of errors that a user can mend, and why a scenario can't work."""

from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class Place:
    """Where something stands; line and column count from 1."""

    file: str
    line: int
    column: int

    def __str__(self) -> str:
        return f"{self.file}:{self.line}:{self.column}"


def complaint(problem: str, expected: str) -> str:
    """Return `expected a path, got 3` for `got 3` and `a path`, and both with a semicolon for other problems."""
    if problem.startswith("got ") and not expected.startswith("did you mean"):
        return f"expected {expected}, {problem}"
    return f"{problem}; {expected}" if expected else problem


@dataclass(frozen=True, slots=True)
class Fault:
    """A mistake in a file.

    Attributes:
        what: What was found.
        right: What would be right.
    """

    place: Place
    what: str
    right: str

    def __str__(self) -> str:
        return f"{self.place}: {complaint(self.what, self.right)}"


class UserError(Exception):
    """A mistake in a file, an option or an argument, or of the machine; says where, what was found and what would be right."""


class ScenarioError(ValueError):
    """A scenario that can't be executed as it stands, such as one whose program can't be started.

    The run is not recorded and not judged: that the scenario can't work says nothing of the system under test. The message says
    where, what was found, and what would be right.
    """
