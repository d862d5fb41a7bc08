"""One scenario, one seed → one run's recording."""

import functools
from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from vastflow.sim.digest import FileContent
from vastflow.sim.lidar import Lidar
from vastflow.sim.maps import OccupancyMap, load_map
from vastflow.sim.mission import Mission, mission_of
from vastflow.sim.nav.behaviour import FAILED_TO_MAKE_PROGRESS, NO_VALID_PATH, PATIENCE_EXCEEDED
from vastflow.sim.nav.parameters import NavParameters, parameters_of
from vastflow.sim.nav.state import (
    COLUMNS,
    EVENT_KINDS,
    EVENT_RECOVERY,
    RECOVERIES,
    RUNNING,
    SUBSTEPS,
    SUCCEEDED,
    TICK_S,
    Stack,
    new_stack,
)
from vastflow.sim.nav.tick import nav_tick, start
from vastflow.sim.obstacle import Obstacle, obstacles_of
from vastflow.sim.prepared import PreparedMap, prepare
from vastflow.sim.recording import Event, Outcome, Recording, Run
from vastflow.sim.robot import Robot
from vastflow.sim.scenario import Scenario
from vastflow.sim.streams import run_entropy, streams_of
from vastflow.sim.world import World

REASONS: Mapping[int, str] = {
    PATIENCE_EXCEEDED: "the controller found no valid command (PATIENCE_EXCEEDED)",
    FAILED_TO_MAKE_PROGRESS: "no progress (FAILED_TO_MAKE_PROGRESS)",
    NO_VALID_PATH: "no path to the goal (NO_VALID_PATH)",
}


class ScenarioError(ValueError):
    """A scenario that can't be executed; says which key, what was found and what would be right."""


def run(scenario: Scenario, run_index: int, seed: int = 0) -> Recording:
    """Execute one run. Equal (scenario, run index, seed, code) give equal recordings, whatever ran before.

    Args:
        seed: The campaign's `execution.seed`.

    Raises:
        ScenarioError: no map, or a map that changed since the scenario was made.
        MissionError, ParameterError, MapError: a key of the scenario that can't be used.
    """
    mission = mission_of(scenario)
    parameters = parameters_of(scenario.system)
    obstacles = obstacles_of(scenario.environment)
    prepared = _prepared(_map_of(scenario.environment), parameters)
    entropy = run_entropy(seed, scenario.situation_digest, run_index)
    return execute(prepared, parameters, Lidar(), Robot(), mission, obstacles, entropy, scenario.timeout_s)


def execute(
    prepared: PreparedMap,
    parameters: NavParameters,
    lidar: Lidar,
    robot: Robot,
    mission: Mission,
    obstacles: tuple[Obstacle, ...],
    entropy: Sequence[int],
    timeout_s: float,
) -> Recording:
    """The closed loop of one run: stack and physics in turn, 20 times a simulated second.

    Args:
        entropy: (seed, situation, run index), see `vastflow.sim.streams.run_entropy`.
    """
    world = World(robot, mission.start, prepared.walls, obstacles)
    stack = new_stack(
        prepared, parameters, lidar, robot, mission, obstacle_rows(obstacles), streams_of(entropy), timeout_s
    )
    start(stack.m)
    velocities = stack.m[0]["velocities"]
    status = RUNNING
    for _ in range(round(timeout_s / TICK_S)):
        x_m, y_m = world.robot.position
        status = nav_tick(
            stack.p,
            stack.m,
            stack.grids,
            stack.cloud,
            stack.route,
            stack.obstacles,
            stack.rows,
            x_m,
            y_m,
            world.robot.angle,
        )
        if status != RUNNING:
            break
        world.drive(velocities.tolist(), TICK_S / SUBSTEPS)
    return _recording(stack, status, entropy, world.contacts)


def obstacle_rows(obstacles: tuple[Obstacle, ...]) -> NDArray[np.float64]:
    """Obstacles as the rows (K, 6) that `vastflow.sim.lidar.scan` reads."""
    rows = [
        (
            o.pose.x_m,
            o.pose.y_m,
            np.cos(o.pose.yaw_rad),
            np.sin(o.pose.yaw_rad),
            o.length_m / 2,
            0.0 if o.shape == "cylinder" else o.width_m / 2,
        )
        for o in obstacles
    ]
    return np.array(rows, dtype=np.float64).reshape(-1, 6)


def _map_of(environment: Mapping[str, object]) -> FileContent:
    content = environment.get("map_file")
    if not isinstance(content, FileContent):
        raise ScenarioError(f"map_file: found {content!r}; a map file that the campaign names")
    return content


@functools.lru_cache(maxsize=4)
def _prepared(content: FileContent, parameters: NavParameters) -> PreparedMap:
    return prepare(_loaded(content), Lidar(), parameters)


@functools.lru_cache(maxsize=4)
def _loaded(content: FileContent) -> OccupancyMap:
    occupancy = load_map(content.path)
    if occupancy.digest != content.digest:
        raise ScenarioError(f"map_file: {content.path} changed since the campaign was read; run the campaign again")
    return occupancy


def _recording(stack: Stack, status: int, entropy: Sequence[int], contacts: list[Event]) -> Recording:
    m = stack.m[0]
    outcome: Outcome = "succeeded" if status == SUCCEEDED else "timed_out" if status == RUNNING else "aborted"
    error_code = int(m["error_code"])
    reason = ""
    if outcome == "aborted":
        reason = f"{REASONS[error_code]}, after {int(m['recoveries'])} recoveries"
    elif outcome == "timed_out":
        reason = "the mission did not end within its time"
    events = [_event(row) for row in m["event_rows"][: int(m["events"])]] + contacts
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


def _event(row: NDArray[np.float64]) -> Event:
    t_s, kind, x_m, y_m, what, value = row.tolist()
    detail = RECOVERIES[int(what)] if int(kind) == EVENT_RECOVERY else str(int(what))
    return Event(round(t_s, 3), EVENT_KINDS[int(kind)], round(x_m, 3), round(y_m, 3), detail, value)
