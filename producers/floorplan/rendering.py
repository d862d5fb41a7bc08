"""Everything that can be made of one floor plan, as the files of a folder, with where they came from."""

import hashlib
import importlib.metadata
import json
from datetime import UTC, datetime
from typing import Any

from vastflow.producers.floorplan.building import Building
from vastflow.producers.floorplan.grid import grid_of
from vastflow.producers.floorplan.mesh import mesh_of, stl, volume_of
from vastflow.producers.floorplan.picture import picture_of


def render(building: Building, text: str, source: str, resolution_m: float, laser_height_m: float) -> dict[str, bytes]:
    """Place in the folder to content: map, mesh, picture, plan and provenance.

    Args:
        text: Of the plan.
        source: Where it was read from.

    Raises:
        FloorplanError: the map would have too many cells.
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
