"""Reading the node of a costmap: its layers in the order of the file, its filters, and the laser scan that marks in one of the layers."""

from collections.abc import Mapping, Sequence
from typing import Any, Final

from vastflow.sim.nav.parameters.costmap import (
    Costmap,
    DenoiseLayer,
    InflationLayer,
    ObstacleLayer,
    StaticLayer,
    global_costmap,
)
from vastflow.sim.nav.parameters.document import ParameterLocation
from vastflow.sim.nav.parameters.filters import filters_of
from vastflow.sim.nav.parameters.plugins import LAYERS
from vastflow.sim.nav.parameters.reader import Instance, Reader
from vastflow.sim.nav.polygon import vertices_of

OF_THE_MAP: Final = ("publish_frequency", "width", "height", "resolution")
"""Parameters of the global costmap that have no effect: it is as large and as fine as the map."""

OF_THE_SCAN: Final = ("marking", "clearing", "obstacle_max_range", "obstacle_min_range", "raytrace_max_range")
"""Parameters of an obstacle layer that its source has."""

_FIELDS: Final = {"StaticLayer": "static_layer", "DenoiseLayer": "denoise_layer", "InflationLayer": "inflation_layer"}
"""Kinds of layers to fields of `Costmap`; others are obstacle layers."""

_MODELS: Final[Mapping[str, type[Any]]] = {
    "static_layer": StaticLayer,
    "obstacle_layer": ObstacleLayer,
    "denoise_layer": DenoiseLayer,
    "inflation_layer": InflationLayer,
}


def read_local_costmap(reader: Reader, node: ParameterLocation) -> Mapping[str, Costmap]:
    """The rolling window."""
    return {"local_costmap": _costmap(reader, node)}


def read_global_costmap(reader: Reader, node: ParameterLocation) -> Mapping[str, Costmap]:
    """The costmap that is as large and as fine as the map."""
    default = global_costmap()
    return {"global_costmap": _costmap(reader, node, **{name: getattr(default, name) for name in OF_THE_MAP})}


def _costmap(reader: Reader, node: ParameterLocation, **given: Any) -> Costmap:
    given |= filters_of(reader, node)
    layers = _layers(reader, node)
    _check_order(reader, node, list(layers.values()))
    for field, model in _MODELS.items():
        if field not in layers:
            given[field] = model(enabled=False)
            continue
        place, kind = (*node, layers[field].name), layers[field].kind
        if kind == "SpatioTemporalVoxelLayer":
            given[field] = _spatio_temporal_layer(reader, place)
        elif field == "obstacle_layer":
            given[field] = _obstacle_layer(reader, place, 2 if kind == "VoxelLayer" else 0)
        else:
            given[field] = reader.group(model, place)
    found = reader.group(Costmap, node, given=given)
    radius = (*node, "robot_radius")
    if not reader.faults and vertices_of(found.footprint):
        reader.leave(radius, "the polygon footprint replaces it")
    return found


def _layers(reader: Reader, node: ParameterLocation) -> Mapping[str, Instance]:
    """Fields of `Costmap` to the layers that are read for them, in the order of the file; of several the best, then the first."""
    layers: dict[str, list[Instance]] = {}
    listed = reader.plugins(node, LAYERS)
    for layer in listed:
        layers.setdefault(_FIELDS.get(layer.kind, "obstacle_layer"), []).append(layer)
    used = {}
    for field, several in layers.items():
        used[field] = max(several, key=lambda layer: _worth(reader, (*node, layer.name)))
        for layer in several:
            if layer != used[field]:
                why = f"a second layer beside {used[field].name} is not modeled"
                reader.unmodeled[(*node, layer.name)] = why
    return dict(sorted(used.items(), key=lambda item: listed.index(item[1])))


def _worth(reader: Reader, place: ParameterLocation) -> tuple[bool, bool]:
    """A layer that is on comes before one that is off, then one that sees the laser scan."""
    values = reader.document.values
    return values.get((*place, "enabled"), True) is not False, any(
        _data_type(reader, source) == "LaserScan" for source in _sources(reader, place)
    )


def _check_order(reader: Reader, node: ParameterLocation, layers: Sequence[Instance]) -> None:
    """Nav2 inflates what the layers before the inflation have marked, and nothing else."""
    inflation = next((layer for layer in layers if layer.kind == "InflationLayer"), None)
    if inflation is None:
        return
    for layer in layers[layers.index(inflation) + 1 :]:
        path = (*node, layer.name, "plugin")
        if layer.kind == "DenoiseLayer":
            right = "a Denoise layer before it in the list 'plugins'"
            reader.fault(path, f"{layer.name} comes after the inflation", right)
        else:
            what = f"{layer.name} comes after the inflation: Nav2 does not inflate what it marks, which is not modeled"
            reader.fault(path, what, f"{layer.name!r} before {inflation.name!r} in the list 'plugins'")


def _sources(reader: Reader, place: ParameterLocation) -> list[ParameterLocation]:
    return [(*place, name) for name in reader.names((*place, "observation_sources"), ())]


def _data_type(reader: Reader, source: ParameterLocation) -> object:
    """Of a source that does not say what it is, Nav2's code takes a point cloud."""
    return reader.document.values.get((*source, "data_type"), "PointCloud2")


def _obstacle_layer(reader: Reader, place: ParameterLocation, short_clearing_cells: int) -> ObstacleLayer:
    """The layer with its laser scan; without any source it neither marks nor clears."""
    values, sources = reader.document.values, _sources(reader, place)
    given: dict[str, Any] = {"short_clearing_cells": short_clearing_cells}
    scan = next((source for source in sources if _data_type(reader, source) == "LaserScan"), None)
    cloud = next((source for source in sources if values.get((*source, "marking"), True) is True), None)
    for source in sources:
        if source != scan:
            reader.unmodeled[source] = "only one source, a LaserScan, is modeled"
    if scan is not None:
        reader.text((*scan, "data_type"), "LaserScan")
        reader.kinds[scan] = "scan"
    elif cloud is not None:
        reader.unmodeled[cloud] = "a point cloud is read as the laser scan"
        given["clearing"] = any(values.get((*source, "clearing")) is True for source in sources)
    else:
        unused = ObstacleLayer(marking=False, clearing=False)
        given |= {name: getattr(unused, name) for name in OF_THE_SCAN}
        return reader.group(ObstacleLayer, place, given=given)
    source = scan or cloud or place
    return reader.group(ObstacleLayer, place, {name: (*source, name) for name in OF_THE_SCAN}, given)


def _spatio_temporal_layer(reader: Reader, place: ParameterLocation) -> ObstacleLayer:
    """A VoxelLayer of the laser scan in its place, as far as its first source sees that marks."""
    values = reader.document.values
    source = next(
        (each for each in _sources(reader, place) if values.get((*each, "marking"), True) is True), (*place, "scan")
    )
    reader.unmodeled[place] = "it is read as a VoxelLayer of the laser scan: no voxel decays, and there is no camera"
    seen_m = (*source, "obstacle_range")
    elsewhere = {
        "obstacle_max_range": seen_m,
        "raytrace_max_range": seen_m,
        "footprint_clearing_enabled": (*place, "update_footprint_enabled"),
    }
    given = {"marking": True, "clearing": True, "obstacle_min_range": 0.0, "short_clearing_cells": 2}
    return reader.group(ObstacleLayer, place, elsewhere, given)
