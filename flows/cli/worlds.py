"""A folder of maps and Gazebo worlds as the places of a campaign."""

import math
import re
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Final, TypeAlias

from vastflow.sim.model.faults import UserError
from vastflow.sim.model.files import Unreadable, read_text, yaml_value
from vastflow.sim.world.readers.actors import walkers
from vastflow.sim.world.readers.reader import WorldError
from vastflow.sim.world.readers.sdf import Sdf
from vastflow.sim.world.world import world_content

VARIANTS: Final = ("-partially-unknown", "-dynamic")
"""Ends of names by which MRPB tells other maps of a world, and worlds of a map with people."""
_POSE: Final = re.compile(r'"(initial|goal)_pose_([xya])"\s+default="([^"]*)"')

Trip: TypeAlias = tuple[list[float], list[float]]
"""Start and goal: x, y (m), and yaw (rad)."""


@dataclass(slots=True)
class Place:
    """The files of one name in a folder; a variant takes from its base what it lacks.

    Attributes:
        map_file: What the robot knows.
        world: What stands there, where that is another file than the map.
        trips: Starts and goals that MRPB's `config.txt` gives.
        movers: People of the world's `actor`s, as the key `movers` has them.
    """

    name: str
    map_file: Path | None = None
    world: Path | None = None
    trips: tuple[Trip, ...] = ()
    movers: list[dict[str, Any]] = field(default_factory=list)


def places_in(folder: Path) -> tuple[list[Place], list[str]]:
    """Return the places of a folder and those below it, and a sentence on each file that can't be used.

    A map or a file of poses that is called `map` or `config` has its folder's name. Of several maps or worlds of a name the first counts.

    Raises:
        UserError: there is no map and no world that can be used.
    """
    places: dict[str, Place] = {}
    left_out: list[str] = []
    for file in sorted(folder.rglob("*")):
        name = slug(file.parent.name if file.stem in ("map", "config") else file.stem)
        try:
            kind = _kind(file)
            if kind is None:
                continue
            place = places.setdefault(name, Place(name))
            if kind == "trips":
                place.trips = place.trips or tuple(_trips(file))
            elif (first := getattr(place, kind)) is not None:
                left_out.append(f"{file}: {first} is the first of this name")
            else:
                world_content(file)
                if kind == "world":
                    place.movers = list(walkers(file))
                setattr(place, kind, file)
        except (WorldError, Unreadable, ValueError) as error:
            left_out.append(str(error) if str(file) in str(error) else f"{file}: {error}")
    found: list[Place] = []
    for place in places.values():
        base = places.get(next((place.name.removesuffix(end) for end in VARIANTS if place.name.endswith(end)), ""))
        if base is not None and (place.map_file or place.world):
            place.world = place.world or base.world or (base.map_file if place.map_file else None)
            place.map_file = place.map_file or (base.map_file if place.world else None)
        if place.map_file or place.world:
            found.append(place)
        elif place.trips:
            left_out.append(f"{place.name}: There are starts and goals, and no map or world of this name.")
    if not found:
        why = f"got: {left_out[0]}" if left_out else "got none"
        raise UserError(f"{folder}: expected maps of map_server or Gazebo worlds, {why}")
    return found, left_out


def slug(name: str) -> str:
    """Return a name that a family or a campaign can have."""
    return re.sub(r"[^a-z0-9]+", "-", name.lower()).strip("-")[:80].strip("-") or "place"


def _kind(file: Path) -> str | None:
    if file.name == "config.txt":
        return "trips" if _POSE.search(read_text(file)) else None
    if file.suffix in Sdf.suffixes and file.name != "model.sdf":
        return "world"
    if file.suffix not in (".yaml", ".yml"):
        return None
    header = yaml_value(read_text(file))
    return "map_file" if isinstance(header, dict) and "image" in header else None


def _trips(file: Path) -> Iterator[Trip]:
    """Yield starts and goals, each of six lines as of a launch file."""
    values = [float(value) for *_, value in _POSE.findall(read_text(file))]
    if len(values) % 6 or not all(map(math.isfinite, values)):
        raise ValueError(f"expected x, y, and yaw of starts and goals in turn, got {len(values)} numbers")
    for k in range(0, len(values), 6):
        yield values[k : k + 3], values[k + 3 : k + 6]
