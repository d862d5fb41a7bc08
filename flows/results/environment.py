"""Environments in the campaign directory: maps written anew, so that it is complete on its own."""

import shutil
from collections.abc import Mapping
from pathlib import Path

import numpy as np
import yaml
from PIL import Image

from vastflow.producers.floorplan.environment import MESH, PLAN, PROVENANCE
from vastflow.sim.model.digest import FileContent
from vastflow.sim.world.map_file import load_map
from vastflow.sim.world.occupancy import FREE, OCCUPIED, UNKNOWN, OccupancyMap

_GRAY = {FREE: 254, OCCUPIED: 0, UNKNOWN: 205}
"""The gray values of ROS' map_saver."""


def write_environment(directory: Path, map_file: FileContent, maps: Mapping[str, OccupancyMap]) -> None:
    """Write a configuration's map into `directory`, and what a producer made with it of a floor plan.

    Args:
        maps: Digest to the maps that the campaign file names; any other is a producer's own.
    """
    if map_file.digest in maps:
        write_map(directory, maps[map_file.digest])
        return
    write_map(directory, load_map(map_file.path))
    for name in (MESH, PLAN, PROVENANCE):
        beside = Path(map_file.path).with_name(name)
        if beside.is_file():
            shutil.copyfile(beside, directory / name)


def write_map(directory: Path, occupancy: OccupancyMap) -> None:
    """Write `map.yaml` and `map.pgm` into `directory`; `load_map` gives the same map, digest included.

    A map with cells between free and occupied is written in mode `raw`, others in mode `trinary`.
    """
    directory.mkdir(parents=True, exist_ok=True)
    cells = occupancy.cells[::-1]  # a picture's first row is at the top
    trinary = bool(np.isin(cells, list(_GRAY)).all())
    if trinary:
        gray = np.select([cells == value for value in _GRAY], list(_GRAY.values()))
    else:
        gray = np.where(cells == UNKNOWN, 255, cells.astype(np.int16))
    Image.fromarray(gray.astype(np.uint8)).save(directory / "map.pgm")
    header = {
        "image": "map.pgm",
        "mode": "trinary" if trinary else "raw",
        "resolution": float(occupancy.resolution_m),
        "origin": [*(float(meters) for meters in occupancy.origin_xy_m), float(occupancy.yaw_rad)],
        "negate": 0,
        "occupied_thresh": 0.65,
        "free_thresh": 0.196,  # just below the gray of unknown cells, which Nav2's 0.25 would read as free
    }
    (directory / "map.yaml").write_text(yaml.safe_dump(header, sort_keys=False), encoding="utf-8")
