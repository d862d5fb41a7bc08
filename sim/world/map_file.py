"""Map files in the ROS map_server format: a YAML file and a picture."""

import contextlib
import io
import math
import re
import struct
import warnings
from collections.abc import Mapping
from pathlib import Path
from typing import Any, ClassVar, Final

import numpy as np
from numpy.typing import NDArray
from PIL import Image, UnidentifiedImageError
from yaml.nodes import MappingNode

from vastflow.sim.model.faults import Got
from vastflow.sim.model.files import Missing, Unreadable, read_bytes, read_text, yaml_node, yaml_value
from vastflow.sim.model.pose import DECIMALS, MOST_YAW_RAD, GridFrame
from vastflow.sim.world.occupancy import FREE, OCCUPIED, UNKNOWN, OccupancyMap
from vastflow.sim.world.readers.reader import MissingWorld, WorldError

MOST_HEADER_BYTES: Final = 1_000_000
LEAST_CELL_M: Final = 1e-4
LARGEST_CELL_M: Final = 100.0
FARTHEST_M: Final = 1e7
"""Greatest distance of the origin: beyond, rounding loses a millimeter."""

MOST_PIXELS: Final = 25_000_000
PICTURE_FORMATS: Final = ("PPM", "PNG", "BMP", "GIF", "JPEG", "TIFF")
"""Pillow's names; PGM and PBM are PPM to it."""
PICTURE: Final = "a picture in PGM, PNG, BMP, GIF, JPEG, or TIFF"

_PNM: Final = re.compile(rb"(P[2356])" + rb"(?:\s|#[^\n]*\n)+(\d+)" * 3)
"""Head of a PNM: kind, width, height, and the number for white."""

MODES: Final = ("trinary", "scale", "raw")
UNKNOWN_GRAY: Final = 205
"""Gray as which map_saver draws unknown cells."""

QUARTER_TURN_ROUNDING_RAD: Final = 1e-5
"""Tolerance of a quarter turn, such as 1.5708."""


class RosMap:
    """Reader of maps of ROS's map_server."""

    suffixes: ClassVar[tuple[str, ...]] = (".yaml", ".yml")

    @staticmethod
    def files(path: Path) -> list[Path]:
        return [path, path.parent / str(_header(path)["image"])]

    @staticmethod
    def read(path: Path) -> OccupancyMap:
        return load_map(path)


def load_map(path: str | Path) -> OccupancyMap:
    """Read a map as Nav2's map_server does: modes trinary, scale and raw, negate, thresholds, colors as gray.

    The origin's yaw turns the grid about it (Nav2's AMCL and static layer ignore it): its quarter turns rotate the cells, so that a
    map turned by 90° equals the map drawn turned.

    Raises:
        WorldError: a missing or unreadable file, or a missing or wrong key.
    """
    path = Path(path)
    header = _header(path)
    right = f"meters per cell, greater than 0: {LEAST_CELL_M:g} to {LARGEST_CELL_M:g}"
    resolution_m = _number(header, "resolution", path, (LEAST_CELL_M, LARGEST_CELL_M), right)
    x_m, y_m, yaw_rad = _origin(header, path)
    _, cells = _gray_and_cells(path, header)
    return _placed(cells[::-1], resolution_m, (x_m, y_m), yaw_rad)


def free_unknown_cells(path: Path) -> int:
    """Return how many cells have the gray as which map_saver draws unknown ones, where the map's thresholds make them free.

    Raises:
        WorldError: a map that `load_map` refuses as well.
    """
    gray, cells = _gray_and_cells(path, _header(path))
    return int(np.count_nonzero((gray == UNKNOWN_GRAY) & (cells == FREE)))


def _gray_and_cells(path: Path, header: Mapping[str, Any]) -> tuple[NDArray[np.uint8], NDArray[np.int8]]:
    """Return the picture (H, W) of a map and what its thresholds make of it, the uppermost row first."""
    # map_server accepts a threshold of 65 as well, above which nothing is a wall.
    occupied_threshold = _number(header, "occupied_thresh", path, (0.0, 1.0), "a share of black, 0 to 1", 0.65)
    free_threshold = _number(header, "free_thresh", path, (0.0, 1.0), "a share of black, 0 to 1", 0.25)
    mode = str(header.get("mode", "trinary"))
    if mode.lower() not in MODES:
        raise WorldError(f"{path}: mode: expected trinary, scale or raw, got {mode!r}")
    gray, opaque = _picture(path, str(header["image"]))
    if (negate := header.get("negate", 0)) not in (0, 1):
        raise WorldError(f"{path}: negate: expected 0 or 1, got {negate!r}")
    return gray, _occupancy(gray, opaque, mode.lower(), bool(negate), occupied_threshold, free_threshold)


def _header(path: Path) -> Mapping[str, Any]:
    try:
        text = read_text(path, "a map_server YAML file", MOST_HEADER_BYTES)
        header, node = yaml_value(text), yaml_node(text)
    except Missing:
        raise MissingWorld(f"{path}: No such file. Expected a map_server YAML file.") from None
    except Unreadable as error:
        line, column = error.place
        raise WorldError(f"{path}:{line}:{column}: {error}") from None
    if not isinstance(header, dict):
        raise WorldError(f"{path}: expected a mapping with image, resolution and origin, got {type(header).__name__}")
    written = [key.value for key, _ in node.value] if isinstance(node, MappingNode) else []
    if twice := [key for key in header if written.count(key) > 1]:
        raise WorldError(f"{path}: {twice[0]}: expected one value, got {written.count(twice[0])}")
    for key in ("image", "resolution", "origin"):
        if key not in header:
            raise WorldError(f"{path}: expected image, resolution and origin, got no {key!r}")
    return header


def _number(
    header: Mapping[str, Any], key: str, path: Path, limits: tuple[float, float], right: str, default: Any = None
) -> float:
    """Read a number within limits, described by `right`."""
    value = header.get(key, default)
    number = _finite(value)
    if number is None:
        raise WorldError(f"{path}: {key}: expected a number, got {value!r}")
    if not limits[0] <= number <= limits[1]:
        raise WorldError(f"{path}: {key}: expected {right}, got {number:g}")
    return number


def _finite(value: Any) -> float | None:
    if isinstance(value, str):  # YAML 1.1 reads 5e-2 as text
        with contextlib.suppress(ValueError):
            value = float(value)
    try:
        is_number = not isinstance(value, bool) and isinstance(value, int | float) and math.isfinite(value)
    except OverflowError:  # a whole number of hundreds of digits
        is_number = False
    return float(value) if is_number else None


def _origin(header: Mapping[str, Any], path: Path) -> tuple[float, float, float]:
    origin = header["origin"]
    numbers = [_finite(value) for value in origin] if isinstance(origin, list) else []
    match [number for number in numbers if number is not None]:
        case [x_m, y_m, *yaw] if len(numbers) == 2 + len(yaw) and len(yaw) < 2:
            yaw_rad = sum(yaw)
            if abs(yaw_rad) > MOST_YAW_RAD:
                raise WorldError(f"{path}: origin: expected radians, one turn (6.2832) at most, got yaw {yaw_rad:g}")
            if max(abs(x_m), abs(y_m)) > FARTHEST_M:
                raise WorldError(f"{path}: origin: expected at most {FARTHEST_M:,.0f} m from zero, got {origin!r}")
            return x_m, y_m, yaw_rad
    raise WorldError(f"{path}: origin: expected [x, y, yaw] in meters and radians, got {origin!r}")


def _placed(
    cells: NDArray[np.int8], resolution_m: float, origin_xy_m: tuple[float, float], yaw_rad: float
) -> OccupancyMap:
    quarters = round(yaw_rad / (math.pi / 2))
    rest_rad = yaw_rad - quarters * (math.pi / 2)
    if abs(rest_rad) < QUARTER_TURN_ROUNDING_RAD:
        rest_rad = 0.0
    rows, columns = cells.shape
    if quarters % 4:
        cells = np.rot90(cells, -quarters)  # rows go up here, so that numpy's clockwise is counter-clockwise
        # The lower left corner of the turned cells, in cells from the origin.
        left, bottom = ((0, 0), (-rows, 0), (-columns, -rows), (0, -columns))[quarters % 4]
        x_m, y_m = origin_xy_m
        corner_xy_m = GridFrame(origin_xy_m, rest_rad).to_map(x_m + left * resolution_m, y_m + bottom * resolution_m)
        origin_xy_m = round(corner_xy_m[0], DECIMALS), round(corner_xy_m[1], DECIMALS)
    return OccupancyMap(np.ascontiguousarray(cells), resolution_m, origin_xy_m, rest_rad)


def read_picture(path: str | Path) -> Image.Image:
    """Decode a picture that a map may have.

    Raises:
        Missing, Unreadable: see `read_bytes`; or another format, damaged, of several frames, or too many pixels.
    """
    content = read_bytes(path, PICTURE)
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", Image.DecompressionBombWarning)  # the limit here is lower
            picture = Image.open(io.BytesIO(content), formats=PICTURE_FORMATS)
            width, height = picture.size
            if width * height > MOST_PIXELS:
                raise Unreadable(Got(f"{width:,} × {height:,}"), f"at most {MOST_PIXELS:,} pixels")
            if getattr(picture, "n_frames", 1) > 1:
                raise Unreadable(Got("several frames"), "a single picture")
            if picture.mode in ("F", "CMYK"):
                raise Unreadable(Got(f"colors in {picture.mode}"), "gray, RGB, or a palette")
            picture.load()
    except Unreadable:
        raise
    except Image.DecompressionBombError:
        raise Unreadable(Got("more"), f"at most {MOST_PIXELS:,} pixels") from None
    except UnidentifiedImageError:
        raise Unreadable(Got("another format"), PICTURE) from None
    except Exception as error:  # noqa: BLE001 - what Pillow's decoders raise is documented nowhere
        raise Unreadable(f"the picture is damaged: {error}", "expected a whole one") from None
    return picture


def _picture(path: Path, image: str) -> tuple[NDArray[np.uint8], NDArray[np.bool_] | None]:
    """Read gray values (H, W), row 0 at the top, and opaque pixels; None where all are."""
    file = path.parent / image
    try:
        picture, content = read_picture(file), read_bytes(file)
    except Missing:
        raise MissingWorld(
            f"{path}: image: There is no file {str(file)!r}. Its path is relative to the YAML file."
        ) from None
    except Unreadable as error:
        raise WorldError(f"{path}: image: {str(file)!r}: {error}") from None
    shades = _sixteen_bits(picture, content)
    gray = shades if shades.ndim == 2 else (shades @ _LUMA + 500) // 1000
    return (gray // 257).astype(np.uint8), _opaque(picture, content)


_LUMA: Final = np.array([299, 587, 114])
"""Gray of red, green, and blue by Rec. 601, in thousandths."""


def _sixteen_bits(picture: Image.Image, content: bytes) -> NDArray[np.int64]:
    """Return gray values (H, W) or colors (H, W, 3) in 16 bits, as GraphicsMagick 1.3.40 has them.

    It scales a PNM by a whole factor, and a binary one by `top / white` once more; one of fewer pixels than shades it scales exactly.
    A binary PGM whose white is 1 it takes for packed bits, as in a PBM. The bits of a BMP of 16 it does not spread.
    """
    if picture.mode.startswith("I"):
        found, top = np.asarray(picture).astype(np.int64), 65535
    else:
        is_gray, top = picture.mode in ("1", "L"), 255
        found = np.asarray(picture.convert("L" if is_gray else "RGBA")).astype(np.int64)
        found = found if is_gray else found[..., :3]
    if content[:2] == b"BM" and content[28] == 16:
        bits = np.array([5, 6 if content[30] == 3 and content[58:60] == b"\xe0\x07" else 5, 5])
        return np.asarray(np.rint(found / 255 * (2**bits - 1)).astype(np.int64) << (16 - bits))
    if (head := _PNM.match(content)) is None:
        return found * (65535 // top)
    kind, white, end = head[1], int(head[4]), head.end()
    if (kind, white) == (b"P5", 1):
        rows = np.frombuffer(content, np.uint8, len(found) * -(-found.shape[1] // 8), end + 1).reshape(len(found), -1)
        return 65535 * (1 - np.unpackbits(rows, axis=1, count=found.shape[1]).astype(np.int64))
    levels = np.rint(found / top * white)
    if found.ndim == 3 and white > 255:  # Pillow has 8 bits of them
        if kind == b"P3":
            words = re.sub(rb"#[^\n]*", b"", content[end:]).split()
            levels = np.array(words[: found.size], dtype=np.float64).reshape(found.shape)
        else:
            levels = np.frombuffer(content, ">u2", found.size, end + 1).reshape(found.shape)
    factor: float = 65535 / white if found.shape[0] * found.shape[1] < white else 65535 // white
    shades = np.floor(levels * factor + 0.5)
    if factor == 65535 // white and kind in (b"P5", b"P6"):
        shades = np.minimum(np.floor(shades * ((255 if white < 256 else 65535) / white) + 0.5), 65535)
    return shades.astype(np.int64)


def _opaque(picture: Image.Image, content: bytes) -> NDArray[np.bool_] | None:
    """Return the opaque pixels (H, W) as GraphicsMagick 1.3.40 has them; None where all are."""
    key: Any = picture.info.get("transparency")
    if key is None and "A" not in picture.getbands():
        return _bmp_opaque(content, picture.size)
    depth = content[24]  # of a PNG
    if picture.mode == "L":
        return np.asarray(np.asarray(picture) != key * 255 // (2**depth - 1))
    if picture.mode.startswith("I"):
        return np.asarray(np.asarray(picture) != key)
    if picture.mode == "RGB" and depth == 8 and any(key):
        return None  # it compares the key with 16 bits of a pixel
    return np.asarray(np.asarray(picture.convert("RGBA"))[..., 3] == 255)


def _bmp_opaque(content: bytes, size: tuple[int, int]) -> NDArray[np.bool_] | None:
    """Return the opaque pixels (H, W) of a BMP of 32 bits without masks, whose fourth byte Pillow drops."""
    if content[:2] != b"BM" or content[14] < 40 or content[28:34] != struct.pack("<HI", 32, 0):
        return None
    start, height = struct.unpack_from("<I", content, 10)[0], struct.unpack_from("<i", content, 22)[0]
    width = size[0]
    alpha = np.frombuffer(content, np.uint8, 4 * width * abs(height), start).reshape(abs(height), width, 4)[..., 3]
    return np.asarray(alpha[:: -1 if height > 0 else 1] == 255)


def _occupancy(
    gray: NDArray[np.uint8],
    opaque: NDArray[np.bool_] | None,
    mode: str,
    negate: bool,
    occupied_threshold: float,
    free_threshold: float,
) -> NDArray[np.int8]:
    """Return cells (H, W) by map_server's arithmetic in single precision."""
    if mode == "raw":
        return np.where(gray <= OCCUPIED, gray.astype(np.int8), np.int8(UNKNOWN))
    shade = gray.astype(np.float32) / np.float32(255)
    probability = shade if negate else np.float32(1) - shade
    free, occupied = probability <= np.float32(free_threshold), probability >= np.float32(occupied_threshold)
    cells = np.full(gray.shape, UNKNOWN, dtype=np.int8)
    if mode == "scale":
        between = ~free & ~occupied
        span = np.float32(occupied_threshold - free_threshold)
        percent = (probability[between] - np.float32(free_threshold)) / span * np.float32(100)
        cells[between] = np.floor(percent.astype(np.float64) + 0.5)  # halves go up
    cells[occupied] = OCCUPIED
    cells[free] = FREE
    if opaque is not None:
        cells[~opaque] = UNKNOWN
    return cells
