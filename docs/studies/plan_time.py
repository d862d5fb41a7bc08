"""Measure the CPU time of a plan, for each planner between the same ends on the same costmaps.

    python docs/studies/plan_time.py [--map FILE.yaml] [--length M]

plans five paths of a length on the benchmark's floor of 100 m × 70 m, or on a map file, over the costmap of Nav2's default file without
marks. It prints milliseconds of the first plan to each goal and of the same plan again, which finds the distance heuristic's curves
known, and the lengths of the paths. NavFn floods without bounds there, as Nav2 does.
"""

import sys
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pandas as pd
from bench_show import loop_s
from bench_simulator import LARGE, benchmark_map, benchmark_routes
from missions import parser_of
from numpy.typing import NDArray

from vastflow.sim.kernels.binding import Bound
from vastflow.sim.kernels.numeric import njit
from vastflow.sim.model.pose import Pose
from vastflow.sim.nav2.costmaps.outline import outline_of
from vastflow.sim.nav2.navigator.kernels import with_kernels
from vastflow.sim.nav2.navigator.prepared import prepare
from vastflow.sim.nav2.parameters.servers import SmacPlanner2D, SmacPlannerHybrid
from vastflow.sim.nav2.parameters.stack import NavParameters
from vastflow.sim.nav2.planners.binding import compute_path, running
from vastflow.sim.nav2.planners.planner import PlannerInput, PlannerSetting
from vastflow.sim.world.map_file import load_map
from vastflow.sim.world.occupancy import OccupancyMap
from vastflow.sim.world.robot_model import Lidar
from vastflow.sim.world.world import World

sys.path.insert(0, str(Path(__file__).parents[2] / "tests" / "support"))
from navfn_paths import path

Plan = Callable[[Pose, Pose], NDArray[np.float64]]


@njit
def planned(planner: Bound, given: PlannerInput) -> int:
    return int(compute_path(planner, given))


def plans_of(occupancy: OccupancyMap) -> dict[str, Plan]:
    """A function per planner that plans a path (N, 2) in meters, empty without a path."""
    nav2 = NavParameters()
    costs = prepare(World(occupancy), Lidar(), nav2).planning.costs
    resolution_m, origin_xy_m = occupancy.resolution_m, occupancy.origin_xy_m
    setting = PlannerSetting(costs, costs, nav2.global_costmap, resolution_m, origin_xy_m)
    place, outline = np.array([*origin_xy_m, resolution_m]), outline_of(nav2.global_costmap)

    def navfn(*ends: Pose) -> NDArray[np.float64]:
        cells = (np.array([(at.x_m, at.y_m) for at in ends]) - origin_xy_m) / resolution_m
        start, goal = np.floor(cells + 0.5).astype(int).tolist()
        return path(costs, tuple(start), tuple(goal)) * resolution_m

    def searching(parameters: SmacPlanner2D | SmacPlannerHybrid) -> Plan:
        found = running(with_kernels(parameters), setting)

        def search(*ends: Pose) -> NDArray[np.float64]:
            start, goal = ((at.x_m, at.y_m, at.yaw_rad) for at in ends)
            given = PlannerInput(costs, place, outline, start, goal, np.zeros((16 * max(costs.shape), 3)))
            return np.asarray(given.path[: max(planned(found.bound, given), 0), :2])

        return search

    return {
        "NavFn": navfn,
        "SmacPlanner2D": searching(SmacPlanner2D()),
        "SmacPlannerHybrid, Dubins": searching(SmacPlannerHybrid()),
        "SmacPlannerHybrid, Reeds-Shepp": searching(SmacPlannerHybrid(motion_model_for_search="REEDS_SHEPP")),
    }


def timed(plan: Plan, start: Pose, goal: Pose) -> dict[str, float]:
    """CPU time of a plan and of the same again, and the path's length."""
    stamps, found = [time.process_time()], []
    for _ in range(2):
        found.append(plan(start, goal))
        stamps.append(time.process_time())
    first_ms, again_ms = 1e3 * np.diff(stamps)
    length_m = np.hypot(*np.diff(found[0], axis=0).T).sum() if len(found[0]) else np.nan
    return {"first, ms": first_ms, "again, ms": again_ms, "length, m": length_m}


def main() -> None:
    parser = parser_of(__doc__)
    parser.add_argument("--map", type=Path, metavar="FILE.yaml", help="in place of the benchmark's floor")
    parser.add_argument("--length", type=float, default=20.0, metavar="M", help="of the paths")
    options = parser.parse_args()
    occupancy = benchmark_map(LARGE) if options.map is None else load_map(options.map)
    ends = [(route.start, route.mission.goals[-1]) for route in benchmark_routes(occupancy, options.length)]
    print(f"{occupancy.shape} cells, {len(ends)} paths; the loop takes {loop_s():.3f} s", flush=True)
    rows = {}
    for name, plan in plans_of(occupancy).items():
        plan(*reversed(ends[0]))  # compiles
        found = pd.DataFrame([timed(plan, *each) for each in ends])
        rows[name] = {**found.median(), "worst, ms": found["first, ms"].max()}
    print(pd.DataFrame(rows).T.to_string(float_format="{:.1f}".format))


if __name__ == "__main__":
    main()
