"""The pinned benchmark: one closed loop in CPU time, with everything that could flatter it printed beside it."""

import itertools
import time
from dataclasses import asdict
from typing import Any, Final

import numpy as np

from vastflow.sim.lidar import Lidar
from vastflow.sim.maps import FREE, OCCUPIED, OccupancyMap
from vastflow.sim.mission import Mission
from vastflow.sim.nav.behaviour import REPLAN_TICKS
from vastflow.sim.nav.mapping import GLOBAL_TICKS, LOCAL_TICKS
from vastflow.sim.nav.parameters import NavParameters
from vastflow.sim.nav.state import SUBSTEPS, TICK_S
from vastflow.sim.octile import descend, distance_field, passable, path_xy_m
from vastflow.sim.pose import Pose
from vastflow.sim.prepared import prepare
from vastflow.sim.robot import Robot
from vastflow.sim.run import execute
from vastflow.sim.streams import run_entropy

CONTROLLERS: Final = ("rpp",)
MAP_SEED: Final = 20
WIDTH_M, HEIGHT_M, RESOLUTION_M = 100.0, 70.0, 0.05
ROUTE_M: Final = 20.0
ROUTES: Final = 5
TIMEOUT_S: Final = 180.0


def bench(controller: str = "rpp") -> dict[str, Any]:
    """Closed-loop speed over `ROUTES` routes of 20 m on the generated map, one core, kernels warm.

    The time counts everything a run costs but reading and preparing the map, which its runs share.

    Returns:
        `x_real_time` (simulated seconds per CPU second) and what it was measured with.

    Raises:
        ValueError: a controller this version does not have.
    """
    if controller not in CONTROLLERS:
        raise ValueError(f"controller: found {controller!r}; one of {', '.join(CONTROLLERS)}")
    occupancy = benchmark_map()
    parameters, lidar, robot = NavParameters(), Lidar(), Robot()
    prepared = prepare(occupancy, lidar, parameters)
    missions = benchmark_missions(occupancy)
    execute(prepared, parameters, lidar, robot, missions[0], (), run_entropy(MAP_SEED, "0", 0), TIMEOUT_S)
    simulated_s, reached = 0.0, 0
    began = time.process_time()
    for index, mission in enumerate(missions):
        outcome = execute(prepared, parameters, lidar, robot, mission, (), run_entropy(MAP_SEED, "0", index), TIMEOUT_S)
        simulated_s += outcome.run.simulated_s
        reached += outcome.run.outcome == "succeeded"
    cpu_s = time.process_time() - began
    return {
        "controller": controller,
        "x_real_time": round(simulated_s / cpu_s, 1),
        "simulated_s": round(simulated_s, 2),
        "cpu_s": round(cpu_s, 3),
        "runs": len(missions),
        "reached": reached,
        "map": {"width_m": WIDTH_M, "height_m": HEIGHT_M, "resolution_m": RESOLUTION_M, "seed": MAP_SEED},
        "route_m": ROUTE_M,
        "lidar": {"beams": lidar.beams, "rate_hz": lidar.rate_hz, "range_max_m": lidar.range_max_m},
        "rates_hz": {
            "physics": SUBSTEPS / TICK_S,
            "controller": 1 / TICK_S,
            "local_costmap": 1 / (TICK_S * LOCAL_TICKS),
            "global_costmap": 1 / (TICK_S * GLOBAL_TICKS),
            "planner": 1 / (TICK_S * REPLAN_TICKS),
        },
        "parameters": asdict(parameters),
    }


def benchmark_map() -> OccupancyMap:
    """The generated office floor, 100 m × 70 m: rooms of 5 to 9 m, a door in each wall, furniture."""
    rng = np.random.default_rng(MAP_SEED)
    rows, columns = round(HEIGHT_M / RESOLUTION_M), round(WIDTH_M / RESOLUTION_M)
    cells = np.full((rows, columns), FREE, dtype=np.int8)
    xs, ys = _wall_positions(columns, rng), _wall_positions(rows, rng)
    wall, door = round(0.15 / RESOLUTION_M), round(1.2 / RESOLUTION_M)
    for x in xs:
        cells[:, x : x + wall] = OCCUPIED
    for y in ys:
        cells[y : y + wall, :] = OCCUPIED
    for x in xs[1:-1]:
        for low, high in itertools.pairwise(ys):
            at = int(rng.integers(low + 2 * wall, high - door - wall))
            cells[at : at + door, x : x + wall] = FREE
    for y in ys[1:-1]:
        for low, high in itertools.pairwise(xs):
            at = int(rng.integers(low + 2 * wall, high - door - wall))
            cells[y : y + wall, at : at + door] = FREE
    for low_y, high_y in itertools.pairwise(ys):
        for low_x, high_x in itertools.pairwise(xs):
            size = rng.integers(6, 16, 2)
            y = int(rng.integers(low_y + wall + 30, high_y - 30 - size[0]))
            x = int(rng.integers(low_x + wall + 30, high_x - 30 - size[1]))
            cells[y : y + size[0], x : x + size[1]] = OCCUPIED
    return OccupancyMap(cells, RESOLUTION_M, (0.0, 0.0))


def benchmark_missions(occupancy: OccupancyMap) -> list[Mission]:
    """Routes of 20 m (octile) between free poses, drawn with the map's seed."""
    rng = np.random.default_rng(MAP_SEED)
    free = passable(occupancy, 0.4)
    cells = np.argwhere(free)
    missions: list[Mission] = []
    while len(missions) < ROUTES:
        row, column = cells[rng.integers(len(cells))]
        field = distance_field(free, int(row), int(column))
        goals = np.argwhere(np.abs(field * RESOLUTION_M - ROUTE_M) < RESOLUTION_M)
        if len(goals) == 0:
            continue
        goal = goals[rng.integers(len(goals))]
        way = path_xy_m(occupancy, descend(field, int(goal[0]), int(goal[1])))[::-1]
        heading = way[10] - way[0]
        yaw_rad = float(np.arctan2(heading[1], heading[0]))
        start, end = (Pose(float(x), float(y), yaw_rad) for x, y in (way[0], way[-1]))
        missions.append(Mission("navigate_to_pose", start, (end,)))
    return missions


def _wall_positions(cells: int, rng: np.random.Generator) -> list[int]:
    positions = [0]
    while positions[-1] + round(14.0 / RESOLUTION_M) < cells:
        positions.append(positions[-1] + int(rng.integers(round(5.0 / RESOLUTION_M), round(9.0 / RESOLUTION_M))))
    return [*positions, cells - round(0.15 / RESOLUTION_M)]
