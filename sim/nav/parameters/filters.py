"""Costmap filters as a document has them: which there are, and what the filter info server says of each."""

from collections.abc import Sequence
from typing import Any, Final

from vastflow.sim.nav.controllers.controller import Controller
from vastflow.sim.nav.parameters.costmap import KeepoutFilter, SpeedFilter
from vastflow.sim.nav.parameters.document import ParameterDocument, ParameterLocation
from vastflow.sim.nav.parameters.plugins import FILTERS
from vastflow.sim.nav.parameters.reader import Parts, Reader
from vastflow.sim.nav.parameters.stack import NavParameters

KEEPOUT_KEY: Final = "keepout_mask"
SPEED_KEY: Final = "speed_mask"
MASK_KEYS: Final = (KEEPOUT_KEY, SPEED_KEY)
"""Keys of the system dimension that name masks, as Nav2's launch files do. A mask is told to the stack, and is nowhere in the world."""

TOPIC: Final = "filter_info_topic"
INFO_SERVER: Final = "costmap_filter_info_server"
_INFO: Final = ("type", "base", "multiplier")
_NOT_MODELED: Final = ("override_lethal_cost", "enable_path_lookahead")
"""Flags of the two filters in releases after Jazzy."""
_DEFAULT_TOPIC: Final = "costmap_filter_info"


def filtered_by(key: str, parameters: NavParameters) -> Sequence[str]:
    """The costmaps with a filter that needs the mask of a key."""
    costmaps = {"global_costmap": parameters.global_costmap, "local_costmap": parameters.local_costmap}
    field = "keepout_filter" if key == KEEPOUT_KEY else "speed_filter"
    return [name for name, costmap in costmaps.items() if getattr(costmap, field).enabled]


def missing_mask(key: str, costmaps: Sequence[str]) -> tuple[str, str]:
    """What is wrong where nothing gives a key that filters need, and what would be right."""
    kind = key.removesuffix("_mask")
    return f"the {kind} filter of the {costmaps[0]} has no mask", f"'{key}: {kind}.yaml', a map_server YAML file"


def is_info_server(document: ParameterDocument, node: ParameterLocation) -> bool:
    """Whether a node is one that says what filters do: several of them have any names."""
    return node[-2:-1] == (INFO_SERVER,) or (*node, TOPIC) in document.values


def filters_of(reader: Reader, node: ParameterLocation) -> dict[str, Any]:
    """The filters of a costmap, as fields of `Costmap`; those that its list `filters` lacks are not enabled."""
    found: dict[str, Any] = {
        "keepout_filter": KeepoutFilter(enabled=False),
        "speed_filter": SpeedFilter(enabled=False),
    }
    places: dict[str, ParameterLocation] = {}
    for each in reader.plugins(node, FILTERS):
        field = "keepout_filter" if each.kind == "KeepoutFilter" else "speed_filter"
        place = (*node, each.name)
        if field in places:
            reader.fault(place, f"a second {each.kind} beside {places[field][-1]}", "one in a costmap")
            continue
        places[field] = place
        if not reader.flag((*place, "enabled"), True):
            continue
        for flag in _NOT_MODELED:
            if (*place, flag) in reader.document.values:
                reader.only((*place, flag), False)
        info = _info(reader, place)
        if field == "keepout_filter":  # takes the mask's values as they are, whatever is said of them
            found[field] = KeepoutFilter()
        elif info is None:
            _lacks_info(reader, place)
        else:
            elsewhere = {name: (*info, name) for name in _INFO}
            found[field] = reader.group(SpeedFilter, place, elsewhere, {"enabled": True})
    return found


def check_speed_filter(reader: Reader, parts: Parts) -> None:
    """A speed limit needs a controller that can be limited, and one costmap to come from."""
    costmaps = ("global_costmap", "local_costmap")
    filtered = [name for name in costmaps if name in parts and parts[name].speed_filter.enabled]
    places = [(*(reader.document.node(name, name) or ()), FILTERS.lists[0]) for name in filtered]
    if len(places) > 1:
        what = "found a speed filter in both costmaps"
        reader.fault(places[1], what, "one of them, for each would undo the other's limit")
    controller = parts.get("controller")
    unlimited = isinstance(controller, Controller) and type(controller).speed_limits is Controller.speed_limits
    if places and unlimited:
        what = f"found a speed filter beside the controller {type(controller).__name__}, whose speed nothing limits"
        reader.fault(places[0], what, "a controller with speed_limits(), or no speed filter")


def _info(reader: Reader, place: ParameterLocation) -> ParameterLocation | None:
    """The node that says what the filter at `place` does."""
    topic, document = _topic(reader, place), reader.document
    for node in document.nodes:
        own = str(document.values.get((*node, TOPIC), _DEFAULT_TOPIC)).lstrip("/")
        if is_info_server(document, node) and own == topic:
            reader.kinds[node] = "filter info"
            return node
    return None


def _lacks_info(reader: Reader, place: ParameterLocation) -> None:
    topic = _topic(reader, place)
    if not topic:
        reader.fault(place, f"no {TOPIC!r}", f"{TOPIC}: {_DEFAULT_TOPIC}, and a node {INFO_SERVER} with the same")
        return
    right = f"{INFO_SERVER}: {{ros__parameters: {{{TOPIC}: {topic}, type: 1, base: 100.0, multiplier: -1.0}}}}"
    reader.fault((*place, TOPIC), f"no node publishes on {topic!r}", f"a node that does, {right}")


def _topic(reader: Reader, place: ParameterLocation) -> str:
    return reader.text((*place, TOPIC), "").lstrip("/")
