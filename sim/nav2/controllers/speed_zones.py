"""Speed filters (nav2_costmap_2d): zones of a mask in which the controller is slower.

What the mask has where the robot is, as often as the costmap is updated, limits the controller's speed until it has another value.
"""

from collections.abc import Mapping
from typing import Any, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from vastflow.sim.kernels.numeric import inner
from vastflow.sim.kernels.plug_in import ContractError, line_of
from vastflow.sim.nav2.controllers.binding import RunningController
from vastflow.sim.nav2.controllers.controller import SpeedLimits
from vastflow.sim.nav2.costmaps.filters import Mask, cell_of, mask_place
from vastflow.sim.nav2.parameters.costmap import SpeedFilter
from vastflow.sim.world.occupancy import OCCUPIED, OccupancyMap

_UNCHANGED: Final = -1.0


class SpeedZones(NamedTuple):
    """A speed filter's mask and the parameters that it scales."""

    mask: Mask  # Of int8: 0 to 100, -1 where the limit stays what it is.
    shares: Any  # (101,) float64: what the parameters are scaled by at each value; below 0 where nothing changes.
    parameters: Any  # (N,) float64, the running controller's own.
    scaled: Any  # (F,) int64, which of them are scaled.
    full: Any  # (F,) float64, what these are without a limit.


def speed_zones(
    mask: OccupancyMap | None, occupancy: OccupancyMap, q: SpeedFilter, running: RunningController
) -> SpeedZones:
    """The zones of a speed filter with this mask for a controller; none without a mask."""
    limits = running.plug_in.speed_limits()
    if mask is None or limits is None:
        none = Mask(np.zeros((0, 0), dtype=np.int8), np.zeros((2, 3)))
        return SpeedZones(none, np.zeros(0), np.zeros(0), np.zeros(0, dtype=np.int64), np.zeros(0))
    parameters = running.parameters.view(np.float64)
    scaled = _places(running, limits)
    shares = np.full(OCCUPIED + 1, _UNCHANGED)
    for value in range(OCCUPIED + 1):
        limit, is_percentage = (q.base + value * q.multiplier if value > 0 else 0.0), q.type == 1
        if limit < 0.0 or (is_percentage and limit > 100.0):
            limit = 0.0  # out of its bounds Nav2 takes a limit for none
        if (share := limits.share(limit, is_percentage)) is not None:
            shares[value] = share
    zones = Mask(np.ascontiguousarray(mask.cells), mask_place(mask, occupancy))
    return SpeedZones(zones, shares, parameters, scaled, parameters[scaled])


def _places(running: RunningController, limits: SpeedLimits) -> NDArray[np.int64]:
    """Indices of the scaled parameters in the controller's record, in numbers of 8 bytes."""
    kind = type(running.plug_in)
    fields: Mapping[str, Any] = running.parameters.dtype.fields or {}
    for name in limits.scaled:
        if name not in fields or fields[name][0] != np.float64:
            right = "It must name its own parameters of type float."
            raise ContractError(f"{line_of(kind)}: speed_limits of {kind.__name__} scales {name!r}. {right}")
    return np.array([fields[name][1] // np.dtype(np.float64).itemsize for name in limits.scaled], dtype=np.int64)


@inner
def limit_speed(zones: SpeedZones, x_m: float, y_m: float) -> None:
    """Scale the controller's parameters by the mask's value at the robot; keep them off the mask."""
    found, row, column = cell_of(zones.mask, x_m, y_m)
    if not found or zones.mask.cells[row, column] < 0:
        return
    share = zones.shares[zones.mask.cells[row, column]]
    if share >= 0.0:
        for k in range(zones.scaled.shape[0]):
            zones.parameters[zones.scaled[k]] = zones.full[k] * share
