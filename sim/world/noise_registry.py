"""How lidar noise is found: by its name in the entry-point group, or in a file beside the campaign."""

from typing import Final

from vastflow.sim.plug_ins.registry import Registry
from vastflow.sim.world.noise import LidarNoise
from vastflow.sim.world.noise_parameters import GaussianDropoutParameters

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
