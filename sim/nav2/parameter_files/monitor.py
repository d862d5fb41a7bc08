"""Reading the node `collision_monitor`: the polygon round the footprint, and areas with their actions."""

from collections.abc import Mapping, Sequence
from typing import Any, Final

from vastflow.sim.model.parameter import ParameterLocation
from vastflow.sim.model.polygon import area_of
from vastflow.sim.nav2.parameter_files.document import PARAMETERS
from vastflow.sim.nav2.parameter_files.reader import Reader, Values, shown, written
from vastflow.sim.nav2.parameters.servers import MOST_ZONES, CollisionMonitor, MonitorZone

_OF_ACTION: Final[Mapping[str, tuple[str, ...]]] = {
    "stop": (),
    "slowdown": ("slowdown_ratio",),
    "limit": ("linear_limit", "angular_limit"),
    "approach": ("time_before_collision", "simulation_time_step"),
}
"""Parameters of a zone that count with its action."""


def read_monitor(reader: Reader, node: ParameterLocation) -> Mapping[str, CollisionMonitor]:
    """The polygon round the footprint, and the areas that the file draws."""
    values, scan = reader.document.values, _monitored_scan(reader, node)
    round_footprint: ParameterLocation | None = None
    zones = []
    for k, name in enumerate(reader.names((*node, "polygons"))):
        place = (*node, name)
        action, shape = (*place, "action_type"), (*place, "type")
        is_of_footprint = (values.get(action), values.get(shape)) == ("approach", "polygon")
        if action not in values or shape not in values:
            reader.fault((*node, "polygons", str(k)), f"no 'action_type' or 'type' below {name!r}", "both of them")
        elif round_footprint is None and is_of_footprint and not values.get((*place, "points")):
            round_footprint = place
            reader.asked |= {action: "approach", shape: "polygon"}
            reader.kinds[place] = "approach polygon"
        elif zone := _zone(reader, place):
            zones.append(zone)
    if len(zones) > MOST_ZONES:
        reader.fault((*node, "polygons"), f"got {len(zones)} areas beside the footprint's", f"{MOST_ZONES} at most")
    given: dict[str, Any] = {"zones": tuple(zones) if scan and not reader.faults else ()}
    if round_footprint is None or scan is None:
        return {"collision_monitor": CollisionMonitor(enabled=False, **given)}
    enabled = [reader.plain((*place, "enabled"), True) for place in (round_footprint, scan)]
    if not enabled[1]:
        given["zones"] = ()
    own, common = (*scan, "source_timeout"), (*node, "source_timeout")
    timeout = own if own in values else common
    if timeout == own:
        reader.unused[common] = f"{scan[-1]} has its own"
    given |= {"enabled": all(enabled), **_least_points(reader, round_footprint)}
    return {"collision_monitor": reader.group(CollisionMonitor, round_footprint, {"source_timeout": timeout}, given)}


def _monitored_scan(reader: Reader, node: ParameterLocation) -> ParameterLocation | None:
    """Return the place of the laser scan that the monitor watches."""
    scan = None
    for name in reader.names((*node, "observation_sources")):
        place = (*node, name)
        if scan is None and reader.document.values.get((*place, "type"), "scan") == "scan":
            scan = place
            reader.asked[(*place, "type")] = "scan"
            reader.kinds[place] = "monitored scan"
        else:
            reader.unmodeled[place] = "only one source, a scan, is modeled"
    return scan


def _zone(reader: Reader, place: ParameterLocation) -> MonitorZone | None:
    """An area that the file draws; None for one that is not modeled, does nothing or is not enabled."""
    action, shape = reader.plain((*place, "action_type"), ""), reader.plain((*place, "type"), "")
    reader.kinds[place] = "zone"
    drawn = (*place, "points" if shape == "polygon" else "radius")
    if action == "none":
        reader.unused[place] = "it does nothing"
        return None
    if action not in _OF_ACTION:
        reader.fault((*place, "action_type"), f"got {action!r}", f"one of {', '.join(_OF_ACTION)}, none")
        return None
    if shape not in ("polygon", "circle") or drawn not in reader.document.values:
        reader.unmodeled[place] = "only polygons with points and circles with a radius are modeled"
        return None
    own = ("min_points", *_OF_ACTION[action], *(("radius",) if shape == "circle" else ()))
    given: dict[str, Any] = {name: value for name, value in MonitorZone() if name not in own} | {"action": action}
    if shape == "polygon":
        points = reader.document.values[drawn]
        reader.asked[drawn] = points
        # Nav2's text of vertices, or the plain list of their numbers that older releases have.
        if isinstance(points, Sequence) and not isinstance(points, str) and len(points) % 2 == 0:
            points = str([list(pair) for pair in zip(points[::2], points[1::2], strict=True)])
        try:
            given["vertices"] = area_of(str(points))
        except ValueError as error:
            reader.fault(drawn, f"got {shown(reader.document.values[drawn])}", str(error))
    zone = reader.group(MonitorZone, place, given=given | _least_points(reader, place))
    return zone if reader.plain((*place, "enabled"), True) else None


def _least_points(reader: Reader, place: ParameterLocation) -> dict[str, Any]:
    """`min_points` after `max_points`, the most that are let be in older releases."""
    path = (*place, "max_points")
    most = reader.document.values.get(path)
    if most is None:
        return {}
    if not isinstance(most, int) or isinstance(most, bool) or most < 0:
        reader.fault(path, f"got {shown(most)}", "a whole number, 0 or more")
        return {}
    reader.asked[path] = most
    return {"min_points": most + 1}


def written_monitor(monitor: CollisionMonitor) -> Values:
    """Write the polygon round the footprint; areas exist in files only."""
    if not monitor.enabled:
        return {}
    node = ("collision_monitor", PARAMETERS)
    polygon, scan = (*node, "FootprintApproach"), (*node, "scan")
    return {
        (*node, "polygons"): [polygon[-1]],
        (*polygon, "type"): "polygon",
        (*polygon, "action_type"): "approach",
        (*node, "observation_sources"): [scan[-1]],
        (*scan, "type"): "scan",
        (*scan, "enabled"): True,
        **written(monitor, polygon, {"source_timeout": (*node, "source_timeout")}),
    }
