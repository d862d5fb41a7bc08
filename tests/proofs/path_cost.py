"""Compare the cost of paths in use with fresh NavFn paths, on the paper's five maps.

RPP drives random paths of each map with nothing in the way, with boxes that the map has not, and with a noisy scan. At every
replanning the cost of the path now in use, the integral of NavFn's costs along it on the global costmap of that tick, is
compared with that of the path that `navfn_paths.path` finds from the robot to the same goal on the same costs: as
Nav2 does, it floods from the robot until the goal is reached, and walks back from there.

Prints a table with a line for each map and condition: replannings, relative excess (median, 95th percentile, maximum), and
the share of replannings above 1 %. Exit code 1 when a line's 95th percentile is above 1 % or a maximum above 5 %; 2 when the
maps are not there.

    python tests/proofs/path_cost.py [--maps DIR] [--only NAME] [--length M] [--paths N] [--runs N] [--controller mppi|dwb|rpp]
"""

import math
import time
from collections.abc import Iterator
from pathlib import Path

import five_maps
import numpy as np
from navfn_paths import path
from numpy.typing import NDArray
from scipy.ndimage import map_coordinates

from vastflow.producers.instantiation.instantiate import Instantiation
from vastflow.sim.model.rates import TICK_S
from vastflow.sim.model.scenario import Scenario
from vastflow.sim.nav2.navigator.behavior import REPLAN_TICKS
from vastflow.sim.nav2.navigator.state import Stack
from vastflow.sim.nav2.planners.navfn import travel_costs
from vastflow.sim.run import run

STEP_CELLS = 0.1
TOLERANCE = 0.01
WORST = 0.05

BOX = {"amount_per_m": [0.4], "max_distance": 0.6, "model": "box", "xacro_arguments": "width:=0.4, length:=0.4"}
BOXES = {"name": "static_objects", "obstacle_configs": [BOX], "robot_diameter": 0.6, "seed": 7}
CONDITIONS = {"nothing else": (0.0, []), "boxes": (0.0, [{"ObstacleVariation": BOXES}]), "noise 0.1 m": (0.1, [])}
HEADER = f"{'map':12}{'condition':16}{'runs':>6}{'replans':>9}{'median':>9}{'95 %':>9}{'max':>9}{'> 1 %':>9}{'min':>9}"


def instantiated(map_file: Path, condition: str, length_m: float, paths: int, controller: str = "rpp") -> Instantiation:
    """The map's configurations of a condition."""
    noise_m, more = CONDITIONS[condition]
    path = {"path_length": length_m, "path_length_tolerance": 1.0, "num_paths": paths}
    noise = {"laserscan_gaussian_noise_std_deviation": noise_m}
    return five_maps.instantiated(map_file, controller, path, noise, more)


def cost_along(way_cells: NDArray[np.float64], travel: NDArray[np.uint8]) -> float:
    """Integrate travel costs (H, W) along a path (N, 2) of (x, y) in cells, interpolated linearly."""
    steps = np.hypot(*np.diff(way_cells, axis=0).T)
    along = np.r_[0.0, np.cumsum(steps)]
    at = np.arange(0.5 * STEP_CELLS, along[-1], STEP_CELLS)
    x, y = (np.interp(at, along, way_cells[:, k]) for k in range(2))
    costs = map_coordinates(travel.astype(np.float64), (y, x), order=1, mode="nearest")
    return float(costs.sum()) * STEP_CELLS


def excess(stack: Stack) -> float:
    """Return the excess cost of the path in use over a fresh one, or NaN without one."""
    m, p, grids = stack.m[0], stack.p[0], stack.grids
    origin, resolution_m = np.array([p["origin_x"], p["origin_y"]]), float(p["resolution"])
    robot, goal = (
        tuple(np.floor((np.array([m[x], m[y]]) - origin) / resolution_m + 0.5).astype(int).tolist())
        for x, y in (("x", "y"), ("goal_x", "goal_y"))
    )
    fresh = path(grids.costs, robot, goal)
    if len(fresh) < 2:
        return float("nan")
    travel = travel_costs(grids.costs)
    used = (stack.route.path[: int(m["path_n"]), :2] - origin) / resolution_m
    return cost_along(used, travel) / cost_along(ended(fresh, used[-1]), travel) - 1.0


def ended(way_cells: NDArray[np.float64], goal: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the path with the goal at its end, as Nav2's planner puts it."""
    replaced = math.dist(way_cells[-1], way_cells[-2]) > math.dist(goal, way_cells[-2])
    return np.vstack([way_cells[:-1] if replaced else way_cells, goal])


def excesses(scenario: Scenario, run_index: int) -> NDArray[np.float64]:
    """Comparisons of one run, one at each replanning."""
    found: list[float] = []

    def look(stack: Stack, tick: int) -> None:
        m = stack.m[0]
        if m["replan_in"] == REPLAN_TICKS - 1 and m["path_n"] > 1:
            found.append(excess(stack))

    run(scenario, run_index, watch=look, watch_ticks=range(round(scenario.timeout_s / TICK_S)))
    return np.array(found)


def measured(
    map_file: Path, length_m: float, paths: int, runs: int, controller: str
) -> Iterator[tuple[str, int, NDArray[np.float64]]]:
    """Each condition, how many runs, and their excesses."""
    for condition in CONDITIONS:
        configurations = instantiated(map_file, condition, length_m, paths, controller).configurations
        found = [excesses(c.scenario, run_index) for c in configurations for run_index in range(runs)]
        if found:
            together = np.concatenate(found)
            yield condition, len(found), together[np.isfinite(together)]


def line(name: str, condition: str, runs: int, values: NDArray[np.float64]) -> str:
    parts = np.median(values), np.percentile(values, 95), values.max(), (values > TOLERANCE).mean(), values.min()
    return f"{name:12}{condition:16}{runs:6}{len(values):9}" + "".join(f"{100 * part:8.2f}%" for part in parts)


def main() -> int:
    parser = five_maps.parser_of(__doc__)
    parser.add_argument("--controller", choices=("mppi", "dwb", "rpp"), default="rpp")
    parser.add_argument("--length", type=float, default=14.0, metavar="M", help="of the paths")
    parser.add_argument("--paths", type=int, default=5, metavar="N", help="paths a map")
    parser.add_argument("--runs", type=int, default=1, metavar="N", help="runs a path")
    options = parser.parse_args()
    files = five_maps.map_files(options.maps, options.only)
    print(HEADER)
    good = True
    for file in files:
        began = time.process_time()
        for condition, runs, values in measured(file, options.length, options.paths, options.runs, options.controller):
            print(line(file.stem, condition, runs, values), flush=True)
            good = good and bool(np.percentile(values, 95) <= TOLERANCE and values.max() <= WORST)
        print(f"{file.stem}: {time.process_time() - began:.0f} s CPU", flush=True)
    return (0 if good else 1) if files else 2


if __name__ == "__main__":
    raise SystemExit(main())
