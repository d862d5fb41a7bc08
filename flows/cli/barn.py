"""The BARN benchmark as a campaign: worlds and reference lengths from its data."""

import csv
import gzip
import io
import itertools
import json
import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Final, TypeAlias

import numpy as np

from vastflow.sim.model.faults import UserError
from vastflow.sim.model.files import MOST_TEXT_BYTES, read_bytes
from vastflow.sim.model.shape import Disc
from vastflow.sim.world.occupancy import OccupancyMap
from vastflow.sim.world.readers.registry import read_file

WORLDS: Final = 300
SOURCE: Final = "https://github.com/Daffan/the-barn-challenge (MIT)"
NAV2_SOURCE: Final = "jackal_helper/config/nav2.yaml of https://github.com/Saadmaghani/The-Barn-Challenge-Ros2"

_RADIUS_M: Final = 0.075
_START_M: Final = (-2.0, 3.0)
_GOAL_M: Final = (-2.0, 13.0)
"""Ends of the benchmark's reference paths."""
_CELL_M: Final = 0.15
_ORIGIN_M: Final = (-4.575, 5.075)
"""Grid of the reference paths."""
_CYLINDERS: Final = "barn-cylinders.csv.gz"
_PATHS: Final = "barn-paths.json.gz"

Points: TypeAlias = Sequence[Sequence[float]]


@dataclass(frozen=True, slots=True)
class BarnWorld:
    """A world of the benchmark.

    Attributes:
        centers_m: (N, 2) x, y of its cylinders, as written in the benchmark's file.
        path_cells: (M, 2) reference path on the benchmark's grid.
    """

    centers_m: Points
    path_cells: Points

    @property
    def length_m(self) -> float:
        """Length of the reference path from the benchmark's start to its goal."""
        cells = [
            [cell * _CELL_M + origin for cell, origin in zip(at, _ORIGIN_M, strict=True)] for at in self.path_cells
        ]
        return math.fsum(math.dist(a, b) for a, b in itertools.pairwise([_START_M, *cells, _GOAL_M]))

    @property
    def circles(self) -> str:
        """The cylinders as a CSV file of circles."""
        return "x,y,radius\n" + "".join(f"{x:g},{y:g},{_RADIUS_M}\n" for x, y in self.centers_m)


def has_barn(folder: Path) -> bool:
    """Return whether a folder looks as if it had the benchmark's data, packed or as a clone."""
    return (folder / _CYLINDERS).is_file() or any(folder.rglob("BARN"))


def barn_worlds(folder: Path, every: int) -> dict[int, BarnWorld]:
    """Return every so many worlds by their numbers, from the two packed files or from a clone of the benchmark.

    Raises:
        UserError: a file is missing or can't be used.
    """
    numbers = range(0, WORLDS, every)
    try:
        worlds = _packed(folder) if (folder / _CYLINDERS).is_file() else _cloned(folder, numbers)
    except (LookupError, ValueError, TypeError, OSError, EOFError) as error:
        raise UserError(f"{folder}: expected the benchmark's worlds, as at {SOURCE}, got: {error}") from None
    if missing := [number for number in numbers if number not in worlds]:
        right = f"{_CYLINDERS} and {_PATHS}, or a clone of {SOURCE}"
        raise UserError(f"{folder}: expected {right}, got no world {missing[0]}")
    return {number: worlds[number] for number in numbers}


def _packed(folder: Path) -> dict[int, BarnWorld]:
    paths = json.loads(_unzipped(folder / _PATHS))
    centers_m: dict[int, list[tuple[float, float]]] = {}
    for row in csv.DictReader(_unzipped(folder / _CYLINDERS).decode().splitlines()):
        centers_m.setdefault(int(row["world"]), []).append((float(row["x"]), float(row["y"])))
    return {number: BarnWorld(at_m, paths[str(number)]) for number, at_m in centers_m.items()}


def _unzipped(path: Path) -> bytes:
    return gzip.GzipFile(fileobj=io.BytesIO(read_bytes(path))).read(MOST_TEXT_BYTES)


def _cloned(folder: Path, numbers: range) -> dict[int, BarnWorld]:
    worlds: dict[int, BarnWorld] = {}
    for place in sorted(folder.rglob("BARN")):
        for number in numbers:
            file, path = place / f"world_{number}.world", place / "path_files" / f"path_{number}.npy"
            if not (file.is_file() and path.is_file()):
                continue
            found = read_file(file)
            bodies = () if isinstance(found, OccupancyMap) else found
            if any(body.shape != Disc(_RADIUS_M) for body in bodies):
                raise ValueError(f"{file} has others than cylinders of {_RADIUS_M} m")
            cells = np.lib.format.read_array(io.BytesIO(read_bytes(path)), allow_pickle=False).tolist()
            worlds[number] = BarnWorld([(body.pose.x_m, body.pose.y_m) for body in bodies], cells)
    return worlds
