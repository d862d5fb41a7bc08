"""The seam between the loop and a planner that searches: machine code that is called by its address.

The loop is compiled once, with NavFn in it, and knows of no other planner but where its kernel lies.
"""

import functools
from typing import Any, Final, NamedTuple

import numba
import numpy as np
from numba import types
from numba.extending import intrinsic
from numpy.typing import NDArray

from vastflow.sim.kernels.calls import called, machine_code_of
from vastflow.sim.kernels.numeric import inner
from vastflow.sim.kernels.record import record_of
from vastflow.sim.model.polygon import vertices_of
from vastflow.sim.nav2.costmaps.inflation import cost_at_distance
from vastflow.sim.nav2.costmaps.outline import circumscribed_radius_m, inscribed_radius_m, outline_of
from vastflow.sim.nav2.parameters.costmap import Costmap
from vastflow.sim.nav2.parameters.servers import NavFn, SmacPlanner2D, SmacPlannerHybrid, SmootherParameters
from vastflow.sim.nav2.planners import smac_2d, smac_hybrid
from vastflow.sim.nav2.planners.search import PlannerInput, Search, new_distances

_ENDLESS: Final = 1 << 40
_NAVFN: Final = 0


class Planner(NamedTuple):
    """A planner as the loop has it.

    Attributes:
        kernel: (1,) int64, where its machine code begins; 0 for NavFn, which is part of the loop.
        search: (1,) record of `Search`.
        distances: See `vastflow.sim.nav2.planners.search.new_distances`. What a run adds to it other runs find, and would have
            computed alike.
    """

    kernel: Any
    search: Any
    distances: Any


def planner_of(
    parameters: NavFn | SmacPlanner2D | SmacPlannerHybrid,
    costmap: Costmap,
    resolution_m: float,
    origin_xy_m: tuple[float, float],
) -> Planner:
    """The planner with these parameters on a map, its kernel compiled.

    Args:
        costmap: The global one.
    """
    search = search_of(parameters, costmap, resolution_m, origin_xy_m)
    record = record_of(search)
    distances = _distances(search.table, search.bins, search.radius, search.reverses)
    if isinstance(parameters, NavFn):
        return Planner(np.array([_NAVFN], dtype=np.int64), record, distances)
    kernel = smac_2d.compute_path if isinstance(parameters, SmacPlanner2D) else smac_hybrid.compute_path
    kinds = numba.typeof(record).dtype, numba.typeof(distances), _GIVEN
    return Planner(np.array([machine_code_of(kernel, kinds)], dtype=np.int64), record, distances)


@functools.lru_cache(maxsize=4)
def _distances(table: int, bins: int, radius: float, reverses: bool) -> NDArray[np.float32]:
    """Those of one curve, shared by the runs of a process: an empty place is filled by whoever comes first."""
    return new_distances(table, bins)


def search_of(
    parameters: NavFn | SmacPlanner2D | SmacPlannerHybrid,
    costmap: Costmap,
    resolution_m: float,
    origin_xy_m: tuple[float, float],
) -> Search:
    """What a planner's parameters are in cells of a map."""
    q = SmacPlanner2D() if isinstance(parameters, NavFn) else parameters
    common: dict[str, Any] = {
        "resolution": resolution_m,
        "origin_x": origin_xy_m[0],
        "origin_y": origin_xy_m[1],
        "tolerance": q.tolerance / resolution_m,
        "allow_unknown": q.allow_unknown,
        "max_iterations": _end(q.max_iterations),
        "max_on_approach_iterations": _end(q.max_on_approach_iterations),
        **_smoothing(q.smoother),
    }
    if isinstance(q, SmacPlanner2D):
        return Search(**common, cost_penalty=q.cost_travel_multiplier)
    outline, layer = outline_of(costmap), costmap.inflation_layer
    farthest_m, nearest_m = circumscribed_radius_m(outline), inscribed_radius_m(outline)
    edge = int(q.lookup_table_size / resolution_m)
    if not q.smooth_path:
        common["smoother_iterations"] = 0
    return Search(
        **common,
        cost_penalty=q.cost_penalty,
        polygon=bool(vertices_of(costmap.footprint)),
        circumscribed_cost=cost_at_distance(farthest_m, nearest_m, layer.cost_scaling_factor) if layer.enabled else 0.0,
        bins=q.angle_quantization_bins,
        radius=max(q.minimum_turning_radius / resolution_m, 1.0),
        reverses=q.motion_model_for_search == "REEDS_SHEPP",
        interpolates=q.allow_primitive_interpolation,
        change_penalty=q.change_penalty,
        non_straight_penalty=q.non_straight_penalty,
        reverse_penalty=q.reverse_penalty,
        travel_distance_reward=1.0 - q.retrospective_penalty,
        quadratic=q.use_quadratic_cost_penalty,
        halves=q.downsample_obstacle_heuristic,
        expansion_ratio=q.analytic_expansion_ratio,
        expansion_length=q.analytic_expansion_max_length / resolution_m,
        expansion_cost=q.analytic_expansion_max_cost,
        expansion_override=q.analytic_expansion_max_cost_override,
        table=edge + 1 - edge % 2,
    )


def _smoothing(q: SmootherParameters) -> dict[str, Any]:
    return {
        "smoother_tolerance": q.tolerance,
        "smoother_iterations": q.max_iterations,
        "w_data": q.w_data,
        "w_smooth": q.w_smooth,
        "refinements": q.refinement_num if q.do_refinement else 0,
    }


def _end(iterations: int) -> int:
    return iterations if iterations > 0 else _ENDLESS


def _example() -> PlannerInput:
    pose = (0.0, 0.0, 0.0)
    return PlannerInput(np.zeros((1, 1), dtype=np.uint8), np.zeros(3), np.zeros((1, 2)), pose, pose, np.zeros((1, 3)))


_GIVEN: Final = numba.typeof(_example())


@inner
def searches(planner: Planner) -> bool:
    """Whether it is another one than NavFn."""
    return bool(planner.kernel[0] != _NAVFN)


@inner
def compute_path(planner: Planner, given: PlannerInput) -> int:
    """The number of points that `given.path` begins with then; minus an error code where there is no path."""
    return int(_call(planner.kernel[0], planner.search[0], planner.distances, given))


@intrinsic
def _call(typing: Any, kernel: Any, search: Any, distances: Any, given: Any) -> Any:
    def lowered(context: Any, builder: Any, call: Any, values: Any) -> Any:
        return called(context, builder, types.int64, (search, distances, given), values[0], values[1:])

    return types.int64(types.int64, search, distances, given), lowered
