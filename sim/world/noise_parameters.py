"""Parameters of lidar noise that stand apart from its kernel: a campaign is read without numba."""

from vastflow.sim.model.parameter import ParameterGroup, parameter


class GaussianDropoutParameters(ParameterGroup):
    """The noise of the paper's relay between simulator and Nav2, under the names of its launch arguments.

    Attributes:
        laserscan_gaussian_noise_std_deviation: Of every beam, meters.
        laserscan_random_drop_percentage: Share of beams lost, a fraction 0..1 in spite of its name.
    """

    laserscan_gaussian_noise_std_deviation: float = parameter(0.0, 0.0, 100.0)
    laserscan_random_drop_percentage: float = parameter(0.0, 0.0, 1.0)
