"""The node `collision_monitor` of a parameter file: its polygons and areas, and the reverse."""

from collections.abc import Mapping, Sequence
from typing import Any, Final, TypeVar

from vastflow.sim.model.faults import Got
from vastflow.sim.model.parameter import ParameterLocation
from vastflow.sim.model.polygon import area_of
from vastflow.sim.nav2.parameter_files.document import PARAMETERS
from vastflow.sim.nav2.parameter_files.reader import Reader, Values, shown, written
from vastflow.sim.nav2.parameter_files.releases import release_of
from vastflow.sim.nav2.parameters.servers import MOST_ZONES, CollisionMonitor, MonitorZone

_OF_ACTION: Final[Mapping[str, tuple[str, ...]]] = {
    "stop": (),
    "slowdown": ("slowdown_ratio",),
    "limit": ("linear_limit", "angular_limit"),
    "approach": ("time_before_collision", "simulation_time_step"),
}
"""Parameters of a zone that count with its action."""


def read_monitor(reader: Reader, node: ParameterLocation) -> Mapping[str, CollisionMonitor]:
    """Read the polygon round the footprint, and the areas that are modeled."""
    if release_of(reader.document) == "lyrical" and not reader.plain((*node, "enabled"), True):
        reader.unused[node] = "the collision monitor is off"
        return {"collision_monitor": CollisionMonitor(enabled=False)}
    values, scan = reader.document.values, _monitored_scan(reader, node)
    round_footprint: ParameterLocation | None = None
    zones = []
    for k, name in enumerate(dict.fromkeys(reader.names((*node, "polygons")))):
        place = (*node, name)
        action, shape = (*place, "action_type"), (*place, "type")
        is_of_footprint = (values.get(action), values.get(shape)) == ("approach", "polygon")
        if action not in values or shape not in values:
            what = f"'action_type' or 'type' is missing below {name!r}"
            reader.fault((*node, "polygons", str(k)), what, "a polygon needs both")
        elif round_footprint is None and is_of_footprint and not values.get((*place, "points")):
            round_footprint = place
            reader.asked |= {action: "approach", shape: "polygon"}
            reader.kinds[place] = "approach polygon"
        elif zone := _zone(reader, place, scan):
            zones.append(zone)
    if len(zones) > MOST_ZONES:
        reader.fault((*node, "polygons"), Got(f"{len(zones)} areas beside the footprint's"), f"{MOST_ZONES} at most")
    sees = scan is not None and reader.plain((*scan, "enabled"), True)
    given: dict[str, Any] = {"zones": tuple(zones) if sees and not reader.faults else ()}
    if round_footprint is None or scan is None:
        return {"collision_monitor": CollisionMonitor(enabled=False, **given)}
    given |= {"enabled": reader.plain((*round_footprint, "enabled"), True) and sees}
    given |= _least_points(reader, round_footprint)
    found = reader.group(CollisionMonitor, round_footprint, given=given, kinds=["polygon", "collision_monitor"])
    counted = found if reader.faults else _counted(reader, found, round_footprint, scan)
    return {"collision_monitor": counted or found.with_values(enabled=False)}


def _monitored_scan(reader: Reader, node: ParameterLocation) -> ParameterLocation | None:
    scan = None
    for place in dict.fromkeys((*node, name) for name in reader.names((*node, "observation_sources"))):
        if scan is None and reader.document.values.get((*place, "type"), "scan") == "scan":
            scan = place
            reader.asked[(*place, "type")] = "scan"
            reader.kinds[place] = "monitored scan"
        else:
            reader.unmodeled[place] = "only one source, a scan, is modeled"
    return scan


def _zone(reader: Reader, place: ParameterLocation, scan: ParameterLocation | None) -> MonitorZone | None:
    """An area of the file; None if it is not modeled, not enabled, or has no effect."""
    action, shape = reader.plain((*place, "action_type"), ""), reader.plain((*place, "type"), "")
    reader.kinds[place] = "zone"
    drawn = (*place, "points" if shape == "polygon" else "radius")
    if action == "none":
        reader.unused[place] = "it does nothing"
        return None
    if action not in _OF_ACTION:
        reader.fault((*place, "action_type"), Got(repr(action)), f"one of {', '.join(_OF_ACTION)}, none")
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
            reader.fault(drawn, Got(shown(reader.document.values[drawn])), str(error))
    zone = reader.group(MonitorZone, place, given=given | _least_points(reader, place), kinds=["polygon"])
    enabled = reader.plain((*place, "enabled"), True)
    counted = zone if reader.faults or scan is None else _counted(reader, zone, place, scan)
    return counted if enabled else None


Area = TypeVar("Area", MonitorZone, CollisionMonitor)


def _counted(reader: Reader, area: Area, place: ParameterLocation, scan: ParameterLocation) -> Area | None:
    """Return an area with its least number of beams; None if the scan is none of its sources.

    Nav2 counts a point as often as `sources_names` of the area and the node's `observation_sources` name its source.
    """
    own, sources = (*place, "sources_names"), reader.names((*place[:-1], "observation_sources"))
    names = reader.names(own, sources)
    if unknown := [name for name in names if name not in sources]:
        reader.fault(own, f"{unknown[0]!r} is not in observation_sources", "one of them, as the node ends otherwise")
    often = names.count(scan[-1]) * sources.count(scan[-1])
    if often == 0:
        reader.warnings[own] = f"{scan[-1]!r} is none of its sources", "the area sees nothing, and has no effect"
        return None
    return area.with_values(min_points=-(-area.min_points // often))


def _least_points(reader: Reader, place: ParameterLocation) -> dict[str, Any]:
    """`min_points` after `max_points`, the most that are let be in older releases."""
    path = (*place, "max_points")
    most = reader.document.values.get(path)
    if most is None:
        return {}
    if not isinstance(most, int) or isinstance(most, bool) or most < 0:
        reader.fault(path, Got(shown(most)), "a whole number, 0 or more")
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
        **written(monitor, polygon),
    }
