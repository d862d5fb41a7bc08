"""Which of a scenario's actions nothing here can do, told before anything runs."""

from collections.abc import Container, Iterator, Mapping
from dataclasses import dataclass
from typing import Final

from vastflow.sim.behaviour.modifier import MODIFIERS
from vastflow.sim.osc.definition import Behaviour, Call, Composition, Modified, Place, ScenarioDefinition, Until

_NO_GRAPH = (
    "it talks to ROS nodes, topics or services, and there are none: the navigation stack runs inside the simulator"
)
_NO_GAZEBO = "it steers a simulator of its own, but a run's simulator is started, stepped and ended by vastflow"
_NO_CLUSTER = "it starts or looks after containers; what a run is executed in is for `execution` in the campaign file"
_NO_ARM = "it moves an arm, and the simulated robot has none"
_NO_NETWORK = "a run may depend on nothing but its configuration and seed, and so reaches no network"

REASONS: Final[Mapping[str, str]] = {
    "ros_run": "it starts a ROS node, and there is no ROS; a program of your own is started by run_process",
    "bag_play": "it plays messages to ROS nodes, and there are none",
    "log_check": "it reads the log of ROS nodes, and there are none; of a program of your own process_log_check does",
    "topic_publish": _NO_GRAPH,
    "topic_monitor": _NO_GRAPH,
    "check_data": _NO_GRAPH,
    "wait_for_data": _NO_GRAPH,
    "wait_for_nodes": _NO_GRAPH,
    "wait_for_topics": _NO_GRAPH,
    "wait_for_services": _NO_GRAPH,
    "service_call": _NO_GRAPH,
    "action_call": _NO_GRAPH,
    "set_node_parameter": f"{_NO_GRAPH}; parameters are given by the campaign's Nav2 parameter file",
    "assert_tf_moving": _NO_GRAPH,
    "assert_topic_latency": _NO_GRAPH,
    "assert_lifecycle_state": _NO_GRAPH,
    "load_world": f"{_NO_GAZEBO}; the world is the configuration's map or floor plan",
    "reset_simulation": _NO_GAZEBO,
    "step_simulation": _NO_GAZEBO,
    "set_simulation_state": _NO_GAZEBO,
    "generate_floorplan": "floor plans are made before a run, by the campaign's FloorplanGeneration",
    "http_get": _NO_NETWORK,
}
"""Why an action can't be had here, by its name without an actor's."""

REASONS_OF_FAMILIES: Final[Mapping[str, str]] = {
    "docker": _NO_CLUSTER,
    "kubernetes": _NO_CLUSTER,
    "moveit": _NO_ARM,
    "pybullet": _NO_GAZEBO,
    "http": _NO_NETWORK,
}
"""The same by how the name of an action or its actor begins."""

GENERIC: Final = "vastflow's simulator has no such action"


@dataclass(frozen=True, slots=True)
class Unsupported:
    """Something in a scenario that nothing implements.

    Attributes:
        name: Of the action (with its actor's type) or modifier.
        reason: In words.
    """

    place: Place
    name: str
    reason: str

    def __str__(self) -> str:
        return f"{self.place}: {self.name} can't be run: {self.reason}"


def unsupported(definition: ScenarioDefinition, known: Container[str]) -> list[Unsupported]:
    """Every call and modifier of a scenario that nothing implements, in the order of the file.

    Args:
        known: Qualified names of the actions that a run has.
    """
    return [Unsupported(node.place, name, reason) for node, name, reason in _lacking(definition.root, known)]


def reason_for(action: str) -> str:
    """Why an action can't be had here."""
    actor, _, name = action.rpartition(".")
    if name in REASONS:
        return REASONS[name]
    for beginning, reason in REASONS_OF_FAMILIES.items():
        if name.startswith(beginning) or actor.startswith(beginning):
            return reason
    return GENERIC


def _lacking(node: Behaviour, known: Container[str]) -> Iterator[tuple[Call | Modified, str, str]]:
    match node:
        case Call() if node.action not in known:
            yield node, node.action, reason_for(node.action)
        case Composition():
            for child in node.children:
                yield from _lacking(child, known)
        case Modified():
            if node.modifier not in MODIFIERS:
                yield node, node.modifier, "vastflow has no such modifier"
            yield from _lacking(node.child, known)
        case Until():
            yield from _lacking(node.child, known)
