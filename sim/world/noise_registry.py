"""Lidar noise by name, from the entry-point group or a file next to the campaign; needs no numba."""

from typing import Final

from vastflow.sim.model.parameter import ParameterGroup, parameter
from vastflow.sim.plug_ins.registry import Registry
from vastflow.sim.world.noise import LidarNoise


class GaussianDropoutParameters(ParameterGroup):
    """Noise of the paper's relay between simulator and Nav2, under the names of its launch arguments.

    Attributes:
        laserscan_gaussian_noise_std_deviation: Standard deviation of each beam's range (m).
        laserscan_random_drop_percentage: Share of beams lost, a fraction 0..1 in spite of its name.
    """

    laserscan_gaussian_noise_std_deviation: float = parameter(0.0, 0.0, 100.0)
    laserscan_random_drop_percentage: float = parameter(0.0, 0.0, 1.0)


NOISE_PLUG_INS: Final = Registry(
    "vastflow.lidar_noise",
    "lidar noise model",
    LidarNoise,
    "campaign file",
    {"vastflow.sim.world.gaussian_dropout:GaussianDropout": GaussianDropoutParameters},
)
GAUSSIAN_DROPOUT: Final = "gaussian_dropout"
"""The model of a campaign that names none."""

find_lidar_noise = NOISE_PLUG_INS.find
