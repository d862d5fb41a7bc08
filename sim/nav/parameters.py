"""Parameters of the navigation stack, under Nav2's own names, with the values of Nav2 Jazzy's default file."""

import itertools
import math
from collections.abc import Mapping
from dataclasses import dataclass, fields, replace
from typing import Final

from vastflow.sim.digest import Value

PREFIX: Final = "laserscan_"
"""Sensing perturbations are launch arguments of the paper's study, `laserscan_…`; the node's own names have no prefix."""


class ParameterError(ValueError):
    """A parameter whose value the stack can't use."""


@dataclass(frozen=True, slots=True)
class NavParameters:
    """What the stack in the loop is set to. Leaf names are Nav2's; a group's component is in its comment."""

    # The relay between the simulator's scan and Nav2 (paper's study): metres and a fraction 0..1.
    gaussian_noise_std_deviation: float = 0.0
    random_drop_percentage: float = 0.0
    # Costmaps. robot_radius in metres; cost_scaling_factor per metre.
    robot_radius: float = 0.22
    footprint_padding: float = 0.01
    inflation_radius: float = 0.70
    cost_scaling_factor: float = 3.0
    obstacle_max_range: float = 2.5
    raytrace_max_range: float = 3.0
    # Goal checker (m, rad) and progress checker (m, s).
    xy_goal_tolerance: float = 0.25
    yaw_goal_tolerance: float = 0.25
    required_movement_radius: float = 0.5
    movement_time_allowance: float = 10.0
    # NavFn (m).
    tolerance: float = 0.5
    allow_unknown: bool = True
    # Regulated Pure Pursuit (m, m/s, rad, s).
    desired_linear_vel: float = 0.5
    lookahead_dist: float = 0.6
    rotate_to_heading_angular_vel: float = 1.8
    rotate_to_heading_min_angle: float = 0.785
    max_angular_accel: float = 3.2
    min_approach_linear_velocity: float = 0.05
    approach_velocity_scaling_dist: float = 0.6
    regulated_linear_scaling_min_radius: float = 0.9
    regulated_linear_scaling_min_speed: float = 0.25
    cost_scaling_dist: float = 0.6
    cost_scaling_gain: float = 1.0
    max_allowed_time_to_collision_up_to_carrot: float = 1.0
    failure_tolerance: float = 0.3
    # AMCL.
    min_particles: int = 500
    max_particles: int = 2000
    pf_err: float = 0.05
    pf_z: float = 0.99
    alpha1: float = 0.2
    alpha2: float = 0.2
    alpha3: float = 0.2
    alpha4: float = 0.2
    max_beams: int = 60
    z_hit: float = 0.5
    z_rand: float = 0.5
    sigma_hit: float = 0.2
    laser_likelihood_max_dist: float = 2.0
    update_min_d: float = 0.25
    update_min_a: float = 0.2

    def __post_init__(self) -> None:
        for name, low, high in RANGES:
            value = getattr(self, name)
            if not low <= value <= high:
                raise ParameterError(f"{name} must lie in [{low:g}, {high:g}], got {value!r}")
        if self.min_particles > self.max_particles:
            raise ParameterError(f"min_particles {self.min_particles} must be <= max_particles {self.max_particles}")

    @property
    def inscribed_radius_m(self) -> float:
        """Radius of the circle inside the padded footprint.

        Nav2 makes a 16-gon of `robot_radius` and moves each vertex by the padding on x and on y, so the
        circle is not `robot_radius` itself (0.22 m gives 0.225498 m).
        """
        corners = [2 * math.pi * (k % 16) / 16 for k in range(17)]
        xs = [self._padded(self.robot_radius * math.cos(a)) for a in corners]
        ys = [self._padded(self.robot_radius * math.sin(a)) for a in corners]
        return min(
            abs(x0 * y1 - x1 * y0) / math.hypot(x1 - x0, y1 - y0)
            for (x0, y0), (x1, y1) in itertools.pairwise(zip(xs, ys, strict=True))
        )

    def _padded(self, coordinate_m: float) -> float:
        # sin π is 1.2e-16 and not 0, so a vertex on an axis moves off it, in Nav2 as here.
        return coordinate_m + (math.copysign(self.footprint_padding, coordinate_m) if coordinate_m != 0.0 else 0.0)


RANGES: Final[tuple[tuple[str, float, float], ...]] = (
    ("gaussian_noise_std_deviation", 0.0, 100.0),
    ("random_drop_percentage", 0.0, 1.0),
    ("robot_radius", 0.01, 10.0),
    ("footprint_padding", 0.0, 10.0),
    ("inflation_radius", 0.0, 3.0),
    ("cost_scaling_factor", 0.0, 1000.0),
    ("obstacle_max_range", 0.0, 1000.0),
    ("raytrace_max_range", 0.0, 1000.0),
    ("xy_goal_tolerance", 0.001, 100.0),
    ("yaw_goal_tolerance", 0.001, 7.0),
    ("required_movement_radius", 0.0, 100.0),
    ("movement_time_allowance", 0.1, 1e6),
    ("tolerance", 0.0, 100.0),
    ("desired_linear_vel", 0.01, 10.0),
    ("lookahead_dist", 0.05, 10.0),
    ("rotate_to_heading_angular_vel", 0.1, 10.0),
    ("rotate_to_heading_min_angle", 0.0, 3.15),
    ("max_angular_accel", 0.1, 100.0),
    ("min_approach_linear_velocity", 0.01, 10.0),
    ("approach_velocity_scaling_dist", 0.0, 10.0),
    ("regulated_linear_scaling_min_radius", 0.0, 100.0),
    ("regulated_linear_scaling_min_speed", 0.0, 10.0),
    ("cost_scaling_dist", 0.0, 10.0),
    ("cost_scaling_gain", 0.0, 1.0),
    ("max_allowed_time_to_collision_up_to_carrot", 0.0, 100.0),
    ("failure_tolerance", 0.0, 1e6),
    ("min_particles", 1, 100_000),
    ("max_particles", 1, 100_000),
    ("pf_err", 1e-6, 1.0),
    ("pf_z", 0.0, 10.0),
    ("alpha1", 0.0, 100.0),
    ("alpha2", 0.0, 100.0),
    ("alpha3", 0.0, 100.0),
    ("alpha4", 0.0, 100.0),
    ("max_beams", 2, 360),
    ("z_hit", 0.0, 1.0),
    ("z_rand", 0.0, 1.0),
    ("sigma_hit", 1e-3, 100.0),
    ("laser_likelihood_max_dist", 0.05, 100.0),
    ("update_min_d", 0.0, 100.0),
    ("update_min_a", 0.0, 7.0),
)


def parameters_of(system: Mapping[str, Value]) -> NavParameters:
    """The stack's parameters from the system dimension; keys it does not model are left to `unread`.

    Numbers may be written as text, as the paper's scenario files do.

    Raises:
        ParameterError: a value of the wrong type or out of range.
    """
    chosen: dict[str, bool | int | float] = {}
    types = {field.name: type(field.default) for field in fields(NavParameters)}
    for key, value in system.items():
        name = key.removeprefix(PREFIX)
        if name in types:
            chosen[name] = _read(name, value, types[name])
    return replace(NavParameters(), **chosen)  # type: ignore[arg-type]


def unread(system: Mapping[str, Value]) -> tuple[str, ...]:
    """Keys of the system dimension that nothing in the simulator reads, sorted."""
    known = {field.name for field in fields(NavParameters)}
    return tuple(sorted(key for key in system if key.removeprefix(PREFIX) not in known))


def _read(name: str, value: Value, kind: type) -> bool | int | float:
    if kind is bool:
        if isinstance(value, bool):
            return value
        raise ParameterError(f"{name} must be true or false, got {value!r}")
    try:
        number = float(value)  # type: ignore[arg-type]
    except (TypeError, ValueError):
        number = math.nan
    if isinstance(value, bool) or not math.isfinite(number) or (kind is int and number != int(number)):
        raise ParameterError(f"{name} must be {'a whole number' if kind is int else 'a number'}, got {value!r}")
    return int(number) if kind is int else number
