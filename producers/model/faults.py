"""What is wrong with a campaign file, and what is worth knowing of it, each with its place."""

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Final, Literal, TypeAlias

from vastflow.sim.model.faults import UserError, complaint

Location: TypeAlias = tuple[str | int, ...]
"""Path of a value from the top of the file: keys of mappings and indices of lists."""

MISSING_FILE: Final = "missing_file"
"""Type of the pydantic error of a parameter that names a file which is not there."""
NOT_EXECUTED = "not executed by this version"
AS_DRAWN: Final = "as drawn with seed"
"""How a note begins that is not of a floor plan as it is written."""


@dataclass(frozen=True, slots=True)
class Fault:
    """A user's mistake in a file.

    Attributes:
        line, column: From 1, as editors count.
        where: Path of the value, such as `configuration[0].name`.
        what: What was found.
        right: What would be right.
        missing: Whether all that is wrong is that a named file is not there, or a list of goals is empty: the family that needs it can't be
            had, the others can.
    """

    file: str
    line: int
    column: int
    where: str
    what: str
    right: str
    missing: bool = False

    def __str__(self) -> str:
        return f"{self.file}:{self.line}:{self.column}: {self.where}: {complaint(self.what, self.right)}"


@dataclass(frozen=True, slots=True)
class Note:
    """Something a user should know about a file that is valid.

    Attributes:
        kind: `unknown key` for a warning that `--strict` makes an error, `not executed` where the format knows the key and
            this version does nothing with it, `not modeled` where
            a Nav2 parameter file has what the simulator has not.
        what: What was found.
        right: What follows from it or would be right; may be empty.
    """

    kind: Literal["warning", "unknown key", "not executed", "not modeled"]
    file: str
    line: int
    column: int
    where: str
    what: str
    right: str = ""

    def __str__(self) -> str:
        place = f"{self.file}:{self.line}:{self.column}: {'warning: ' if self.kind in ('warning', 'unknown key') else ''}{self.where}"
        return f"{place}: {complaint(self.what, self.right)}"


class CampaignError(UserError):
    """A campaign file that can't be used; holds every fault that was found, file by file and in the order of each."""

    def __init__(self, faults: Iterable[Fault]) -> None:
        distinct = list(dict.fromkeys(faults))
        files = list(dict.fromkeys(fault.file for fault in distinct))
        self.faults = tuple(sorted(distinct, key=lambda fault: (files.index(fault.file), fault.line, fault.column)))
        super().__init__(self.faults)  # as argument, so that it can be pickled

    def __str__(self) -> str:
        return "\n".join(map(str, self.faults))


def path_text(location: Location) -> str:
    """`configuration[0].name` for `("configuration", 0, "name")`; `file` for the top."""
    text = ""
    for part in location:
        text += f"[{part}]" if isinstance(part, int) else f".{part}" if text else part
    return text or "file"


def shown(value: object, limit: int = 60) -> str:
    """`value` as a YAML author would recognize it, in at most `limit` characters."""
    if value is None:
        return "nothing"
    if isinstance(value, bool):
        return "true" if value else "false"
    text = repr(value)
    return text if len(text) <= limit else f"{text[: limit - 1]}…"
