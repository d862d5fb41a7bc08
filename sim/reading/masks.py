"""The masks of costmap filters as a scenario has them."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Final

from vastflow.sim.digest import FileContent, Value
from vastflow.sim.nav.parameters.filters import KEEPOUT_KEY, SPEED_KEY, filtered_by, missing_mask
from vastflow.sim.nav.parameters.stack import NavParameters
from vastflow.sim.scenario_error import ScenarioError


@dataclass(frozen=True, slots=True)
class Masks:
    """The masks of the filters that are enabled; None without such a filter."""

    keepout: FileContent | None = None
    speed: FileContent | None = None


NO_MASKS: Final = Masks()


def masks_of(system: Mapping[str, Value], parameters: NavParameters) -> Masks:
    """The masks that a system names for the filters of its costmaps.

    Raises:
        ScenarioError: a filter without a mask, or a mask that is no map file.
    """
    keepout, speed = (_mask(system, key, parameters) for key in (KEEPOUT_KEY, SPEED_KEY))
    return Masks(keepout, speed)


def _mask(system: Mapping[str, Value], key: str, parameters: NavParameters) -> FileContent | None:
    costmaps = filtered_by(key, parameters)
    if not costmaps:
        return None
    found = system.get(key)
    if isinstance(found, FileContent):
        return found
    what, right = missing_mask(key, costmaps)
    raise ScenarioError(f"{key}: {what if found is None else f'found {found!r}'}; {right}")
