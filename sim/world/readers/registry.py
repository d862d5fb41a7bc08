"""Readers of maps and worlds by the files' suffixes, and what they read."""

import os
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path

from vastflow.sim.model.files import Missing, Unreadable, is_inside
from vastflow.sim.plug_ins.registry import known_plug_ins
from vastflow.sim.world.bodies import Body
from vastflow.sim.world.map_file import RosMap
from vastflow.sim.world.occupancy import OccupancyMap
from vastflow.sim.world.readers.body_list import BodyList
from vastflow.sim.world.readers.reader import GROUP, MOST_BODIES, MissingWorld, WorldError, WorldReader


def known_reader(path: Path) -> type[WorldReader]:
    """Return the reader of a file by the end of its name; raise a `WorldError` if there is none."""
    if found := reader_of(path):
        return found
    suffixes = sorted(end for each in _readers() for end in each.suffixes)
    raise WorldError(f"{path}: There is no reader of this kind of world. Expected {', '.join(suffixes)}.")


def reader_of(path: Path) -> type[WorldReader] | None:
    """Return the reader of a file by the end of its name; None if there is none."""
    return next((reader for reader in _readers() if path.name.lower().endswith(reader.suffixes)), None)


def _readers() -> Iterator[type[WorldReader]]:
    yield from (RosMap, BodyList)
    yield from (entry.load() for entry in known_plug_ins(GROUP).values())


def read_file(path: Path, reader: type[WorldReader] | None = None) -> tuple[Body, ...] | OccupancyMap:
    """Return the bodies of a world file, or the cells of a map.

    Args:
        reader: None for the one of its suffix, or that of maps.

    Raises:
        WorldError: no such file, or one that can't be used.
    """
    reader = reader or reader_of(path) or next(_readers())
    with _errors_of(path):
        found = reader.read(path)
        if isinstance(found, OccupancyMap):
            return found
        bodies = tuple(found)
    if not bodies:
        raise WorldError(f"{path}: The world has no body that a robot could meet. Expected one or more.")
    if len(bodies) > MOST_BODIES:
        raise WorldError(f"{path}: expected {MOST_BODIES:,} bodies at most, got {len(bodies):,}")
    return bodies


@contextmanager
def _errors_of(path: Path) -> Iterator[None]:
    try:
        yield
    except Missing:
        raise MissingWorld(f"{path}: No such file. Expected a world.") from None
    except Unreadable as error:
        line, column = error.place
        raise WorldError(f"{path}:{line}:{column}: {error}") from None


def files_of_world(path: Path) -> Sequence[Path]:
    """Return the files that a map or world is read from, the named one first; raises as `read_file`."""
    with _errors_of(path):
        return (reader_of(path) or next(_readers())).files(path)


def check_within(path: Path, folder: Path) -> None:
    """Raise a `WorldError` before a file of a map or world is read outside of a folder, links followed."""
    home = os.path.realpath(folder)
    files = [path] if not is_inside(path, home) else files_of_world(path)
    if outside := [str(file) for file in files if not is_inside(file, home)]:
        raise WorldError(f"{path}: expected the files of a world in {str(folder)!r}, got {outside[0]!r}")
