"""The building as plain values for JSON: world frame, meters."""

from typing import Any, Final

from vastflow.producers.floorplan.building import Building
from vastflow.producers.floorplan.plan import Outline

DECIMALS: Final = 9


def geometry_of(building: Building) -> dict[str, Any]:
    """Polygons of all there is, by name, corners as [x, y]; see `vastflow floorplan geometry`.

    A wall's polygon begins with its outer face, and ends with its inner one. An opening's `shape` is [x, z] in the
    frame of the first wall it cuts: x from the middle of that wall along its inner face, z from the floor up.
    """
    return {
        "name": building.name,
        "frame": "world",
        "unit": "m",
        "spaces": {room.name: _polygon(room.outline) for room in building.rooms},
        "walls": {
            wall.name: {"polygon": _polygon(wall.outline), "height": _number(wall.height_m)} for wall in building.walls
        },
        "obstacles": {
            obstacle.name: {
                "kind": obstacle.kind.lower(),
                "polygon": _polygon(obstacle.outline),
                "height": _number(obstacle.height_m),
            }
            for obstacle in building.obstacles
        },
        "openings": {
            hole.name: {
                "kind": hole.kind.lower(),
                "walls": list(hole.walls),
                "polygon": _polygon(hole.outline),
                "bottom": _number(hole.bottom_m),
                "top": _number(hole.top_m),
                "shape": _polygon(hole.shape),
            }
            for hole in building.holes
        },
    }


def _polygon(outline: Outline) -> list[list[float]]:
    return [[_number(x), _number(y)] for x, y in outline]


def _number(value: float) -> float:
    return round(value, DECIMALS) + 0.0  # + 0.0 turns -0.0 into 0.0
