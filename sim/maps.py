"""Occupancy maps in the ROS map_server format: a YAML file and a PGM or PNG picture."""

import contextlib
import math
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any, Final

import numpy as np
import yaml
from numpy.typing import NDArray
from PIL import Image, UnidentifiedImageError

from vastflow.sim.digest import FileContent, digest

FREE: Final = 0
OCCUPIED: Final = 100
UNKNOWN: Final = -1


class MapError(ValueError):
    """A map file that can't be used; says which, what was found and what would be right."""


@dataclass(frozen=True, eq=False)
class OccupancyMap:
    """A grid of occupancy.

    Attributes:
        cells: (H, W) int8, row 0 at the lowest y: 0 free, 1..99 between, 100 occupied, -1 unknown.
        resolution_m: Edge of a cell.
        origin_xy_m: Map position of the lower left corner of cell (0, 0).
    """

    cells: NDArray[np.int8]
    resolution_m: float
    origin_xy_m: tuple[float, float]

    @property
    def shape(self) -> tuple[int, int]:
        """(rows, columns)."""
        rows, columns = self.cells.shape
        return rows, columns

    @cached_property
    def free(self) -> NDArray[np.bool_]:
        """(H, W), True where a cell is known to be free."""
        return np.asarray(self.cells == FREE)

    @cached_property
    def occupied(self) -> NDArray[np.bool_]:
        """(H, W), True where a cell is a wall."""
        return np.asarray(self.cells == OCCUPIED)

    def cell_of(self, x_m: float, y_m: float) -> tuple[int, int]:
        """(row, column) of the cell that holds a point; it may lie outside the grid."""
        return (
            math.floor((y_m - self.origin_xy_m[1]) / self.resolution_m),
            math.floor((x_m - self.origin_xy_m[0]) / self.resolution_m),
        )

    def centre_of(self, row: int, column: int) -> tuple[float, float]:
        """Map position (x, y) in metres of a cell's centre."""
        return (
            self.origin_xy_m[0] + (column + 0.5) * self.resolution_m,
            self.origin_xy_m[1] + (row + 0.5) * self.resolution_m,
        )

    def contains(self, row: int, column: int) -> bool:
        """Whether the grid has this cell."""
        rows, columns = self.shape
        return 0 <= row < rows and 0 <= column < columns

    @cached_property
    def digest(self) -> str:
        """Digest of what the robot and the world see of the map."""
        cells = np.ascontiguousarray(self.cells)
        return digest(list(cells.shape), cells.tobytes().hex(), self.resolution_m, list(self.origin_xy_m))


def load_map(path: str | Path) -> OccupancyMap:
    """Read a map as Nav2's map_server does (modes trinary, scale and raw; negate; thresholds).

    Raises:
        MapError: a missing or unreadable file, a missing or wrong key, a yaw in the origin (AMCL and the
            static layer ignore it, so such a map would be placed wrongly in silence).
    """
    path = Path(path)
    header = _header(path)
    resolution_m = _number(header, "resolution", path)
    if not resolution_m > 0:
        raise MapError(f"{path}: resolution: found {resolution_m!r}; metres per cell, greater than 0")
    occupied_threshold = _number(header, "occupied_thresh", path, default=0.65)
    free_threshold = _number(header, "free_thresh", path, default=0.25)
    mode = str(header.get("mode", "trinary"))
    if mode not in ("trinary", "scale", "raw"):
        raise MapError(f"{path}: mode: found {mode!r}; trinary, scale or raw")
    grey, alpha = _picture(path, str(header["image"]))
    cells = _occupancy(grey, alpha, mode, _flag(header, "negate", path), occupied_threshold, free_threshold)
    return OccupancyMap(np.ascontiguousarray(cells[::-1]), resolution_m, _origin(header, path))


def map_content(path: str | Path) -> FileContent:
    """The map at `path` as a value: its digest covers the decoded grid, not the files' names or bytes."""
    return FileContent(str(path), load_map(path).digest)


def _header(path: Path) -> Mapping[str, Any]:
    try:
        header = yaml.load(path.read_text(encoding="utf-8"), Loader=yaml.CSafeLoader)
    except FileNotFoundError:
        raise MapError(f"{path}: no such file; a map is a map_server YAML file") from None
    except (OSError, UnicodeDecodeError) as error:
        raise MapError(f"{path}: can't be read: {error}") from None
    except yaml.YAMLError as error:
        raise MapError(f"{path}: not YAML: {' '.join(str(error).split())}") from None
    if not isinstance(header, dict):
        raise MapError(f"{path}: found {type(header).__name__}; a map is a mapping with image, resolution and origin")
    for key in ("image", "resolution", "origin"):
        if key not in header:
            raise MapError(f"{path}: no key {key!r}; a map has image, resolution and origin")
    return header


def _number(header: Mapping[str, Any], key: str, path: Path, default: float | None = None) -> float:
    value = header.get(key, default)
    if isinstance(value, str):  # YAML 1.1 reads 5e-2 as text
        with contextlib.suppress(ValueError):
            value = float(value)
    if isinstance(value, bool) or not isinstance(value, int | float) or not math.isfinite(value):
        raise MapError(f"{path}: {key}: found {value!r}; a number")
    return float(value)


def _flag(header: Mapping[str, Any], key: str, path: Path) -> bool:
    value = header.get(key, 0)
    if value not in (0, 1):
        raise MapError(f"{path}: {key}: found {value!r}; 0 or 1")
    return bool(value)


def _origin(header: Mapping[str, Any], path: Path) -> tuple[float, float]:
    origin = header["origin"]
    if (
        not isinstance(origin, list)
        or len(origin) not in (2, 3)
        or not all(isinstance(o, int | float) and not isinstance(o, bool) and math.isfinite(o) for o in origin)
    ):
        raise MapError(f"{path}: origin: found {origin!r}; [x, y, yaw] in metres and radians")
    if len(origin) == 3 and origin[2] != 0:
        raise MapError(f"{path}: origin: found yaw {origin[2]!r}; 0, turn the picture instead (Nav2 ignores this yaw)")
    return float(origin[0]), float(origin[1])


def _picture(path: Path, image: str) -> tuple[NDArray[np.float64], NDArray[np.bool_]]:
    """Grey value (H, W) in 0..255, row 0 at the top, and whether each pixel is opaque."""
    file = path.parent / image
    try:
        with Image.open(file) as picture:
            picture.load()
            if "A" in picture.getbands() or "transparency" in picture.info:
                channels = np.asarray(picture.convert("RGBA"), dtype=np.float64)
                return channels[..., :3].mean(axis=2), channels[..., 3] == 255
            bands = np.asarray(picture.convert("RGB") if picture.mode == "P" else picture, dtype=np.float64)
    except FileNotFoundError:
        raise MapError(f"{path}: image: no file {str(file)!r}; the picture lies relative to the YAML file") from None
    except (UnidentifiedImageError, OSError, ValueError) as error:
        raise MapError(f"{path}: image: {str(file)!r} is not a PGM, PNG or BMP picture: {error}") from None
    if picture.mode == "1":
        bands = bands * 255.0
    elif picture.mode.startswith("I"):  # 16 bits a pixel
        bands = bands / 257.0
    grey = bands.mean(axis=2) if bands.ndim == 3 else bands
    return grey, np.ones(grey.shape, dtype=np.bool_)


def _occupancy(
    grey: NDArray[np.float64],
    opaque: NDArray[np.bool_],
    mode: str,
    negate: bool,
    occupied_threshold: float,
    free_threshold: float,
) -> NDArray[np.int8]:
    if mode == "raw":
        return np.where(grey <= OCCUPIED, np.round(grey), UNKNOWN).astype(np.int8)
    probability = grey / 255.0 if negate else (255.0 - grey) / 255.0
    cells = np.full(grey.shape, UNKNOWN, dtype=np.int8)
    if mode == "scale":
        between = (probability - free_threshold) / (occupied_threshold - free_threshold)
        inside = (probability > free_threshold) & (probability < occupied_threshold) & opaque
        cells[inside] = np.round(100.0 * between[inside]).astype(np.int8)
    cells[probability <= free_threshold] = FREE
    cells[probability >= occupied_threshold] = OCCUPIED
    if not opaque.all():
        cells[~opaque] = UNKNOWN
    return cells
