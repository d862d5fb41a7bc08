"""The footprint of the local costmap: what the controller of a system keeps free of obstacles."""

from collections.abc import Mapping, Sequence
from typing import Final

import numpy as np
from numpy.typing import NDArray

from vastflow.sim.digest import Value
from vastflow.sim.files import Unreadable, yaml_value
from vastflow.sim.nav.outline import padded, padded_outline
from vastflow.sim.nav.parameters.chosen import document_of_system, parameters_of

FOOTPRINT: Final = "footprint"
FOOTPRINT_NAMES: Final = frozenset({FOOTPRINT, "robot_radius", "footprint_padding"})
"""Last names of the keys that it can follow from."""


def local_outlines(system: Mapping[str, Value]) -> tuple[NDArray[np.float64], ...]:
    """The padded outlines (N, 2) in the robot's frame that must be free of obstacles where the robot begins.

    The disc of `robot_radius`, which is what drives in the simulator, and the polygon `footprint` where the system has one,
    which is what drives elsewhere.

    Raises:
        DocumentError: as of `vastflow.sim.nav.parameters.chosen.parameters_of`.
    """
    costmap = parameters_of(system).local_costmap
    disc = padded_outline(costmap.robot_radius, costmap.footprint_padding)
    document = document_of_system(system)
    node = document.node("local_costmap", "local_costmap")
    vertices = _vertices(None if node is None else document.values.get((*node, FOOTPRINT)))
    return (disc,) if vertices is None else (disc, padded(vertices, costmap.footprint_padding))


def _vertices(value: Value) -> NDArray[np.float64] | None:
    """A polygon as Nav2 has it, text such as `[[0.3, 0.2], ...]`; None for none and for what Nav2 would not take."""
    try:
        found = yaml_value(value) if isinstance(value, str) else value
        vertices = np.array(found, dtype=np.float64) if isinstance(found, Sequence) else np.empty(0)
    except (Unreadable, ValueError, TypeError):
        return None
    whole = vertices.ndim == 2 and vertices.shape[0] >= 3 and vertices.shape[1] == 2
    return vertices if whole and bool(np.isfinite(vertices).all()) else None
