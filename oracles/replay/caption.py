"""Captions: what a robot is doing at a moment, in words."""

from collections.abc import Mapping
from typing import Final

from vastflow.sim.loop.simulation import REASONS
from vastflow.sim.loop.standstill import told
from vastflow.sim.model.recording import Event, Run
from vastflow.sim.replay.snapshot import Activity, Moment

SLOW_S: Final = 3.0
"""The progress checker's clock is worth a word only after this time."""

_ACTIVITIES: Final[Mapping[Activity, str]] = {
    "starting": "waiting for the first scan",
    "spin": "recovery: spin",
    "wait": "recovery: wait",
    "back up": "recovery: back up",
    "pausing": "pause at a waypoint",
    "resting": "without a mission",
}


def doing(moment: Moment, run: Run) -> str:
    """What the robot is doing; `run` says how it ended."""
    if moment.activity == "ended":
        return {"succeeded": "mission succeeded", "aborted": "mission given up"}.get(run.outcome, "mission ended")
    if moment.activity != "following":
        words = _ACTIVITIES[moment.activity]
        return f"{words}, held by the collision monitor" if moment.stopped else words
    if moment.stopped:
        return "stopped by the collision monitor"
    if not moment.planned:
        return "waiting for a plan"
    if moment.no_command_s > 0.0:
        return f"no valid command for {moment.no_command_s:.2f} s"
    if moment.no_progress_s > SLOW_S:
        return f"following, no progress for {moment.no_progress_s:.0f} s"
    return "following the plan"


def numbers(moment: Moment) -> str:
    """Motion, localization error, recoveries so far."""
    turning = f", {abs(moment.yaw_rate_degps):.0f}°/s" if abs(moment.yaw_rate_degps) >= 0.5 else ""
    recoveries = f"{moment.recoveries} {'recovery' if moment.recoveries == 1 else 'recoveries'}"
    # + 0.0 turns the -0.00 of a robot that is pushed out of a wall into 0.00.
    speed = f"{round(moment.speed_mps, 2) + 0.0:.2f} m/s{turning}"
    return f"{speed} · localization {moment.error_m * 100:.0f} cm off · {recoveries}"


def happening(event: Event) -> str | None:
    """An event in a few words; None for one that is not worth any."""
    match event.kind:
        case "contact":
            return f"touches {event.what} at {event.value:.2f} m/s"
        case "spawned":
            return f"{event.what} appears"
        case "deleted":
            return f"{event.what} disappears"
        case "recovery":
            return f"recovery: {event.what}"
        case "plan_failed" | "control_failed":
            return REASONS.get(int(event.what), f"error {event.what}").partition(" (")[0]
        case "goal_reached" | "goal_missed":
            return f"goal {int(event.what) + 1} {'reached' if event.kind == 'goal_reached' else 'given up'}"
        case "stopped_by_monitor":
            return "stopped by the collision monitor"
        case "stood_still":
            return told(event).partition(": ")[2]
    return None
