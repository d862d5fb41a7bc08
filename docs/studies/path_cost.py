"""Compare the cost of paths in use with fresh NavFn paths, on the paper's five maps.

RPP drives random paths of each map with nothing in the way, with boxes that the map has not, and with a noisy scan. At every
replanning the cost of the path now in use, the integral of NavFn's costs along it on the global costmap of that tick, is
compared with that of the path that `navfn_paths.path` finds from the robot to the same goal on the same costs: as
Nav2 does, it floods from the robot until the goal is reached, and walks back from there.

Prints a table with a line for each map and condition: replannings, relative excess in percent (median, 95th percentile, maximum), and
the replannings above 1 %. Exit code 1 when a line's 95th percentile is above 1 % or a maximum above 5 %; 2 when the
maps are not there.

    python docs/studies/path_cost.py [--maps DIR] [--only NAME] [--length M] [--paths N] [--runs N] [--controller mppi|dwb|rpp]
"""

import math
import sys
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
import pandas as pd
from missions import map_files, map_parser, random_paths, written
from numpy.typing import NDArray
from scipy.ndimage import map_coordinates

from vastflow.producers.campaign import load_campaign
from vastflow.producers.instantiation.instantiate import Instantiation, instantiate
from vastflow.sim.model.rates import TICK_S
from vastflow.sim.model.scenario import Scenario
from vastflow.sim.nav2.navigator.behavior import REPLAN_TICKS
from vastflow.sim.nav2.navigator.state import Stack
from vastflow.sim.nav2.planners.navfn import travel_costs
from vastflow.sim.run import run

sys.path.insert(0, str(Path(__file__).parents[2] / "tests" / "support"))
from navfn_paths import path

STEP_CELLS = 0.1
TOLERANCE = 0.01
WORST = 0.05

BOX = {"amount_per_m": [0.4], "max_distance": 0.6, "model": "box", "xacro_arguments": "width:=0.4, length:=0.4"}
BOXES = {"name": "static_objects", "obstacle_configs": [BOX], "robot_diameter": 0.6, "seed": 7}
CONDITIONS = {"nothing else": (0.0, []), "boxes": (0.0, [{"ObstacleVariation": BOXES}]), "noise 0.1 m": (0.1, [])}


def instantiated(map_file: Path, condition: str, length_m: float, paths: int, controller: str = "rpp") -> Instantiation:
    """The map's configurations of a condition."""
    noise_m, more = CONDITIONS[condition]
    path = {"path_length": length_m, "path_length_tolerance": 1.0, "num_paths": paths}
    noise = {"laserscan_gaussian_noise_std_deviation": noise_m}
    with TemporaryDirectory() as folder:
        family = random_paths(map_file, controller, path, noise, more)
        return instantiate(load_campaign(written(Path(folder), configuration=[family])))


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


def row_of(map_name: str, condition: str, runs: list[NDArray[np.float64]]) -> dict[str, str | float]:
    """A row of the table, in percent, from the comparisons of each run."""
    values = 100 * np.concatenate(runs)
    values = values[np.isfinite(values)]
    row = {"map": map_name, "in the way": condition, "runs": len(runs), "replannings": len(values)}
    row |= {"median": np.median(values), "95 %": np.percentile(values, 95), "greatest": values.max()}
    return row | {"above 1 %": (values > 100 * TOLERANCE).sum(), "least": values.min()}


def main() -> int:
    parser = map_parser(__doc__)
    parser.add_argument("--controller", choices=("mppi", "dwb", "rpp"), default="rpp")
    parser.add_argument("--length", type=float, default=14.0, metavar="M", help="of the paths")
    parser.add_argument("--paths", type=int, default=5, metavar="N", help="paths a map")
    parser.add_argument("--runs", type=int, default=1, metavar="N", help="runs a path")
    options = parser.parse_args()
    good = True
    for file in map_files(options.maps, options.only):
        rows = []
        for condition in CONDITIONS:
            found = instantiated(file, condition, options.length, options.paths, options.controller).configurations
            runs = [excesses(each.scenario, run_index) for each in found for run_index in range(options.runs)]
            rows += [row_of(file.stem, condition, runs)] if runs else []
        table = pd.DataFrame(rows)
        print(table.to_string(index=False, float_format="{:.2f}".format), flush=True)
        good &= bool(((table["95 %"] <= 100 * TOLERANCE) & (table["greatest"] <= 100 * WORST)).all())
    return 0 if good else 1


if __name__ == "__main__":
    raise SystemExit(main())
