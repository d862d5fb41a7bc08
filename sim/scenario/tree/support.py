"""Actions of a scenario that can't be run, found before a run."""

from collections.abc import Container, Mapping
from typing import Final

from vastflow.sim.model.faults import Fault, ScenarioError
from vastflow.sim.scenario.definition import Call, ScenarioDefinition, behaviors_of
from vastflow.sim.scenario.evaluation import evaluate
from vastflow.sim.scenario.tree.ros_graph import REQUIREMENTS, lacking

_NO_SERVICES = "it asks a node for a service, and nothing offers one: the navigation stack runs inside the simulator"
_NO_CLOCK = "it measures how fast a machine is, and simulated time does not depend on that"
_NO_LOG = (
    "it reads the log of ROS nodes, and in a scenario without a differential_drive_robot there are none; of a program of "
    "your own process_log_check does"
)
_NO_GAZEBO = "it steers a simulator of its own, but a run's simulator is started, stepped and ended by vastflow"
_NO_CLUSTER = "it starts or looks after containers; what a run is executed in is for `execution` in the campaign file"
_NO_ARM = "it moves an arm, and the simulated robot has none"
_NO_NETWORK = "a run may depend on nothing but its configuration and seed, and so reaches no network"

REASONS: Final[Mapping[str, str]] = {
    "ros_run": "it starts a ROS node, and there is no ROS; a program of your own is started by run_process",
    "bag_play": "it plays messages to ROS nodes, and there are none",
    "wait_for_services": _NO_SERVICES,
    "wait_for_service_server": _NO_SERVICES,
    "service_call": _NO_SERVICES,
    "action_call": f"{_NO_SERVICES}; nav_to_pose and its like send the robot somewhere",
    "set_node_parameter": f"{_NO_SERVICES}; parameters are given by the campaign's Nav2 parameter file",
    "assert_lifecycle_state": f"{_NO_SERVICES}; Nav2 is active from the start",
    "check_data_external": "it runs Python of your own on messages; check_data compares a member of one with a value",
    "assert_topic_latency": _NO_CLOCK,
    "assert_realtime_factor": _NO_CLOCK,
    "load_world": f"{_NO_GAZEBO}; the world is the configuration's map or floor plan",
    "unload_world": _NO_GAZEBO,
    "reset_simulation": _NO_GAZEBO,
    "set_entity_state": f"{_NO_GAZEBO}; delete_entity and spawn_entity put a thing elsewhere",
    "step_simulation": _NO_GAZEBO,
    "set_simulation_state": _NO_GAZEBO,
    "generate_floorplan": "floor plans are made before a run, by the campaign's FloorplanGeneration",
    "http_get": _NO_NETWORK,
}
"""Why an action can't be had here, by its name without an actor's."""

FAMILIES: Final[Mapping[str, str]] = {
    "docker": _NO_CLUSTER,
    "kubernetes": _NO_CLUSTER,
    "moveit": _NO_ARM,
    "pybullet": _NO_GAZEBO,
    "http": _NO_NETWORK,
}
"""The same by how the name of an action or its actor begins."""

ROBOT: Final = "differential_drive_robot"

GENERIC: Final = "vastflow's simulator has no such action; one of your own can inherit from an action of a library"


def unsupported(definition: ScenarioDefinition, known: Container[str]) -> list[Fault]:
    """Return a fault for every call of an action that nothing implements, in the order of the file.

    Args:
        known: Qualified names of the actions that a run has.
    """
    has_robot = any(ROBOT in actor.types for actor in definition.actors)
    calls = (behavior for behavior in behaviors_of(definition.root) if isinstance(behavior, Call))
    return [
        Fault(call.place, f"{call.action} can't be run here", reason)
        for call in calls
        if (reason := _reason(call, known, has_robot))
    ]


def _reason(call: Call, known: Container[str], has_robot: bool) -> str:
    """Return why a call can't be run here; empty where it can."""
    if call.action == "log_check" and call.action in known and not has_robot:
        return _NO_LOG
    if call.action in known:
        names = REQUIREMENTS[call.action][1] if call.action in REQUIREMENTS else ()
        try:
            return lacking(call.action, {name: evaluate(call.arguments[name], {}, {}) for name in names})
        except ScenarioError:  # only a run knows them
            return ""
    actor, _, name = call.action.rpartition(".")
    families = (reason for start, reason in FAMILIES.items() if name.startswith(start) or actor.startswith(start))
    return REASONS.get(name) or next(families, GENERIC)
