"""One scenario, one seed → one run's recording."""

import functools
from collections.abc import Callable, Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from vastflow.sim.closed_loop import ClosedLoop
from vastflow.sim.digest import FileContent
from vastflow.sim.lidar import Lidar
from vastflow.sim.maps import OccupancyMap, load_map
from vastflow.sim.mission import Mission, mission_of
from vastflow.sim.nav.parameters.chosen import parameters_of
from vastflow.sim.nav.parameters.stack import NavParameters
from vastflow.sim.nav.state import COLUMNS, EVENT_KINDS, EVENT_RECOVERY, RECOVERIES, RUNNING, SUCCEEDED, TICK_S, Stack
from vastflow.sim.obstacle import Obstacle, obstacles_of
from vastflow.sim.prepared import KEPT_MAPS, PreparedMap, prepare
from vastflow.sim.recording import Event, Outcome, Recording, Run
from vastflow.sim.robot import Robot
from vastflow.sim.scenario import Scenario
from vastflow.sim.streams import run_entropy

REASONS: Mapping[int, str] = {
    103: "the plan led out of the local costmap (INVALID_PATH)",
    104: "the controller found no valid command (PATIENCE_EXCEEDED)",
    105: "no progress (FAILED_TO_MAKE_PROGRESS)",
    203: "the robot is outside the map (START_OUTSIDE_MAP)",
    204: "the goal is outside the map (GOAL_OUTSIDE_MAP)",
    208: "no path to the goal (NO_VALID_PATH)",
    303: "the robot is outside the map (START_OUTSIDE_MAP)",
    304: "a goal is outside the map (GOAL_OUTSIDE_MAP)",
    308: "no path through the goals (NO_VALID_PATH)",
}
"""Nav2's error codes, in words."""


class ScenarioError(ValueError):
    """A scenario that can't be executed; says which key, what was found and what would be right."""


def run(
    scenario: Scenario,
    run_index: int,
    seed: int = 0,
    watch: Callable[[Stack, int], None] | None = None,
    watch_ticks: Sequence[int] = (),
) -> Recording:
    """Execute one run. Equal (scenario, run index, seed, code) give equal recordings, whatever ran before.

    Args:
        seed: The campaign's `execution.seed`.
        watch, watch_ticks: See `execute`.

    Raises:
        ScenarioError: no map, or a map that changed since the scenario was made.
        MissionError, ParameterError, MapError: a key of the scenario that can't be used.
    """
    mission = mission_of(scenario)
    parameters = parameters_of(scenario.system)
    obstacles = obstacles_of(scenario.environment)
    prepared = prepare(_loaded(_map_of(scenario.environment)), Lidar(), parameters)
    entropy = run_entropy(seed, scenario.situation_digest, run_index)
    robot, timeout_s = Robot(), scenario.timeout_s
    return execute(prepared, parameters, Lidar(), robot, mission, obstacles, entropy, timeout_s, watch, watch_ticks)


def execute(
    prepared: PreparedMap,
    parameters: NavParameters,
    lidar: Lidar,
    robot: Robot,
    mission: Mission,
    obstacles: tuple[Obstacle, ...],
    entropy: Sequence[int],
    timeout_s: float,
    watch: Callable[[Stack, int], None] | None = None,
    watch_ticks: Sequence[int] = (),
) -> Recording:
    """The whole of one run.

    Args:
        entropy: (seed, situation, run index), see `vastflow.sim.streams.run_entropy`.
        watch: Is shown the stack as it is after a tick, and the tick; it may look and copy, and the run is the same.
        watch_ticks: The ticks it is called after, in increasing order; those after the run's end are left out.
    """
    loop = ClosedLoop(prepared, parameters, lidar, robot, mission, obstacles, entropy, timeout_s)
    if watch is not None:
        for tick in watch_ticks:
            loop.advance(tick + 1)
            if loop.tick > tick:
                watch(loop.stack, tick)
    loop.advance()
    return _recording(loop, entropy)


def _map_of(environment: Mapping[str, object]) -> FileContent:
    content = environment.get("map_file")
    if not isinstance(content, FileContent):
        raise ScenarioError(f"map_file: found {content!r}; a map file that the campaign names")
    return content


@functools.lru_cache(maxsize=KEPT_MAPS)
def _loaded(content: FileContent) -> OccupancyMap:
    occupancy = load_map(content.path)
    if occupancy.digest != content.digest:
        raise ScenarioError(f"map_file: {content.path} changed since the campaign was read; run the campaign again")
    return occupancy


def _recording(loop: ClosedLoop, entropy: Sequence[int]) -> Recording:
    stack, status = loop.stack, loop.status
    m = stack.m[0]
    outcome: Outcome = "succeeded" if status == SUCCEEDED else "timed_out" if status == RUNNING else "aborted"
    error_code = int(m["error_code"])
    reason = ""
    if outcome == "aborted":
        reason = f"{REASONS[error_code]}, after {int(m['recoveries'])} recoveries"
    elif outcome == "timed_out":
        reason = "the mission did not end within its time"
    contacts = [event for event in loop.events if event.kind == "contact"]
    if contacts:
        reason = f"{reason}; {_told(contacts)}" if reason else _told(contacts)
    events = [*(_event(row) for row in m["event_rows"][: int(m["events"])]), *loop.events]
    columns = {name: stack.rows[: int(m["rows"]), k].copy() for k, name in enumerate(COLUMNS)}
    return Recording(
        Run(
            run_index=entropy[-1],
            seed=":".join(f"{part:x}" for part in entropy),
            outcome=outcome,
            error_code=error_code,
            reason=reason,
            simulated_s=round(float(m["tick"]) * TICK_S, 3),
            distance_m=round(float(m["distance"]), 3),
            recoveries=int(m["recoveries"]),
            missed_goals=int(m["missed"]),
            events=tuple(sorted(events, key=lambda event: event.t_s)),
        ),
        columns,
    )


def _told(contacts: Sequence[Event]) -> str:
    first = f"with {contacts[0].what} at {contacts[0].t_s:.1f} s"
    return f"a contact {first}" if len(contacts) == 1 else f"{len(contacts)} contacts, the first {first}"


def _event(row: NDArray[np.float64]) -> Event:
    t_s, kind, x_m, y_m, what, value = row.tolist()
    detail = RECOVERIES[int(what)] if int(kind) == EVENT_RECOVERY else str(int(what))
    return Event(round(t_s, 3), EVENT_KINDS[int(kind)], round(x_m, 3), round(y_m, 3), detail, value)
