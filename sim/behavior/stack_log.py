"""What the nodes of the simulated navigation stack would log, line by line."""

from collections.abc import Iterator, Mapping
from typing import Final

from vastflow.sim.loop.simulation import REASONS, Simulation
from vastflow.sim.nav.state import ABORTED, EVENT_KINDS, RECOVERIES, RUNNING, SUCCEEDED

Line = tuple[str, str]
"""Node and text."""

_RECOVERED: Final[Mapping[str, Line]] = {
    "clear local costmap": ("local_costmap.local_costmap", "Received request to clear entirely the local_costmap"),
    "clear global costmap": ("global_costmap.global_costmap", "Received request to clear entirely the global_costmap"),
    "clear both costmaps": ("global_costmap.global_costmap", "Received request to clear entirely the global_costmap"),
    "spin": ("behavior_server", "Running spin"),
    "wait": ("behavior_server", "Running wait"),
    "back up": ("behavior_server", "Running backup"),
}

_HAPPENED: Final[Mapping[str, Line]] = {
    "goal_reached": ("controller_server", "Reached the goal!"),
    "goal_missed": ("waypoint_follower", "Failed to process waypoint, moving to next."),
    "plan_failed": ("planner_server", "GridBased: failed to create plan"),
    "control_failed": ("controller_server", "Controller failed to follow the path"),
    "stopped_by_monitor": ("collision_monitor", "Robot to stop due to FootprintApproach polygon"),
}


class StackLog:
    """The stack's log from here on."""

    def __init__(self, simulation: Simulation) -> None:
        self._simulation = simulation
        self._told = len(simulation.told)
        self._events = self._counted()
        self._status = simulation.status

    def new(self) -> list[Line]:
        """The lines since the last call, or since the log was begun."""
        return list(self._lines())

    def _lines(self) -> Iterator[Line]:
        simulation = self._simulation
        told, self._told = simulation.told[self._told :], len(simulation.told)
        yield from told
        rows = simulation.stack.m[0]["event_rows"][self._events : self._counted()]
        self._events = self._counted()
        for _, kind, _, _, what, _ in rows.tolist():
            name = EVENT_KINDS[int(kind)]
            yield _RECOVERED[RECOVERIES[int(what)]] if name == "recovery" else _HAPPENED[name]
        before, self._status = self._status, simulation.status
        if self._status == before or (before != RUNNING and not told):
            return
        if self._status == SUCCEEDED:
            yield "bt_navigator", "Goal succeeded"
        elif self._status == ABORTED:
            yield "bt_navigator", f"Goal failed: {REASONS[simulation.error_code]}"

    def _counted(self) -> int:
        return int(self._simulation.stack.m[0]["events"])
