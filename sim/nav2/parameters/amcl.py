"""Parameters of AMCL, Nav2's localization."""

from typing import Any

from pydantic import model_validator

from vastflow.sim.model.parameter import ParameterGroup, choice, parameter


class AmclParameters(ParameterGroup):
    """Node `amcl`: lengths in meters, angles in radians.

    A `laser_max_range` of 0 or less stands for the scanner's own limit, as a `laser_min_range` below 0 does.

    Attributes:
        omni: Whether the motion model is OmniMotionModel, which alone has `alpha5`.
    """

    omni: bool = choice(
        False,
        "robot_model_type",
        {
            "nav2_amcl::DifferentialMotionModel": False,
            "nav2_amcl::OmniMotionModel": True,
            "differential": False,  # older releases
            "omnidirectional": True,
        },
    )
    min_particles: int = parameter(500, 0, 100_000, below=500)
    max_particles: int = parameter(2000, 1, 100_000, below=2000)
    pf_err: float = parameter(0.05, 1e-6, 1.0)
    pf_z: float = parameter(0.99, 0.0, 10.0)
    resample_interval: int = parameter(1, 1, 1_000_000, below=1)
    alpha1: float = parameter(0.2, 0.0, 100.0, least=0.0)
    alpha2: float = parameter(0.2, 0.0, 100.0, least=0.0)
    alpha3: float = parameter(0.2, 0.0, 100.0, least=0.0)
    alpha4: float = parameter(0.2, 0.0, 100.0, least=0.0)
    alpha5: float = parameter(0.2, 0.0, 100.0, least=0.0, needs=("omni", True, "the motion model is not Omni"))
    max_beams: int = parameter(60, 2, 100_000)
    laser_min_range: float = parameter(-1.0, -1e6, 1e6)
    laser_max_range: float = parameter(100.0, -1e6, 1e6)
    z_hit: float = parameter(0.5, 0.0, 1000.0)
    z_rand: float = parameter(0.5, 0.0, 1000.0)
    sigma_hit: float = parameter(0.2, 1e-3, 100.0)
    laser_likelihood_max_dist: float = parameter(2.0, 0.0, 100.0, below=2.0)
    update_min_d: float = parameter(0.25, -1000.0, 1000.0)
    update_min_a: float = parameter(0.2, -1000.0, 1000.0)

    @model_validator(mode="before")
    @classmethod
    def _numbers_agree(cls, values: dict[str, Any]) -> dict[str, Any]:
        """Raise the greatest number of particles to the least, as Nav2 does, and take its defaults for negative ones."""
        least, most = (values.get(name) for name in ("min_particles", "max_particles"))
        if not isinstance(least, int | float) or not isinstance(most, int | float):
            return values
        least = 500 if least < 0 else least
        return {**values, "min_particles": least, "max_particles": max(2000 if most < 0 else most, least)}
