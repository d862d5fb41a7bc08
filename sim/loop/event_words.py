"""Words for the events of a run, and for Nav2's error codes."""

from collections.abc import Mapping
from typing import Final

from vastflow.sim.loop.standstill import CAUSES, STOOD_STILL
from vastflow.sim.model.recording import Event

REASONS: Final[Mapping[int, str]] = {
    100: "the controller server has no checker that it would take (UNKNOWN)",
    101: "the controller server has no controller of the name (INVALID_CONTROLLER)",
    103: "the plan led out of the local costmap (INVALID_PATH)",
    104: "the controller found no valid command (PATIENCE_EXCEEDED)",
    105: "no progress (FAILED_TO_MAKE_PROGRESS)",
    107: "the controller waited too long for its costmap (CONTROLLER_TIMED_OUT)",
    201: "the planner server has no planner of the name (INVALID_PLANNER)",
    203: "the robot is outside the map (START_OUTSIDE_MAP)",
    204: "the goal is outside the map (GOAL_OUTSIDE_MAP)",
    205: "the robot stands where no path can begin (START_OCCUPIED)",
    206: "the goal lies in an obstacle (GOAL_OCCUPIED)",
    207: "the planner waited or searched too long (TIMEOUT)",
    208: "no path to the goal (NO_VALID_PATH)",
    301: "the planner server has no planner of the name (INVALID_PLANNER)",
    303: "the robot is outside the map (START_OUTSIDE_MAP)",
    304: "a goal is outside the map (GOAL_OUTSIDE_MAP)",
    305: "the robot stands where no path can begin (START_OCCUPIED)",
    306: "a goal lies in an obstacle (GOAL_OCCUPIED)",
    307: "the planner waited or searched too long (TIMEOUT)",
    308: "no path through the goals (NO_VALID_PATH)",
}
"""Nav2's error codes, in words."""


def event_words(event: Event) -> str | None:
    """Return an event in a few words; None for minor ones, such as each move of an obstacle."""
    match event.kind:
        case "contact":
            return f"touches {event.what} at {event.value:.2f} m/s"
        case "spawned" | "deleted":
            return f"{event.what} {'appears' if event.kind == 'spawned' else 'disappears'}"
        case "recovery":
            return f"recovery: {event.what}"
        case "plan_failed" | "control_failed":
            return REASONS.get(int(event.what), f"error {event.what}")
        case "goal_reached" | "goal_missed":
            return f"goal {int(event.what) + 1} {'reached' if event.kind == 'goal_reached' else 'given up'}"
        case "stopped_by_monitor":
            return "stopped by the collision monitor"
        case _ if event.kind == STOOD_STILL:
            return CAUSES[event.what]
    return None
