"""Readers of maps and worlds by the files' suffixes, and what they read."""

import math
import os
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path

from vastflow.sim.model.files import Missing, Unreadable, is_inside
from vastflow.sim.model.shape import Box, Disc, Polygon
from vastflow.sim.plug_ins.registry import known_plug_ins
from vastflow.sim.world.bodies import HIGHEST_M, LOWEST_M, Body
from vastflow.sim.world.map_file import RosMap
from vastflow.sim.world.occupancy import OccupancyMap
from vastflow.sim.world.readers.body_list import BodyList
from vastflow.sim.world.readers.reader import FARTHEST_M, GROUP, MOST_BODIES, MissingWorld, WorldError, WorldReader


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
    return checked_bodies(bodies, str(path))


def checked_bodies(bodies: Sequence[Body], place: str) -> tuple[Body, ...]:
    """Return the bodies that a robot could meet; raise a `WorldError` for none, too many, or wrong ones."""
    if len(bodies) > MOST_BODIES:
        raise WorldError(f"{place}: expected {MOST_BODIES:,} bodies at most, got {len(bodies):,}")
    for body in bodies:
        if not _is_whole(body):
            right = f"an area within {2 * FARTHEST_M:g} m of the origin, with sizes above 0 and an outline that does not cross itself, and heights in order"
            found = f"{body.shape!s:.200} at {body.pose} from {body.bottom_m:g} m to {body.top_m:g} m"
            raise WorldError(f"{place}: {body.name}: expected {right}, got {found}")
    if met := tuple(body for body in bodies if body.top_m > LOWEST_M and body.bottom_m < HIGHEST_M):
        return met
    raise WorldError(f"{place}: The world has no body that a robot could meet. Expected one or more.")


def _is_whole(body: Body) -> bool:
    numbers, heights_in_order = [body.pose.x_m, body.pose.y_m, body.pose.yaw_rad], body.bottom_m < body.top_m
    match body.shape:
        case Disc(radius_m):
            sizes = [radius_m]
        case Box(length_m, width_m):
            sizes = [length_m, width_m]
        case Polygon(vertices_m):
            sizes = [len(vertices_m) - 2]
            numbers += (number for vertex in vertices_m for number in vertex)
    if not (min(sizes) > 0.0 and heights_in_order and all(map(math.isfinite, numbers + sizes))):
        return False
    outline = body.outline
    return all(abs(bound) <= 2 * FARTHEST_M for bound in outline.bounds) and outline.is_valid and outline.area > 0.0


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
