"""The pinned benchmark: closed loops in CPU time, with everything that could flatter it printed beside it.

    python docs/studies/bench_simulator.py --controller mppi|dwb|rpp [--json]

runs this file, as `python docs/studies/bench_simulator.py` does.
"""

import argparse
import itertools
import sys
import time
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np
from bench_show import loop_s, shown

from vastflow.sim.kernels.binding import Bound
from vastflow.sim.kernels.numeric import njit
from vastflow.sim.kernels.streams import run_entropy
from vastflow.sim.loop.closed_loop import ClosedLoop
from vastflow.sim.model.pose import Pose
from vastflow.sim.model.rates import TICK_S
from vastflow.sim.model.scenario import Mission
from vastflow.sim.nav2.controllers.local_plan import local_plan
from vastflow.sim.nav2.navigator.behavior import REPLAN_TICKS, controlled
from vastflow.sim.nav2.navigator.prepared import PreparedMap, prepare
from vastflow.sim.nav2.navigator.state import FOLLOWING, RUNNING, SUBSTEPS, Local
from vastflow.sim.nav2.navigator.state import Route as Plans
from vastflow.sim.nav2.parameter_files.plug_ins import find_controller, short_names
from vastflow.sim.nav2.parameters.stack import NavParameters
from vastflow.sim.world.occupancy import FREE, OCCUPIED, OccupancyMap
from vastflow.sim.world.octile import descend, distance_field, passable
from vastflow.sim.world.robot_model import Lidar, Robot
from vastflow.sim.world.world import World

sys.path.insert(0, str(Path(__file__).parents[2] / "tests" / "support"))
from driving import drive

MAP_SEED: Final = 20
RESOLUTION_M: Final = 0.05
ROUTES: Final = 5
TIMEOUT_S: Final = 180.0
MOMENT_TICKS: Final = 100
CALLS: Final = 100


@dataclass(frozen=True, slots=True)
class Floor:
    """A generated floor, and the length of the routes driven on it."""

    width_m: float
    height_m: float
    route_m: float


@dataclass(frozen=True, slots=True)
class Route:
    """A mission and where it begins."""

    start: Pose
    mission: Mission


LARGE: Final = Floor(100.0, 70.0, 20.0)
SMALL: Final = Floor(20.0, 20.0, 10.0)


def bench(controller: str = "mppi") -> dict[str, Any]:
    """Closed-loop speed over `ROUTES` routes on each generated floor, one core, kernels warm.

    The time counts everything a run costs but reading and preparing the map, which its runs share; what that costs, and what
    a run costs before its first tick, is given beside it.

    Returns:
        `x_real_time` (simulated seconds per CPU second) and what it was measured with: of the large floor, and of
        the small one under `small`; and under `control_cycle`, from a second drive over the large floor, what one call of the
        controller took: microseconds, and how many a core computes in a second.

    Raises:
        ValueError: a controller there is not.
    """
    if controller not in short_names():
        raise ValueError(f"controller: expected one of {', '.join(short_names())}, got {controller!r}")
    parameters, lidar = NavParameters(controller=find_controller(short_names()[controller])()), Lidar()
    large, small = _Course(LARGE, parameters), _Course(SMALL, parameters)
    measured = {"controller": controller, **large.measured(), "small": small.measured()}
    return measured | {
        "control_cycle": large.control_cycle(),
        "reference_cpu_s": round(loop_s(), 3),
        "lidar": {"beams": lidar.beams, "rate_hz": lidar.rate_hz, "range_max_m": lidar.range_max_m},
        "rates_hz": {
            "physics": SUBSTEPS / TICK_S,
            "controller": 1 / TICK_S,
            "local_costmap": parameters.local_costmap.update_frequency,
            "global_costmap": parameters.global_costmap.update_frequency,
            "planner": 1 / (TICK_S * REPLAN_TICKS),
        },
        "parameters": parameters.model_dump(),
    }


class _Course:
    """The routes of one floor, warm: its map is prepared and the kernels have run."""

    def __init__(self, floor: Floor, parameters: NavParameters) -> None:
        self.floor, self.parameters = floor, parameters
        occupancy = benchmark_map(floor)
        prepare(World(occupancy), Lidar(), parameters)  # kernels of the preparation are compiled here, and timed below
        began = time.process_time()
        self.prepared: PreparedMap = prepare(World(benchmark_map(floor)), Lidar(), parameters)
        self.preparation_s = time.process_time() - began
        self.routes = benchmark_routes(occupancy, floor.route_m)
        self.loop(0, self.routes[0]).advance()

    def loop(self, index: int, route: Route) -> ClosedLoop:
        entropy = run_entropy(MAP_SEED, "0", index)
        loop = ClosedLoop(self.prepared, self.parameters, Lidar(), Robot(), route.start, (), entropy, TIMEOUT_S)
        loop.localize(route.start)
        loop.navigate(route.mission)
        return loop

    def measured(self) -> dict[str, Any]:
        began = time.process_time()
        given = self.prepared, self.parameters, Lidar(), Robot()
        entropies = [run_entropy(MAP_SEED, "0", index) for index in range(ROUTES)]
        routes = [(route.start, route.mission) for route in self.routes]
        runs = [drive(*given, *route, (), each, TIMEOUT_S).run for route, each in zip(routes, entropies, strict=True)]
        cpu_s = time.process_time() - began
        simulated_s = sum(run.simulated_s for run in runs)
        began = time.process_time()
        for index, route in enumerate(self.routes):
            self.loop(index, route)
        start_s = (time.process_time() - began) / len(self.routes)
        return {
            "x_real_time": round(simulated_s / cpu_s, 1),
            "simulated_s": round(simulated_s, 2),
            "cpu_s": round(cpu_s, 3),
            "ms_per_simulated_s": round(1e3 * cpu_s / simulated_s, 3),
            "runs": len(runs),
            "reached": sum(run.outcome == "succeeded" for run in runs),
            "recoveries": sum(run.recoveries for run in runs),
            "contacts": sum(event.kind == "contact" for run in runs for event in run.events),
            "driven_m": round(sum(run.distance_m for run in runs), 1),
            "start_of_a_run_ms": round(1e3 * start_s, 2),
            "preparation_of_the_map_ms": round(1e3 * self.preparation_s, 1),
            "map": {**asdict(self.floor), "resolution_m": RESOLUTION_M, "seed": MAP_SEED},
            **self._counted(simulated_s),
        }

    def _counted(self, simulated_s: float) -> dict[str, Any]:
        """Repeat the runs tick by tick, untimed, and count what they did."""
        particles: list[int] = []
        floods = 0
        for index, route in enumerate(self.routes):
            loop = self.loop(index, route)
            m = loop.stack.m[0]
            updates = 0
            while loop.status == RUNNING and loop.tick < loop.last_tick:
                loop.advance(loop.tick + 1)
                if m["filter_updates"] > updates:
                    updates = int(m["filter_updates"])
                    particles.append(int(m["particles"]))
            floods += int(loop.stack.planner.memory.floods[0])
        return {
            "amcl_updates_per_s": round(len(particles) / simulated_s, 2),
            "amcl_particles_mean": round(float(np.mean(particles)), 1),
            "floods_per_s": round(floods / simulated_s, 3),
        }

    def control_cycle(self) -> dict[str, Any]:
        """One call of the controller, from local costmap and path to a command, at moments along the routes."""
        took_s, calls = 0.0, 0
        for index, route in enumerate(self.routes):
            loop = self.loop(index, route)
            while loop.status == RUNNING and loop.tick < loop.last_tick:
                loop.advance(loop.tick + MOMENT_TICKS)
                stack = loop.stack
                if stack.m[0]["state"] == FOLLOWING and stack.m[0]["path_n"] > 0:
                    given = stack.p, stack.m, stack.local, stack.route, stack.controller.bound
                    _control(*given)  # compiled, and its memory near, as in a run
                    began_s = time.process_time()
                    _control(*given)
                    took_s, calls = took_s + time.process_time() - began_s, calls + CALLS
        return {"us": round(1e6 * took_s / calls, 2), "per_s_and_core": round(calls / took_s)}


@njit
def _control(parameters: Any, memory: Any, local: Local, route: Plans, controller: Bound) -> None:
    p, m = parameters[0], memory[0]
    n, end_yaw = local_plan(p, m, local.window, route.path, route.ahead)
    for _ in range(CALLS):
        controlled(p, m, local, route, n, end_yaw, controller)


def benchmark_map(floor: Floor = LARGE) -> OccupancyMap:
    """The generated office floor: rooms of 5 to 9 m, a door in each wall, furniture."""
    rng = np.random.default_rng(MAP_SEED)
    rows, columns = round(floor.height_m / RESOLUTION_M), round(floor.width_m / RESOLUTION_M)
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


def benchmark_routes(occupancy: OccupancyMap, route_m: float = LARGE.route_m) -> list[Route]:
    """Routes of one length (octile) between free poses, drawn with the map's seed."""
    rng = np.random.default_rng(MAP_SEED)
    free = passable(occupancy, 0.4)
    cells = np.argwhere(free)
    routes: list[Route] = []
    while len(routes) < ROUTES:
        row, column = cells[rng.integers(len(cells))]
        field = distance_field(free, int(row), int(column), (route_m + 1.0) / RESOLUTION_M)
        goals = np.argwhere(np.abs(field * RESOLUTION_M - route_m) < RESOLUTION_M)
        if len(goals) == 0:
            continue
        goal = goals[rng.integers(len(goals))]
        way = occupancy.centers_of(descend(field, int(goal[0]), int(goal[1])))[::-1]
        heading = way[10] - way[0]
        yaw_rad = float(np.arctan2(heading[1], heading[0]))
        start, end = (Pose(float(x), float(y), yaw_rad) for x, y in (way[0], way[-1]))
        routes.append(Route(start, Mission("navigate_to_pose", (end,))))
    return routes


def _wall_positions(cells: int, rng: np.random.Generator) -> list[int]:
    positions = [0]
    while positions[-1] + round(14.0 / RESOLUTION_M) < cells:
        positions.append(positions[-1] + int(rng.integers(round(5.0 / RESOLUTION_M), round(9.0 / RESOLUTION_M))))
    return [*positions, cells - round(0.15 / RESOLUTION_M)]


def main() -> None:
    """Print what was measured."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--controller", default="mppi")
    parser.add_argument("--json", action="store_true")
    asked = parser.parse_args()
    try:
        found = bench(asked.controller)
    except ValueError as error:
        print(f"bench_simulator.py: {error}", file=sys.stderr)
        sys.exit(2)
    print(shown(found, as_json=asked.json))


if __name__ == "__main__":
    main()
