"""Parameters of Regulated Pure Pursuit, with the defaults of Nav2's code, as no default file loads it."""

from typing import Any

from pydantic import model_validator

from vastflow.sim.model.parameter import ParameterGroup, parameter


class RppParameters(ParameterGroup):
    """nav2_regulated_pure_pursuit_controller of Jazzy: meters, seconds, radians."""

    desired_linear_vel: float = parameter(0.5, 0.0, 10.0)
    lookahead_dist: float = parameter(0.6, 0.05, 10.0)
    min_lookahead_dist: float = parameter(0.3, 0.0, 10.0)
    max_lookahead_dist: float = parameter(0.9, 0.0, 10.0)
    lookahead_time: float = parameter(1.5, 0.0, 100.0, below=0.0)
    use_velocity_scaled_lookahead_dist: bool = parameter(False)
    use_fixed_curvature_lookahead: bool = parameter(False)
    curvature_lookahead_dist: float = parameter(0.6, 0.05, 10.0)
    use_rotate_to_heading: bool = parameter(True)
    rotate_to_heading_min_angle: float = parameter(0.785, -1000.0, 1000.0)
    rotate_to_heading_angular_vel: float = parameter(1.8, -100.0, 100.0)
    max_angular_accel: float = parameter(3.2, 0.0, 100.0)
    stateful: bool = parameter(True)
    allow_reversing: bool = parameter(False)
    use_regulated_linear_velocity_scaling: bool = parameter(True)
    regulated_linear_scaling_min_radius: float = parameter(0.9, 0.0, 100.0, below=0.0)
    regulated_linear_scaling_min_speed: float = parameter(0.25, -10.0, 10.0)
    use_cost_regulated_linear_velocity_scaling: bool = parameter(True)
    cost_scaling_dist: float = parameter(0.6, 0.0, 10.0, below=0.0)
    cost_scaling_gain: float = parameter(1.0, 0.0, 100.0)
    inflation_cost_scaling_factor: float = parameter(3.0, -1e6, 1e6)
    min_approach_linear_velocity: float = parameter(0.05, -10.0, 10.0)
    approach_velocity_scaling_dist: float = parameter(0.6, 0.0, 10.0, below=0.0)
    use_collision_detection: bool = parameter(True)
    max_allowed_time_to_collision_up_to_carrot: float = parameter(1.0, 0.0, 100.0, below=0.0)

    @model_validator(mode="before")
    @classmethod
    def _scaled_by_cost(cls, values: dict[str, Any]) -> dict[str, Any]:
        """Scale no speed by cost without a factor, as Nav2 does."""
        factor = values.get("inflation_cost_scaling_factor", 1.0)
        is_off = isinstance(factor, int | float) and factor <= 0.0
        return {**values, "use_cost_regulated_linear_velocity_scaling": False} if is_off else values
