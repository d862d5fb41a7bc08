"""Measure the CPU time of a plan, for each planner between the same ends on the same costmaps.

    python tests/proofs/plan_time.py [--map FILE.yaml] [--length M]

plans five paths of a length on the benchmark's floor of 100 m × 70 m, or on a map file, over the costmap of Nav2's default file without
marks. It prints milliseconds of the first plan to each goal and of the same plan again, which finds the distance heuristic's curves
known, and the lengths of the paths. NavFn floods without bounds there, as Nav2 does.
"""

import argparse
import math
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import pandas as pd
from bench_simulator import LARGE, benchmark_map, benchmark_routes, reference_cpu_s
from navfn_paths import path
from numpy.typing import NDArray

from vastflow.sim.kernels.binding import Bound, Running
from vastflow.sim.kernels.numeric import njit
from vastflow.sim.model.pose import Pose
from vastflow.sim.nav2.costmaps.outline import outline_of
from vastflow.sim.nav2.navigator.prepared import prepare
from vastflow.sim.nav2.navigator.state import with_kernels
from vastflow.sim.nav2.parameters.servers import SmacPlanner2D, SmacPlannerHybrid
from vastflow.sim.nav2.parameters.stack import NavParameters
from vastflow.sim.nav2.planners.binding import compute_path, running
from vastflow.sim.nav2.planners.planner import Planner, PlannerInput, PlannerSetting
from vastflow.sim.world.map_file import load_map
from vastflow.sim.world.occupancy import OccupancyMap
from vastflow.sim.world.robot_model import Lidar

PLANNERS = {
    "SmacPlanner2D": SmacPlanner2D(),
    "SmacPlannerHybrid, Dubins": SmacPlannerHybrid(),
    "SmacPlannerHybrid, Reeds-Shepp": SmacPlannerHybrid(motion_model_for_search="REEDS_SHEPP"),
}

Ends = tuple[Pose, Pose]
Plan = Callable[[Pose, Pose], NDArray[np.float64]]


@njit
def planned(planner: Bound, given: PlannerInput) -> int:
    return int(compute_path(planner, given))


def plans_of(occupancy: OccupancyMap) -> Iterator[tuple[str, Plan]]:
    """Return a function per planner that plans a path (N, 2) in meters, empty without a path."""
    parameters = NavParameters()
    costs = prepare(occupancy, Lidar(), parameters).costs
    resolution_m, origin_m = occupancy.resolution_m, np.array(occupancy.origin_xy_m)

    def flood(start: Pose, goal: Pose) -> NDArray[np.float64]:
        cells = [
            np.floor((np.array([at.x_m, at.y_m]) - origin_m) / resolution_m + 0.5).astype(int) for at in (start, goal)
        ]
        return path(costs, tuple(cells[0].tolist()), tuple(cells[1].tolist())) * resolution_m

    yield "NavFn", flood
    place = np.array([*origin_m, resolution_m])
    outline = outline_of(parameters.global_costmap)
    setting = PlannerSetting(costs, costs, parameters.global_costmap, resolution_m, occupancy.origin_xy_m)
    for name, planner_parameters in PLANNERS.items():
        found = running(with_kernels(planner_parameters), setting)

        def search(start: Pose, goal: Pose, found: Running[Planner] = found) -> NDArray[np.float64]:
            ends = [(at.x_m, at.y_m, at.yaw_rad) for at in (start, goal)]
            given = PlannerInput(costs, place, outline, ends[0], ends[1], np.zeros((16 * max(costs.shape), 3)))
            return np.asarray(given.path[: max(planned(found.bound, given), 0), :2])

        yield name, search


def times_of(occupancy: OccupancyMap, ends: list[Ends]) -> pd.DataFrame:
    """CPU time of first and repeated plans, and lengths of paths, by planner: medians, and the worst."""
    rows = {}
    for name, plan in plans_of(occupancy):
        plan(*reversed(ends[0]))
        times = []
        for start, goal in ends:
            began = time.process_time()
            found = plan(start, goal)
            between = time.process_time()
            plan(start, goal)
            length_m = np.hypot(*np.diff(found, axis=0).T).sum() if len(found) else math.nan
            times.append((1e3 * (between - began), 1e3 * (time.process_time() - between), length_m))
        (first, again, length_m), worst = np.median(times, axis=0), np.max(times, axis=0)[0]
        rows[name] = {"first, ms": first, "again, ms": again, "worst, ms": worst, "length, m": length_m}
    return pd.DataFrame.from_dict(rows, orient="index")


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--map", type=Path, metavar="FILE.yaml", help="in place of the benchmark's floor")
    parser.add_argument("--length", type=float, default=20.0, metavar="M", help="of the paths")
    options = parser.parse_args()
    occupancy = benchmark_map(LARGE) if options.map is None else load_map(options.map)
    ends = [(route.start, route.mission.goals[-1]) for route in benchmark_routes(occupancy, options.length)]
    rows, columns = occupancy.shape
    loop_s = reference_cpu_s()
    print(
        f"{columns} x {rows} cells, {len(ends)} paths of {options.length:g} m; the loop takes {loop_s:.3f} s",
        flush=True,
    )
    print(times_of(occupancy, ends).to_string(float_format="{:.1f}".format))
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
