"""Wildcards in the names of nodes: what `/**`, `/*/amcl`, and the like give to the nodes that they stand for (rclcpp, `parameter_map_from`)."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Final

from pydantic import BaseModel

from vastflow.sim.digest import Value
from vastflow.sim.files import TextPlace
from vastflow.sim.nav.parameters.amcl import AmclParameters
from vastflow.sim.nav.parameters.costmap import Costmap
from vastflow.sim.nav.parameters.document import (
    PARAMETERS,
    ParameterDocument,
    ParameterLocation,
    node_of,
    read_document,
)
from vastflow.sim.nav.parameters.plugins import CONTROLLERS, GOAL_CHECKERS, LAYERS, PLANNERS, PROGRESS_CHECKERS
from vastflow.sim.nav.parameters.servers import BehaviorServer, ControllerServer, VelocitySmoother, WaypointFollower

_ANY: Final = "*"
_ANY_NUMBER: Final = "**"
_SOME_NAMESPACE: Final = ""
"""A node without a namespace in the file may be started in one, whose name no file says."""


def _fields(*models: type[BaseModel]) -> frozenset[str]:
    return frozenset(name for model in models for name in model.model_fields)


_CONTROLLER_SERVER: Final = (*CONTROLLERS.lists, *PROGRESS_CHECKERS.lists, *GOAL_CHECKERS.lists)
_NAMES: Final[Mapping[ParameterLocation, frozenset[str]]] = {
    ("amcl",): _fields(AmclParameters),
    ("controller_server",): _fields(ControllerServer) | {*_CONTROLLER_SERVER, CONTROLLERS.used},
    ("local_costmap", "local_costmap"): _fields(Costmap) | {*LAYERS.lists},
    ("global_costmap", "global_costmap"): _fields(Costmap) | {*LAYERS.lists},
    ("planner_server",): frozenset((*PLANNERS.lists, PLANNERS.used)),
    ("behavior_server",): _fields(BehaviorServer),
    ("waypoint_follower",): _fields(WaypointFollower),
    ("velocity_smoother",): _fields(VelocitySmoother),
    ("collision_monitor",): frozenset({"polygons"}),
}
"""The nodes that are modeled to names that their parameters begin with: one of them makes a wildcard speak of the node."""


def read_nav2_document(path: str | Path) -> ParameterDocument:
    """Read a Nav2 parameter file with its wildcards resolved.

    Raises:
        DocumentError: as of `vastflow.sim.nav.parameters.document.read_document`.
    """
    return resolved(read_document(path))


def resolved(document: ParameterDocument) -> ParameterDocument:
    """The document in which the nodes that wildcards stand for have the parameters themselves, each where the file has it.

    Of several values for one parameter the file's last counts, as since Humble, be it a wildcard's or the node's own. A
    wildcard speaks of a node by its name, or by a parameter that nodes of this name have; one that speaks of none stays as it is.
    """
    wild = [node for node in document.nodes if _is_wild(node)]
    if not wild:
        return document
    spoken_of = {node: [*_targets(document, node)] for node in wild}
    values: dict[ParameterLocation, Value] = {}
    places: dict[ParameterLocation, TextPlace] = {}
    for path, place in document.places.items():
        for to in _moved(path, spoken_of):
            places[to] = place if to not in places or path in document.values else places[to]
    for path, value in document.values.items():
        for to in _moved(path, spoken_of):
            values[to] = value
    return replace(document, values=values, places=places)


def _moved(
    path: ParameterLocation, spoken_of: Mapping[ParameterLocation, Sequence[ParameterLocation]]
) -> Iterator[ParameterLocation]:
    """Where a path, or a part of one, stands in the resolved document."""
    node = node_of(path) if PARAMETERS in path else path
    if targets := spoken_of.get(node):
        yield from ((*target, *path[len(node) :]) for target in targets)
    else:
        yield path


def _targets(document: ParameterDocument, wild: ParameterLocation) -> Iterator[ParameterLocation]:
    """Paths of the nodes that a wildcard speaks of: as the file has them, or else below the wildcard's own namespace."""
    pattern = wild[:-1]
    heads = {path[len(wild)] for path in document.below(wild)}
    above = pattern[: next(k for k, part in enumerate(pattern) if part in (_ANY, _ANY_NUMBER))]
    for name, names in _NAMES.items():
        if heads.isdisjoint(names) and pattern[-1] != name[-1]:
            continue
        own = [node for node in document.nodes if not _is_wild(node) and node[-len(name) - 1 : -1] == name]
        in_any = _matches(pattern, (_SOME_NAMESPACE, *name))
        for node in own:
            if _matches(pattern, node[:-1]) or (in_any and node[:-1] == name):
                yield node
        if not own and (in_any or _matches(pattern, name) or _matches(pattern, (*above, *name))):
            yield (*above, *name, PARAMETERS)


def _is_wild(node: ParameterLocation) -> bool:
    return _ANY in node or _ANY_NUMBER in node


def _matches(pattern: ParameterLocation, name: ParameterLocation) -> bool:
    """Whether a pattern stands for a node's full name: `*` is one part of it, `**` any number of them."""
    if not pattern:
        return not name
    if pattern[0] == _ANY_NUMBER:
        return any(_matches(pattern[1:], name[k:]) for k in range(len(name) + 1))
    return bool(name) and pattern[0] in (_ANY, name[0]) and _matches(pattern[1:], name[1:])
