"""Maps in few bytes: as PNG, and cut to the part that a run needs."""

import io
import math
from collections.abc import Mapping
from pathlib import PurePosixPath
from typing import Final, TypeAlias

import yaml
from PIL import Image

from vastflow.sim.model.files import yaml_value

Files: TypeAlias = Mapping[str, bytes]
Bounds: TypeAlias = tuple[float, float, float, float]
"""x0, y0, x1, y1 in the map frame (m)."""
FOLDER: Final = "map"
"""Folder of a candidate's map, see `vastflow.flows.analysis.candidate_file`."""


def with_small_map(files: Files, bounds: Bounds | None = None) -> dict[str, bytes]:
    """Return files with the map in fewer bytes, cut to whole cells around `bounds`, its origin moved with its corner.

    A map that is no picture in 8 bits of gray stays as it is; one that is turned is not cut.
    """
    found = dict(files)
    place = next((each for each in files if PurePosixPath(each).parts[0] == FOLDER and each.endswith("ml")), None)
    header = yaml_value(files[place].decode()) if place else {}
    image = "" if place is None else str(PurePosixPath(place).parent / str(header.get("image")))
    if place is None or image not in files:
        return found
    picture: Image.Image = Image.open(io.BytesIO(files[image]))
    if picture.mode != "L":
        return found
    if bounds is not None and not any(header["origin"][2:]):
        left, top, right, bottom = _box(header["origin"], float(header["resolution"]), picture.size, bounds)
        (x_m, y_m, *rest), resolution_m = header["origin"], float(header["resolution"])
        origin = [round(x_m + left * resolution_m, 9), round(y_m + (picture.height - bottom) * resolution_m, 9), *rest]
        header, picture = {**header, "origin": origin}, picture.crop((left, top, right, bottom))
    png = io.BytesIO()
    picture.save(png, "png", optimize=True)
    name = f"{PurePosixPath(place).stem}.png"
    del found[image]
    found[f"{PurePosixPath(place).parent}/{name}"] = png.getvalue()
    found[place] = yaml.safe_dump({**header, "image": name}, sort_keys=False).encode()
    return found


def _box(origin: list[float], resolution_m: float, size: tuple[int, int], bounds: Bounds) -> tuple[int, int, int, int]:
    """Return left, upper, right, and lower pixel of a cut, at most those of the map."""
    (width, height), (x0, y0, x1, y1) = size, bounds
    left = max(0, math.floor((x0 - origin[0]) / resolution_m))
    right = min(width, math.ceil((x1 - origin[0]) / resolution_m))
    low = max(0, math.floor((y0 - origin[1]) / resolution_m))
    high = min(height, math.ceil((y1 - origin[1]) / resolution_m))
    return left, height - high, right, height - low
