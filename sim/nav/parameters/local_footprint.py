"""The room that a robot needs where it begins: the local costmap's footprint, which the controller keeps free, and its body."""

from collections.abc import Mapping
from typing import Final

import numpy as np
from numpy.typing import NDArray

from vastflow.sim.digest import Value
from vastflow.sim.nav.outline import outline_of, padded_outline
from vastflow.sim.nav.parameters.chosen import parameters_of
from vastflow.sim.nav.polygon import as_array, vertices_of

FOOTPRINT_NAMES: Final = frozenset({"footprint", "robot_radius", "footprint_padding", "radius", "polygon"})
"""Last names of the keys that it can follow from."""


def local_outline(system: Mapping[str, Value]) -> NDArray[np.float64]:
    """Vertices (V, 2) in the robot's frame of the area that must be free of obstacles where the robot begins: the padded
    footprint's, and those of a body that the section `robot` gives.

    Raises:
        DocumentError: as of `vastflow.sim.nav.parameters.chosen.parameters_of`.
    """
    parameters = parameters_of(system)
    outline, given = outline_of(parameters.local_costmap), parameters.robot
    if given.radius is not None:
        return np.vstack([outline, padded_outline(given.radius, 0.0)])
    return np.vstack([outline, as_array(vertices_of(given.polygon))]) if given.polygon else outline
