"""The system under test as everything outside of it knows it."""

from collections.abc import Collection, Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Final, NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from vastflow.sim.model.digest import FileContent, Value
from vastflow.sim.model.faults import Complaint, Fault
from vastflow.sim.plug_ins.registry import known_plug_ins
from vastflow.sim.system.facts import RobotFact
from vastflow.sim.world.robot_model import Lidar, Robot

GROUP: Final = "vastflow.systems"
NAV2: Final = "nav2"
"""The system of a campaign that names none."""


class Masks(NamedTuple):
    """The masks of the filters that are enabled; None without such a filter."""

    keepout: FileContent | None = None
    speed: FileContent | None = None


NO_MASKS: Final = Masks()


class FileParameter(NamedTuple):
    """A parameter of a system's file: its dotted path, its value, and its line."""

    path: str
    value: Value
    line: int


@dataclass(frozen=True, slots=True)
class SystemFile:
    """A system's parameter file as a campaign has it.

    Attributes:
        values: Values that every scenario's system has from it.
        faults: Why it can't be used.
        notes: Notes on what is read otherwise than the file's author may expect.
        defaults: Entry of `metadata.json`: the defaults that count for what the file leaves out, and since which version.
    """

    values: Mapping[str, Value] = field(default_factory=dict)
    faults: tuple[Fault, ...] = ()
    notes: tuple[Fault, ...] = ()
    defaults: Mapping[str, Mapping[str, Value]] | None = None


class System(Protocol):
    """A robot and the software that drives it, as the values of a scenario's system dimension choose them.

    What follows from the values raises `FileError` where they can't be used: with each fault, at the key that is wrong.
    """

    @property
    def robot(self) -> Robot:
        """Body and actuators."""

    @property
    def lidar(self) -> Lidar:
        """The laser scanner."""

    @property
    def inscribed_radius_m(self) -> float:
        """Radius of the largest disc inside of the robot."""

    @property
    def start_outline(self) -> NDArray[np.float64]:
        """(V, 2) vertices in the robot's frame (m) of the area that must be free where it starts."""

    @property
    def needs_map(self) -> bool:
        """Whether it drives on a map that it is given."""

    @property
    def masks(self) -> Masks:
        """The masks that it names for its filters; raises `ScenarioError` for a filter without one."""

    @property
    def software(self) -> str:
        """Name of the code that runs: systems of one name are compiled once."""

    @property
    def facts(self) -> tuple[RobotFact, ...]:
        """Its quantities in words."""

    @property
    def whose(self) -> str:
        """One line on the origin of the robot's quantities."""

    @property
    def defaults(self) -> Mapping[str, Mapping[str, Value]] | None:
        """See `SystemFile`; None for a system without a file."""

    def missing_masks(self) -> Iterator[tuple[str, Complaint]]:
        """Yield the keys of masks that its filters need and its values lack."""

    def check_all(self) -> None:
        """Check all values together."""

    def check(self, key: str, value: Value) -> bool:
        """Check one more key; return True if it is a parameter's."""

    def unread(self, undecided: Iterable[str] = ()) -> tuple[str, ...]:
        """Return the keys that nothing reads, sorted.

        Args:
            undecided: More keys, whose values are not known yet.
        """

    def intended_key(self, key: str, others: Iterable[str] = ()) -> str | None:
        """Return the key that one which nothing reads was meant to be, spelled alike; None if there is none.

        Args:
            others: Known keys that are not the system's.
        """

    def unused_because(self, key: str) -> str:
        """Return why other parameters make one ineffective; empty for any other key."""

    def usual(self, key: str) -> float | None:
        """Return the number that a parameter has where nothing is given; None if it is no number."""

    def spelled_out(self) -> Mapping[str, Value]:
        """Return the values of the same system without a file: each parameter that differs from the defaults is a key.

        They are its own values where keys can't say what the file says.
        """

    def assumed_keys(self) -> frozenset[str]:
        """Return the keys of `spelled_out` that stand neither in the values nor in the file."""


class SystemKind(Protocol):
    """A kind of system, which an entry point of `vastflow.systems` names."""

    def of(self, values: Mapping[str, Value], *, is_drawn: bool = False) -> System:
        """Return the system of a scenario's values.

        Args:
            is_drawn: Whether it is only described or drawn: nothing of plug-ins in files is executed, or known.
        """

    def variants(self, values: Mapping[str, Value], varied: Collection[str]) -> list[Mapping[str, Value]]:
        """Return the values with each software that `varied` keys may choose."""

    def read_file(self, path: Path, values: Mapping[str, Value]) -> SystemFile:
        """Return a parameter file, its faults, and its notes.

        Args:
            values: Other values of the campaign that say how to read it.
        """

    def file_content(self, path: Path, within: Path | None = None) -> FileContent:
        """Return a file as a value of a scenario, with the plug-ins that it names.

        Args:
            within: Folder in which plug-ins must lie; None for any.

        Raises:
            FileError: it can't be read.
        """

    def file_parameters(self, path: Path) -> Iterator[FileParameter]:
        """Yield the parameters of a file as they are written; raises `FileError`."""

    def account(self, path: Path) -> Mapping[str, Any]:
        """Return what is made of each parameter of a file, as `vastflow params --json` prints it; raises `FileError`."""


def system_kind(name: str = NAV2) -> SystemKind:
    """Return the kind of system called `name`.

    Raises:
        ValueError: there is none.
    """
    entry = known_plug_ins(GROUP).get(name)
    if entry is None:
        raise ValueError(
            f"There is no system {name!r}. Install vastflow again if its source is newer than its metadata."
        )
    kind: SystemKind = entry.load()
    return kind


def system_of(values: Mapping[str, Value], *, is_drawn: bool = False) -> System:
    """Return the system of a scenario's values; see `SystemKind.of`."""
    return system_kind().of(values, is_drawn=is_drawn)
