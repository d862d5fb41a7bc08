"""Zones: where the masks of costmap filters keep robots out or slow them down, ready to be drawn."""

from collections.abc import Iterable
from dataclasses import dataclass, field
from typing import Final

from vastflow.sim.model.digest import FileContent
from vastflow.sim.model.scenario import Scenario
from vastflow.sim.nav2.parameter_files.chosen import parameters_of
from vastflow.sim.nav2.parameter_files.costmaps import MASK_KEYS, masks_of
from vastflow.sim.world.map_file import load_map
from vastflow.sim.world.occupancy import OccupancyMap


@dataclass(frozen=True, eq=False, slots=True)
class Zones:
    """The masks of some scenarios, each once; empty where no filter is on."""

    keepout: tuple[OccupancyMap, ...] = field(default=(), repr=False)
    speed: tuple[OccupancyMap, ...] = field(default=(), repr=False)


NO_ZONES: Final = Zones()


def zones_of(scenarios: Iterable[Scenario]) -> Zones:
    """The masks of the filters that are on.

    Raises:
        ValueError: a filter without a mask, or a mask that can't be read.
    """
    keepout: dict[str, FileContent] = {}
    speed: dict[str, FileContent] = {}
    for scenario in scenarios:
        if scenario.system.keys().isdisjoint(MASK_KEYS):
            continue
        masks = masks_of(scenario.system, parameters_of(scenario.system))
        for mask, found in ((masks.keepout, keepout), (masks.speed, speed)):
            if mask is not None:
                found[mask.digest] = mask
    return Zones(*(tuple(load_map(mask.path) for mask in found.values()) for found in (keepout, speed)))
