"""The interface of world readers, and the one that reads a file."""

import functools
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import ClassVar, Final, Protocol

from vastflow.sim.model.digest import FileContent, digest
from vastflow.sim.model.faults import ScenarioError
from vastflow.sim.model.files import Missing, Unreadable
from vastflow.sim.plug_ins.registry import installed_plug_in, known_plug_ins
from vastflow.sim.world.bodies import Body

GROUP: Final = "vastflow.worlds"
MOST_BODIES: Final = 100_000
FARTHEST_M: Final = 10_000.0
"""Greatest distance of a body from the origin, and greatest size."""
_KEPT: Final = 4


class WorldError(ScenarioError):
    """A world file that can't be used."""


class WorldReader(Protocol):
    """A reader of one kind of world file.

    Attributes:
        suffixes: Ends of the names of its files, such as `.sdf`.
    """

    suffixes: ClassVar[tuple[str, ...]]

    @staticmethod
    def read(path: Path) -> Sequence[Body]:
        """Return the bodies of a file, whose pose, size, and heights are finite and in the map's frame.

        Raises:
            WorldError: the file can't be used; with its place, the problem, and what was expected.
            Unreadable: it can't be read at all.
        """

    @staticmethod
    def files(path: Path) -> Sequence[Path]:
        """Return the files that are read, the named one first; raises as `read`."""


def reader_of(path: Path) -> type[WorldReader] | None:
    """Return the reader of a file by the end of its name; None if there is none."""
    return next((reader for reader in _readers() if path.name.lower().endswith(reader.suffixes)), None)


def _readers() -> Iterator[type[WorldReader]]:
    yield from filter(None, (installed_plug_in(GROUP, name) for name in known_plug_ins(GROUP)))


def read_bodies(path: Path) -> tuple[Body, ...]:
    """Return the bodies of a world file.

    Raises:
        WorldError: no such file, no reader for it, or a file that can't be used.
    """
    reader = reader_of(path)
    if reader is None:
        suffixes = sorted(end for each in _readers() for end in each.suffixes)
        raise WorldError(f"{path}: There is no reader of this kind of world. Expected {', '.join(suffixes)}.")
    try:
        bodies = tuple(reader.read(path))
    except Missing:
        raise WorldError(f"{path}: No such file. Expected a world.") from None
    except Unreadable as error:
        line, column = error.place
        raise WorldError(f"{path}:{line}:{column}: {error}") from None
    if not bodies:
        raise WorldError(f"{path}: The world has no body that a robot could meet. Expected one or more.")
    if len(bodies) > MOST_BODIES:
        raise WorldError(f"{path}: expected {MOST_BODIES:,} bodies at most, got {len(bodies):,}")
    return bodies


def files_of_world(path: Path) -> Sequence[Path]:
    """Return the files that a world is read from, the named one first; raises as `read_bodies`."""
    reader = reader_of(path)
    return [path] if reader is None else reader.files(path)


def world_content(path: Path) -> FileContent:
    """Return a world file as a value, with the digest of its bodies; raises as `read_bodies`."""
    return FileContent(str(path), _digest(read_bodies(path)))


@functools.lru_cache(maxsize=_KEPT)
def bodies_of(content: FileContent) -> tuple[Body, ...]:
    """Return the bodies of a file's value; the last few are kept.

    Raises:
        WorldError: it can't be read, or has changed since the campaign was read.
    """
    bodies = read_bodies(Path(content.path))
    if _digest(bodies) != content.digest:
        raise WorldError(f"{content.path} changed since the campaign was read. Run the campaign again.")
    return bodies


def _digest(bodies: Sequence[Body]) -> str:
    return digest("world", [repr((body.shape, body.pose, body.bottom_m, body.top_m)) for body in bodies])
