"""Everything made of one floor plan: its picture, its geometry as JSON, and the files of a folder."""

import hashlib
import importlib.metadata
import io
import json
import math
from collections.abc import Mapping
from datetime import UTC, datetime
from typing import Any, Final

import numpy as np
import shapely
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.collections import PolyCollection
from matplotlib.figure import Figure
from matplotlib.patheffects import withStroke

from vastflow.producers.floorplan.building import Building, Hole, Room, SolidBlock, Wall
from vastflow.producers.floorplan.geometry import Outline, Point, edges
from vastflow.producers.floorplan.grid import grid_of
from vastflow.producers.floorplan.mesh import mesh_of, stl, volume_of
from vastflow.sim.model.elementary import atan2, dist, sin

LONG_SIDE_IN: Final = 13.0
MARGIN_IN: Final = 0.7
DPI: Final = 130
POINTS_AN_INCH: Final = 72.0

LARGEST_PT: Final = 10.0
SMALLEST_PT: Final = 2.6
"""Names smaller than that are left out."""

LETTER: Final = 0.62
"""Width of a letter as a part of its height."""

LINE: Final = 1.35
DOOR_PT: Final = 5.0
DOORS_FROM_PT_A_M: Final = 14.0
"""Scale of the picture from which on the widths of doors can be read beside them."""

FLOOR: Final = "#f4efe4"
LAYERS: Final[Mapping[str, tuple[str, int]]] = {
    "Room": (FLOOR, 1),
    "Wall": ("#3a3a3c", 2),
    "Column": ("#7a5c46", 3),
    "Divider": ("#b08d57", 3),
    "Entryway": ("#fdfdfb", 4),
    "Window": ("#7fb8d8", 4),
}
"""Class or kind of a part to its color and its place among the layers, lowest first."""
INK: Final = "#1d1d1f"
MEASURE: Final = "#77736a"


def picture_of(building: Building) -> bytes:
    """A PNG of the plan from above, in meters."""
    low_x, low_y, high_x, high_y = building.bounds
    width_m, height_m = high_x - low_x, high_y - low_y
    inches_a_m = (LONG_SIDE_IN - 2 * MARGIN_IN) / max(width_m, height_m)
    size_in = [max(side * inches_a_m, 2.0) + 2 * MARGIN_IN for side in (width_m, height_m)]
    figure = Figure(figsize=(size_in[0], size_in[1]), dpi=DPI, facecolor="white")
    FigureCanvasAgg(figure)
    left, bottom = MARGIN_IN / size_in[0], MARGIN_IN / size_in[1]
    axes = figure.add_axes((left, bottom, 1 - 2 * left, 1 - 2 * bottom))
    parts: list[Room | Wall | SolidBlock | Hole] = [
        *building.rooms,
        *building.walls,
        *building.obstacles,
        *building.holes,
    ]
    for kind, (color, order) in LAYERS.items():
        corners = [np.array(part.outline) for part in parts if getattr(part, "kind", type(part).__name__) == kind]
        axes.add_collection(PolyCollection(corners, facecolors=color, edgecolors=color, linewidths=0.2, zorder=order))
    scale_pt_a_m = inches_a_m * POINTS_AN_INCH
    halo = [withStroke(linewidth=2.0, foreground=FLOOR)]
    for room, floor in zip(building.rooms, _own_floors(building), strict=True):
        if (label := _label(room, floor, scale_pt_a_m)) is not None:
            (x, y), text, size_pt, turn_deg = label
            axes.text(
                x, y, text, fontsize=size_pt, rotation=turn_deg, ha="center", va="center", color=INK, zorder=6,
                linespacing=1.25, path_effects=halo,
            )  # fmt: skip
    if scale_pt_a_m >= DOORS_FROM_PT_A_M:
        for hole in building.holes:
            low, high = hole.reach
            x, y = hole.frame.apply(((low + high) / 2, -0.22))  # beside the opening, inside of the room
            axes.text(
                x, y, f"{_meters(high - low)} m", fontsize=DOOR_PT, ha="center", va="center", color=MEASURE, zorder=7
            )
    axes.set(xlim=(low_x, high_x), ylim=(low_y, high_y), aspect="equal")
    axes.tick_params(labelsize=7, colors=MEASURE, length=2)
    for spine in axes.spines.values():
        spine.set_visible(False)
    area_m2 = shapely.union_all([shapely.Polygon(room.outline) for room in building.rooms]).area
    title = f"{building.name}   {_meters(width_m)} × {_meters(height_m)} m, {area_m2:,.0f} m² of floor"
    axes.set_title(title, fontsize=10, color=INK, loc="left")
    content = io.BytesIO()
    figure.savefig(content, format="png", metadata={"Software": None})
    return content.getvalue()


def _own_floors(building: Building) -> list[shapely.Geometry]:
    floors = np.array([shapely.Polygon(room.outline) for room in building.rooms])
    tree = shapely.STRtree(floors)
    for outer, inner in tree.query(floors, predicate="contains").T:
        if outer != inner:
            floors[outer] = shapely.difference(floors[outer], shapely.convex_hull(floors[inner]))
    return list(floors)


def _label(
    room: Room, floor: shapely.Geometry, scale_pt_a_m: float
) -> tuple[tuple[float, float], str, float, float] | None:
    """Place, text, size and turn of a room's name and measures, as large as fits; None where nothing does."""
    if floor.is_empty:  # another room covers it
        return None
    sides = [dist(*edge) for edge in edges(room.outline)]
    area_m2 = shapely.Polygon(room.outline).area
    rectangular = len(sides) == 4 and math.isclose(area_m2, sides[0] * sides[1], rel_tol=1e-6)
    measure = f"{_meters(sides[0])} × {_meters(sides[1])} m" if rectangular else f"{area_m2:.1f} m²"
    if rectangular and math.isclose(floor.area, area_m2, rel_tol=1e-6):
        place, across_m, high_m, turn_deg = (floor.centroid.x, floor.centroid.y), *_text_extent(room)
    else:
        radius = shapely.maximum_inscribed_circle(floor, tolerance=0.1)
        place, across_m, high_m, turn_deg = radius.coords[0], 2 * radius.length, 2 * radius.length, 0.0
    for text in (f"{room.name}\n{measure}", room.name):
        lines = text.split("\n")
        across_pt = 0.92 * across_m * scale_pt_a_m / (LETTER * max(map(len, lines)))
        size_pt = min(LARGEST_PT, across_pt, 0.85 * high_m * scale_pt_a_m / (LINE * len(lines)))
        if size_pt >= SMALLEST_PT:
            return (place[0], place[1]), text, size_pt, turn_deg
    return None


def _text_extent(room: Room) -> tuple[float, float, float]:
    """Return the room for text along and across its direction in a rectangle (m), and that direction (degrees).

    Texts run along the longer side, but level where a room is nearly square.
    """
    along, across = sorted(edges(room.outline)[:2], key=lambda edge: -dist(*edge))
    if dist(*along) < 1.6 * dist(*across) and abs(sin(_direction(along))) > sin(math.pi / 4):
        along, across = across, along
    turn_deg = math.degrees(_direction(along))
    return dist(*along), dist(*across), 90.0 - (90.001 - turn_deg) % 180.0 + 0.001


def _direction(edge: tuple[Point, Point]) -> float:
    (x0, y0), (x1, y1) = edge
    return atan2(y1 - y0, x1 - x0)


def _meters(length_m: float) -> str:
    return f"{length_m:.2f}".rstrip("0").rstrip(".")


DECIMALS: Final = 9


def geometry_of(building: Building) -> dict[str, Any]:
    """Polygons of all parts by name, with corners as [x, y]; see `vastflow floorplan geometry`.

    A wall's polygon begins with its outer face, and ends with its inner one. An opening's `shape` is [x, z] in the
    frame of the first wall it cuts: x from the middle of that wall along its inner face, z from the floor up.
    """
    return {
        "name": building.name,
        "frame": "world",
        "unit": "m",
        "spaces": {each.name: _polygon(each.outline) for each in building.rooms},
        "walls": {
            each.name: {"polygon": _polygon(each.outline), "height": _number(each.height_m)} for each in building.walls
        },
        "obstacles": {
            each.name: {
                "kind": each.kind.lower(),
                "polygon": _polygon(each.outline),
                "height": _number(each.height_m),
            }
            for each in building.obstacles
        },
        "openings": {
            each.name: {
                "kind": each.kind.lower(),
                "walls": list(each.walls),
                "polygon": _polygon(each.outline),
                "bottom": _number(each.bottom_m),
                "top": _number(each.top_m),
                "shape": _polygon(each.shape),
            }
            for each in building.holes
        },
    }


def _polygon(outline: Outline) -> list[list[float]]:
    return [[_number(x), _number(y)] for x, y in outline]


def _number(value: float) -> float:
    return round(value, DECIMALS) + 0.0  # + 0.0 turns -0.0 into 0.0


def render(building: Building, text: str, source: str, resolution_m: float, laser_height_m: float) -> dict[str, bytes]:
    """Place in the folder to content: map, mesh, picture, plan and provenance; raises as `grid_of` does.

    Args:
        text: Text of the plan.
        source: File that the plan was read from.
    """
    name = building.name
    grid = grid_of(building, resolution_m, laser_height_m)
    triangles = mesh_of(building)
    files = {
        f"maps/{name}.yaml": grid.header(f"{name}.pgm"),
        f"maps/{name}.pgm": grid.picture(),
        f"3d-mesh/{name}.stl": stl(triangles),
        f"{name}.png": picture_of(building),
        f"fpm/{name}.fpm": text.encode(),
    }
    provenance: dict[str, Any] = {
        "plan": name,
        "created_at": datetime.now(UTC).isoformat(timespec="seconds"),
        "attributed_to": f"vastflow {importlib.metadata.version('vastflow')}",
        "derived_from": {"file": source, "sha256": hashlib.sha256(text.encode()).hexdigest()},
        "resolution_m": resolution_m,
        "laser_height_m": laser_height_m,
        "solid_volume_m3": round(volume_of(triangles), 6),
        "files": {place: hashlib.sha256(content).hexdigest() for place, content in files.items()},
    }
    return {**files, f"{name}.provenance.json": (json.dumps(provenance, indent=1) + "\n").encode()}
