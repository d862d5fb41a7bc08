"""Reading costmap nodes: layers in the order of the file, filters with their masks, and the laser scan."""

from collections.abc import Mapping, Sequence
from typing import Any, Final

from vastflow.sim.model.digest import FileContent, Value
from vastflow.sim.model.faults import Complaint, Got, ScenarioError, message_of
from vastflow.sim.model.parameter import ParameterLocation
from vastflow.sim.model.polygon import points_of, vertices_of
from vastflow.sim.nav2.controllers.controller import Controller
from vastflow.sim.nav2.parameter_files.declared import declared_defaults
from vastflow.sim.nav2.parameter_files.document import PARAMETERS, ParameterDocument
from vastflow.sim.nav2.parameter_files.frames import frame_of
from vastflow.sim.nav2.parameter_files.nodes import FILTERS, LAYERS, LAYERS_AND_FILTERS
from vastflow.sim.nav2.parameter_files.reader import Instance, Parts, Reader, Values, is_group, written, written_plugins
from vastflow.sim.nav2.parameters.costmap import (
    Costmap,
    ObstacleLayer,
    SpeedFilter,
    StaticLayer,
    global_costmap,
    local_costmap,
)
from vastflow.sim.nav2.parameters.stack import NavParameters
from vastflow.sim.system.keys import KEEPOUT_KEY, MASK_KEYS, SPEED_KEY
from vastflow.sim.system.system import Masks

LAUNCH_WORDS: Final[Mapping[Value, str]] = {"KEEPOUT_ZONE_ENABLED": KEEPOUT_KEY, "SPEED_ZONE_ENABLED": SPEED_KEY}
"""Words that Nav2's launch files since Kilted replace in parameter files, to the mask without which a filter is off."""

TOPIC: Final = "filter_info_topic"
INFO_SERVER: Final = "costmap_filter_info_server"
_INFO: Final = ("type", "base", "multiplier")
_DEFAULT_TOPIC: Final = "costmap_filter_info"


def filtered_by(key: str, parameters: NavParameters) -> Sequence[str]:
    """The costmaps with a filter that needs the mask of a key."""
    field = key.replace("_mask", "_filter")
    return [name for name in ("global_costmap", "local_costmap") if getattr(getattr(parameters, name), field).enabled]


def missing_mask(key: str, costmaps: Sequence[str]) -> Complaint:
    """Return the problem and the expected line where filters lack the mask of a key."""
    kind = key.removesuffix("_mask")
    return f"the {kind} filter of the {costmaps[0]} has no mask", f"add '{key}: {kind}.yaml', a map_server YAML file"


def is_info_server(document: ParameterDocument, node: ParameterLocation) -> bool:
    """Whether a node is a costmap filter's info server, whose name is free."""
    return node[-2:-1] == (INFO_SERVER,) or (*node, TOPIC) in document.values


def _filters(reader: Reader, filters: Sequence[Instance]) -> dict[str, Any]:
    """The filters of a costmap that are enabled, as fields of `Costmap`."""
    found: dict[str, Any] = {}
    places: dict[str, ParameterLocation] = {}
    for each in filters:
        field = _FIELDS[each.modeled.model]
        if each.place in places.values():
            continue  # the same once more
        if field in places:
            reader.fault(each.place, f"duplicate {each.kind} beside {places[field][-1]}", "keep one in a costmap")
            continue
        places[field] = each.place
        enabled = (*each.place, "enabled")
        is_word = reader.document.values.get(enabled) in LAUNCH_WORDS
        if is_word or not reader.plain(enabled, True):
            reader.asked[enabled] = False
            reader.unused[each.place] = "the filter is off"
            _info(reader, each.place, is_needed=False)
            continue
        info = _info(reader, each.place, is_needed=field == "speed_filter")
        if gap := "" if info is None else filter_gap(reader.document, each.place, each.kind):
            reader.asked[(*each.place, TOPIC)] = reader.document.values.get((*each.place, TOPIC), "")
            reader.warnings[(*each.place, TOPIC)] = gap, "the filter gets no mask, and has no effect"
            reader.unused[each.place] = gap
        elif info is not None:
            found[field] = reader.instance_group(each, {name: (*info, name) for name in _INFO}, ["filter info"])
    return found


def _topic_at(document: ParameterDocument, node: ParameterLocation, name: str, default: str) -> str:
    return shown_topic(document.values.get((*node, name), default))


def _info_servers(document: ParameterDocument) -> Mapping[ParameterLocation, str]:
    """Return the info servers of a document with the topics that they publish on."""
    servers = sorted(node for node in document.nodes if is_info_server(document, node))
    return {node: _topic_at(document, node, TOPIC, _DEFAULT_TOPIC) for node in servers}


def _info(reader: Reader, place: ParameterLocation, is_needed: bool) -> ParameterLocation | None:
    """Return the info server of a filter.

    It is an empty path if the filter needs none, and None, with a fault, if it is missing. A keepout filter takes the mask's values as
    they are, whatever is said of them.
    """
    document = reader.document
    topic = shown_topic(reader.plain((*place, TOPIC), ""))
    found = [node for node, said in _info_servers(document).items() if said == topic]
    reader.kinds |= dict.fromkeys(found, "filter info")
    if len(found) > 1 and is_needed:
        names = " and ".join(node[-2] for node in found)
        reader.fault((*place, TOPIC), f"{names} publish on {topic!r}", "keep one, as in Nav2 the later message counts")
    if found:
        return found[0]
    if not is_needed or filter_gap(document, place, ""):
        return ()
    if topic:
        right = f"{INFO_SERVER}: {{ros__parameters: {{{TOPIC}: {topic}, type: 1, base: 100.0, multiplier: -1.0}}}}"
        reader.fault((*place, TOPIC), f"no node publishes on {topic!r}", f"add a node that does, {right}")
    else:
        right = f"add {TOPIC}: {_DEFAULT_TOPIC}, and a node {INFO_SERVER} with the same"
        reader.fault(place, f"{TOPIC!r} is missing", right)
    return None


def filter_gap(document: ParameterDocument, place: ParameterLocation, kind: str) -> str:
    """Say why a filter of a class gets no mask; empty if it gets one.

    An info server that no filter listens to is the one that was meant. Other nodes are started by other files.
    """
    topic, servers = _topic_at(document, place, TOPIC, ""), _info_servers(document)
    listening = {
        shown_topic(value) for path, value in document.values.items() if path[-1] == TOPIC and path[-2] != PARAMETERS
    }
    node = next((node for node, said in servers.items() if said == topic), None)
    if node is None:
        unheard = [f"{node[-2]} publishes on {said}" for node, said in servers.items() if said not in listening]
        return f"listens on {topic}, and {' and '.join(unheard)}" if topic and unheard else ""
    told = document.values.get((*node, "type"), 0)
    if kind == "SpeedFilter" and isinstance(told, int) and told not in (1, 2):
        return f"{node[-2]} has type {told}, and a speed filter takes 1 or 2"
    mask = _topic_at(document, node, "mask_topic", str(declared_defaults()["filter info"]["mask_topic"].default))
    masks = {shown_topic(value): path[-3] for path, value in document.values.items() if is_mask_topic(path)}
    published = [f"{name} publishes on {said}" for said, name in masks.items()]
    return f"{node[-2]} names the mask {mask}, and {' and '.join(published)}" if masks and mask not in masks else ""


def is_mask_topic(path: ParameterLocation) -> bool:
    """Whether this is the topic of a map server's that is not the map's own."""
    return path[-1] == "topic_name" and path[-2] == PARAMETERS and path[-3] != "map_server"


def unheard_speed_filters(reader: Reader, parts: Parts) -> Parts:
    """Return costmaps without the speed filters that publish on another topic than the controller server listens on."""
    declared, values, name = declared_defaults(), reader.document.values, "speed_limit_topic"
    server = (*(reader.document.node("controller_server") or ()), name)
    heard = values.get(server, declared["controller_server"][name].default)
    unheard: dict[str, Any] = {}
    for place, costmap in [(place, place[-3]) for place, kind in reader.kinds.items() if kind == "SpeedFilter"]:
        said = values.get((*place, name), declared["SpeedFilter"][name].default)
        if meets(said, heard) or costmap not in parts or place in reader.unused:
            continue
        topic, other = shown_topic(said), shown_topic(heard)
        for path in [path for path in reader.asked if path[: len(place)] == place]:
            reader.leave(path, f"it publishes on {topic}, and the controller server listens on {other}")
        reader.unused[place] = f"the speed filter publishes on {topic}, and the controller server listens on {other}"
        reader.warnings[(*place, name)] = (
            f"publishes on {topic}",
            f"no limit arrives, as the controller listens on {other}",
        )
        unheard[costmap] = parts[costmap].with_values(speed_filter=SpeedFilter(enabled=False))
    return unheard


def shown_topic(value: Value) -> str:
    """A topic without the slash in front, which files have or have not."""
    return str(value).lstrip("/")


def topic_of(value: Value) -> str:
    """The name of a topic without its namespace."""
    return str(value).rpartition("/")[2]


def meets(said: Value, heard: Value) -> bool:
    """Whether two names are of one topic; a relative one is in the robot's namespace, which launch files push."""
    longer, shorter = sorted(map(str, (said, heard)), key=len, reverse=True)
    return longer == shorter or (longer[:1] == "/" != shorter[:1] and longer.endswith(f"/{shorter}"))


def check_speed_filter(reader: Reader, parts: Parts) -> None:
    """A speed limit needs a controller that can be limited, and one costmap to come from."""
    costmaps = ("global_costmap", "local_costmap")
    filtered = [name for name in costmaps if name in parts and parts[name].speed_filter.enabled]
    places = [(*(reader.document.node(name, name) or ()), FILTERS.lists[0]) for name in filtered]
    if len(places) > 1:
        reader.fault(places[1], "both costmaps have a speed filter", "keep one, as each undoes the other's limit")
    controller = parts.get("controller")
    unlimited = isinstance(controller, Controller) and type(controller).speed_limits is Controller.speed_limits
    if places and unlimited:
        what = f"the speed filter can't limit the controller {type(controller).__name__}"
        reader.fault(places[0], what, "choose a controller with speed_limits(), or no speed filter")


OF_THE_MAP: Final = ("width", "height", "resolution", "rolling_window", "origin_x", "origin_y")
"""Parameters of a global costmap with a static layer that have no effect: it is as large and as fine as the map."""

MOST_CELLS: Final = 25_000_000
"""Of a global costmap without a map: 250 m × 250 m in cells of 5 cm."""

OF_THE_WINDOW: Final = {"track_unknown_space": False}
"""Parameters of the local costmap that are built in."""

OF_THE_SCAN: Final = ("marking", "clearing", "obstacle_max_range", "obstacle_min_range", "raytrace_max_range")
"""Parameters of an obstacle layer that its source has."""

_FIELDS: Final[Mapping[Any, str]] = {
    field.annotation: name for name, field in Costmap.model_fields.items() if is_group(field.annotation)
}
"""Parameters of layers and filters to the fields of `Costmap` that have them."""


_PASSING_M: Final = 2.0
"""The `max_obstacle_height` of Nav2 Jazzy's file."""


def read_costmap(reader: Reader, node: ParameterLocation) -> Mapping[str, Costmap]:
    listed, filters = reader.plugins(node, LAYERS_AND_FILTERS), reader.plugins(node, FILTERS)
    filters = [*(each for each in listed if _is_filter(each)), *filters]
    given = {field: model(enabled=False) for model, field in _FIELDS.items()} | _filters(reader, filters)
    rolling = (*node, "rolling_window")
    if node[-2] == "global_costmap":
        given["publish_frequency"] = global_costmap().publish_frequency
        given["sized_by_map"] = sized_by_map = any(each.modeled.model is StaticLayer for each in listed)
        given |= {name: getattr(global_costmap(), name) for name in OF_THE_MAP if sized_by_map}
        given["in_odom"] = not sized_by_map and frame_of(reader, node).endswith("odom")
    if node[-2] == "local_costmap":
        given |= OF_THE_WINDOW
        reader.default_of(
            (*node, "plugins"), declared_defaults()[node[-2]]["plugins"], ["voxel_layer", "inflation_layer"]
        )
        if rolling not in reader.document.values:
            given["rolling_window"] = True
        if reader.document.values.get(rolling) in (False, None):
            reader.warnings[rolling] = _window_stays(rolling in reader.document.values)
    layers = _layers(reader, [each for each in listed if not _is_filter(each)])
    used = [*layers.values(), *(each for each in filters if each.place not in reader.unused)]
    _check_order(reader, sorted(used, key=[*listed, *filters].index))
    for field, layer in layers.items():
        is_marking = field == "obstacle_layer"
        given[field] = _obstacle_layer(reader, layer) if is_marking else reader.instance_group(layer)
    shipped = global_costmap() if node[-2] == "global_costmap" else local_costmap()
    values = reader.document.values
    if isinstance(text := values.get((*node, "footprint")), str) and text not in ("", "[]"):
        try:
            points_of(text)
        except ValueError as error:
            given["footprint"] = reader.asked[(*node, "footprint")] = "[]"
            reader.warnings[(*node, "footprint")] = f"expected {error}", "Nav2 takes robot_radius"
    if values.get((*node, "footprint"), "[]") not in ("", "[]") and values.get((*node, "robot_radius")) == 0.0:
        given["robot_radius"] = shipped.robot_radius  # Nav2 does not look at it beside a polygon
    found = reader.group(Costmap, node, given=given, left_out=shipped, kinds=[node[-2]])
    if node[-2] == "local_costmap" and found.rolling_window is True:
        for name in ("origin_x", "origin_y"):
            reader.leave((*node, name), "the window moves with the robot")
    if node[-2] == "global_costmap" and not reader.faults and not found.sized_by_map:
        count = found.width * found.height / (found.resolution * found.resolution)
        if count > MOST_CELLS:
            right = f"a costmap of at most {MOST_CELLS:,} cells"
            reader.fault((*node, "resolution"), Got(f"{count:,.0f} cells"), right)
    if not reader.faults and vertices_of(found.footprint):
        reader.leave((*node, "robot_radius"), "the polygon footprint replaces it")
    return {node[-2]: found}


def _window_stays(is_given: bool) -> Complaint:
    """Return the warning of a local costmap that Nav2 does not move with the robot."""
    stays = (
        "Nav2's window stays where odometry began, with its corner at origin_x, origin_y (0 where left out), and no mission"
        " leads out of it"
    )
    if is_given:
        return f"rolling_window is false: {stays}", "so it does here"
    what = f"rolling_window is false where the file leaves it out: {stays}"
    return what, "here the window moves with the robot, and such missions go on"


def _is_filter(instance: Instance) -> bool:
    return instance.modeled in FILTERS.modeled.values()


def _layers(reader: Reader, listed: Sequence[Instance]) -> Mapping[str, Instance]:
    """Return the fields of `Costmap` with the layers read for them, in the order of the file.

    Of several layers for one field the best counts, then the first.
    """
    layers: dict[str, list[Instance]] = {}
    for layer in listed:
        layers.setdefault(_FIELDS[layer.modeled.model], []).append(layer)

    def worth(layer: Instance) -> tuple[bool, bool]:
        """Rank of a layer: enabled ones first, then those with a laser scan."""
        sees = any(_data_type(reader, source) == "LaserScan" for source in _sources(reader, layer.place))
        return reader.document.values.get((*layer.place, "enabled"), True) is not False, sees

    used = {field: max(several, key=worth) for field, several in layers.items()}
    for field, several in layers.items():
        for layer in several:
            if layer != used[field]:
                reader.unmodeled[layer.place] = f"a second layer beside {used[field].place[-1]} is not modeled"
    return dict(sorted(used.items(), key=lambda item: listed.index(item[1])))


def _check_order(reader: Reader, layers: Sequence[Instance]) -> None:
    """Report layers after the inflation layer, which inflates earlier layers only, and keepout filters before it."""
    inflation = next((layer for layer in layers if layer.kind == "InflationLayer"), None)
    if inflation is None:
        return
    for layer in layers[: layers.index(inflation)]:
        if layer.kind == "KeepoutFilter":
            what = f"{layer.place[-1]!r} comes before the inflation, and Nav2 inflates its mask, which is not modeled"
            reader.fault((*layer.place, "plugin"), what, f"put {layer.place[-1]!r} after {inflation.place[-1]!r}")
    for layer in layers[layers.index(inflation) + 1 :]:
        if _is_filter(layer):
            continue
        what = f"{layer.place[-1]!r} comes after the inflation"
        right = "put the Denoise layer before it in the list 'plugins'"
        if layer.kind != "DenoiseLayer":
            what += ", and Nav2 does not inflate what it marks, which is not modeled"
            right = f"put {layer.place[-1]!r} before {inflation.place[-1]!r} in the list 'plugins'"
        reader.fault((*layer.place, "plugin"), what, right)


def _sources(reader: Reader, place: ParameterLocation) -> list[ParameterLocation]:
    return [(*place, name) for name in reader.names((*place, "observation_sources"))]


def _data_type(reader: Reader, source: ParameterLocation) -> object:
    path = (*source, "data_type")
    return reader.document.values.get(path, declared_defaults()["scan"][path[-1]].default)


def _obstacle_layer(reader: Reader, layer: Instance) -> ObstacleLayer:
    """The layer with its laser scan; without any source it neither marks nor clears."""
    place, given, declared = layer.place, dict(layer.modeled.fixed), declared_defaults()
    reader.default_of((*place, "observation_sources"), declared["ObstacleLayer"]["observation_sources"], "scan")
    values, sources = reader.document.values, _sources(reader, place)
    cloud = next((source for source in sources if values.get((*source, "marking"), True) is True), None)
    if layer.kind == "SpatioTemporalVoxelLayer":
        reader.unmodeled[place] = (
            "it is read as a VoxelLayer of the laser scan: no voxel decays, and there is no camera"
        )
        seen_m = (*(cloud or (*place, "scan")), "obstacle_range")
        elsewhere = dict.fromkeys(("obstacle_max_range", "raytrace_max_range"), seen_m)
        elsewhere["footprint_clearing_enabled"] = (*place, "update_footprint_enabled")
        given |= {"marking": True, "clearing": True, "obstacle_min_range": 0.0}
        return reader.group(ObstacleLayer, place, elsewhere, given)
    kinds = [layer.kind, "scan"]
    scan = next((source for source in sources if _data_type(reader, source) == "LaserScan"), None)
    for source in sources:
        if source != scan:
            reader.unmodeled[source] = "only one source, a LaserScan, is modeled"
    if scan is not None:
        reader.plain((*scan, "data_type"), "LaserScan")
        reader.kinds[scan] = "scan"
        for limited, kind, lost in ((scan, "scan", ("marking", "clearing")), (place, layer.kind, ("marking",))):
            path = (*limited, "max_obstacle_height")
            highest_m = values.get(path, reader.default_of(path, declared[kind][path[-1]], _PASSING_M))
            if isinstance(highest_m, int | float) and highest_m <= 0.0:
                reader.asked[path] = highest_m
                given |= dict.fromkeys(lost, False)
                what = f"max_obstacle_height is {highest_m:g}{'' if path in values else ' where it is left out'}"
                reader.warnings[limited] = what, "nothing of the scan is marked, as no laser is that low"
                reader.unused |= {(*scan, name): "max_obstacle_height lets nothing of the scan pass" for name in lost}
    elif cloud is not None:
        reader.unmodeled[cloud] = "a point cloud is read as the laser scan"
        given["clearing"] = any(values.get((*source, "clearing")) is True for source in sources)
    else:
        unused = ObstacleLayer(marking=False, clearing=False)
        given |= {name: getattr(unused, name) for name in OF_THE_SCAN}
    return reader.group(ObstacleLayer, place, _in_source(scan or cloud or place), given, kinds=kinds)


def _in_source(source: ParameterLocation) -> Mapping[str, ParameterLocation]:
    return {name: (*source, name) for name in OF_THE_SCAN}


def written_costmap(name: str, costmap: Costmap) -> Values:
    """Write a costmap, and the nodes with its filters' information."""
    node = (name, name, PARAMETERS)
    own: list[str] = [*OF_THE_WINDOW]
    if name == "global_costmap":
        own = ["publish_frequency", *(OF_THE_MAP if costmap.sized_by_map else ())]
    values = written(costmap, node, given=(*_FIELDS.values(), *own))
    is_listed = {"static_layer": name == "global_costmap" and costmap.sized_by_map}
    groups = {field: group for field, group in costmap if field in _FIELDS.values()}
    groups = {field: group for field, group in groups.items() if group.enabled or is_listed.get(field)}
    filters = {field: groups.pop(field) for field in ("keepout_filter", "speed_filter") if field in groups}
    voxels = costmap.obstacle_layer.short_clearing_cells
    layers = {"voxel_layer" if voxels and field == "obstacle_layer" else field: groups[field] for field in groups}
    place = (*node, "voxel_layer" if voxels else "obstacle_layer")
    if costmap.obstacle_layer.enabled:
        scan = (*place, "scan")
        values |= {(*place, "observation_sources"): "scan", (*scan, "data_type"): "LaserScan"}
        values[(*scan, "max_obstacle_height")] = _PASSING_M
    values |= written_plugins(node, LAYERS, layers, _in_source((*place, "scan")))
    for field, group in filters.items():
        topic = f"{name}_{field}_info"
        info = (f"{topic}_server", PARAMETERS)
        values |= written_plugins(node, FILTERS, {field: group}, {key: (*info, key) for key in _INFO})
        values |= {(*node, FILTERS.lists[0]): [*filters], (*node, field, TOPIC): topic, (*info, TOPIC): topic}
    return values


def masks_of(system: Mapping[str, Value], parameters: NavParameters) -> Masks:
    """The masks that a system names for the filters of its costmaps.

    Raises:
        ScenarioError: a filter without a mask, or a mask that is no map file.
    """
    masks: list[FileContent | None] = []
    for key in MASK_KEYS:
        costmaps, found = filtered_by(key, parameters), system.get(key)
        if costmaps and not isinstance(found, FileContent):
            wrong = missing_mask(key, costmaps) if found is None else (Got(repr(found)), "a map_server YAML file")
            raise ScenarioError(f"{key}: {message_of(*wrong)}")
        masks.append(found if costmaps and isinstance(found, FileContent) else None)
    return Masks(*masks)
