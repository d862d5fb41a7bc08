"""The footprint of the local costmap: what the controller of a system keeps free of obstacles."""

from collections.abc import Mapping
from typing import Final

import numpy as np
from numpy.typing import NDArray

from vastflow.sim.digest import Value
from vastflow.sim.nav.outline import outline_of
from vastflow.sim.nav.parameters.chosen import parameters_of

FOOTPRINT_NAMES: Final = frozenset({"footprint", "robot_radius", "footprint_padding"})
"""Last names of the keys that it can follow from."""


def local_outline(system: Mapping[str, Value]) -> NDArray[np.float64]:
    """The padded outline (V, 2) in the robot's frame that must be free of obstacles where the robot begins.

    Raises:
        DocumentError: as of `vastflow.sim.nav.parameters.chosen.parameters_of`.
    """
    return outline_of(parameters_of(system).local_costmap)
