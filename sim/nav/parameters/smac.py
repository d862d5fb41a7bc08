"""Parameters of the Smac planners. Nav2's default file loads none: all defaults are those of its code."""

from typing import Literal

from vastflow.sim.nav.parameters.parameter import ParameterGroup, parameter


class SmootherParameters(ParameterGroup):
    """The smoother of a Smac planner: meters a pass, passes, and weights.

    Attributes:
        w_data, w_smooth: How far a point goes in a pass toward where it was, and toward the middle of its neighbors.
    """

    tolerance: float = parameter(1e-10, 0.0, 1.0)
    max_iterations: int = parameter(1000, 0, 1_000_000)
    w_data: float = parameter(0.2, 0.0, 1.0)
    w_smooth: float = parameter(0.3, 0.0, 1.0)
    do_refinement: bool = parameter(True)
    refinement_num: int = parameter(2, 0, 100)


class SmacPlanner2D(ParameterGroup):
    """SmacPlanner2D: the tolerance in meters; iterations of 0 and less are without end, as in Nav2."""

    tolerance: float = parameter(0.125, 0.0, 100.0)
    allow_unknown: bool = parameter(True)
    max_iterations: int = parameter(1_000_000, -1, 1_000_000_000)
    max_on_approach_iterations: int = parameter(1000, -1, 1_000_000_000)
    cost_travel_multiplier: float = parameter(1.0, 0.0, 1000.0)
    smoother: SmootherParameters = SmootherParameters()


class SmacPlannerHybrid(ParameterGroup):
    """SmacPlannerHybrid: meters; penalties are factors, `change_penalty` is added to one.

    Attributes:
        lookup_table_size: Edge of the window round the goal in which the distance heuristic counts.
    """

    tolerance: float = parameter(0.25, 0.0, 100.0)
    allow_unknown: bool = parameter(True)
    max_iterations: int = parameter(1_000_000, -1, 1_000_000_000)
    max_on_approach_iterations: int = parameter(1000, -1, 1_000_000_000)
    smooth_path: bool = parameter(True)
    motion_model_for_search: Literal["DUBIN", "REEDS_SHEPP"] = parameter("DUBIN")
    angle_quantization_bins: int = parameter(72, 4, 720)
    minimum_turning_radius: float = parameter(0.4, 0.0, 100.0)
    allow_primitive_interpolation: bool = parameter(False)
    reverse_penalty: float = parameter(2.0, 1.0, 1000.0)
    change_penalty: float = parameter(0.0, 0.0, 1000.0)
    non_straight_penalty: float = parameter(1.2, 1.0, 1000.0)
    cost_penalty: float = parameter(2.0, 0.0, 1000.0)
    retrospective_penalty: float = parameter(0.015, 0.0, 0.5)
    analytic_expansion_ratio: float = parameter(3.5, 0.1, 1000.0)
    analytic_expansion_max_length: float = parameter(3.0, 0.0, 1000.0)
    analytic_expansion_max_cost: float = parameter(200.0, 0.0, 255.0)
    analytic_expansion_max_cost_override: bool = parameter(False)
    use_quadratic_cost_penalty: bool = parameter(False)
    downsample_obstacle_heuristic: bool = parameter(True)
    lookup_table_size: float = parameter(20.0, 0.1, 30.0)
    smoother: SmootherParameters = SmootherParameters()
