"""Tests that pin the bytes of a short run of each controller and planner.

Bytes are promised within a numeric class. Elsewhere a run may differ, and is skipped if it does.
"""

from collections.abc import Mapping
from typing import Any, Final

import numpy as np
import pytest
from table import each_row

from vastflow.sim.loop.drive import drive
from vastflow.sim.model.pose import Pose
from vastflow.sim.model.scenario import Mission
from vastflow.sim.nav2.navigator.prepared import prepare
from vastflow.sim.nav2.parameter_files.chosen import parameters_of
from vastflow.sim.nav2.parameters.servers import RotationShim, SmacPlanner2D, SmacPlannerHybrid
from vastflow.sim.nav2.parameters.stack import NavParameters
from vastflow.sim.reading.robot import robot_of
from vastflow.sim.world.occupancy import OccupancyMap
from vastflow.sim.world.robot_model import Lidar
from vastflow.tasks.keys.keys import numeric_class

PINNED_ON: Final = "x86_64; glibc 2.36; avx2 fma; ; 3.11"
DURATION_S: Final = 8.0
NOISE: Final = {"laserscan_gaussian_noise_std_deviation": 0.02, "odometry_noise_std_deviation": 0.02}
RECTANGLE: Final = {"footprint": "[[0.3, 0.2], [0.3, -0.2], [-0.3, -0.2], [-0.3, 0.2]]"}
ON: Final = {"enabled": True}
OFF: Final = {"enabled": False}
FORWARD: Final = {**ON, "theta_scale": 1.0}
OMNI: Final = {
    "FollowPath.motion_model": "Omni",
    "robot_model_type": "nav2_amcl::OmniMotionModel",
    "min_y_velocity_threshold": 0.001,
    "max_velocity": [0.5, 0.5, 2.0],
    "min_velocity": [-0.5, -0.5, -2.0],
    "max_accel": [2.5, 2.5, 3.2],
    "max_decel": [-2.5, -2.5, -3.2],
}


def stack(system: Mapping[str, Any] | None = None, **parts: Any) -> NavParameters:
    return parameters_of({**NOISE, **(system or {})}).with_values(**parts)


def with_critics(name: str, **changed: Any) -> NavParameters:
    """The stack of a controller with other values of some critics."""
    found = stack({"controller": name})
    critics = {critic: getattr(found.controller, critic).with_values(**values) for critic, values in changed.items()}
    return found.with_values(controller=found.controller.with_values(**critics))


STACKS: Final = {
    "MPPI DiffDrive": stack(),
    "MPPI Omni": stack(OMNI),
    "MPPI Ackermann": stack(
        {"FollowPath.motion_model": "Ackermann", "FollowPath.AckermannConstraints.min_turning_r": 0.4}
    ),
    "MPPI consider_footprint": stack({**RECTANGLE, "FollowPath.CostCritic.consider_footprint": True}),
    "MPPI ObstaclesCritic": with_critics("mppi", CostCritic=OFF, ObstaclesCritic=ON),
    "MPPI all critics": with_critics("mppi", TwirlingCritic=ON, VelocityDeadbandCritic=ON),
    "DWB": stack({"controller": "dwb"}),
    "DWB ObstacleFootprint": with_critics("dwb", ObstacleFootprint={**ON, "scale": 0.02}),
    "DWB other critics": with_critics("dwb", BaseObstacle={"sum_scores": True}, PreferForward=FORWARD, Twirling=ON),
    "RPP": stack({"controller": "rpp"}),
    "Rotation Shim": stack({"controller": "dwb"}, rotation_shim=RotationShim(enabled=True)),
    "NavFn A*": stack({"controller": "rpp", "GridBased.use_astar": True}),
    "SmacPlanner2D": stack({"controller": "rpp"}, planner=SmacPlanner2D()),
    "SmacPlannerHybrid Dubins": stack({"controller": "rpp"}, planner=SmacPlannerHybrid()),
    "SmacPlannerHybrid Reeds-Shepp": stack(
        {"controller": "rpp"}, planner=SmacPlannerHybrid(motion_model_for_search="REEDS_SHEPP")
    ),
    "latency": stack({"robot.latency.preset": "loaded"}),
}
DIGESTS: Final[Mapping[str, str]] = {
    "MPPI DiffDrive": "1381dc03fce4fad29b100389f17364424b7d00edb481ec2f81ce79a2e1d295db",
    "MPPI Omni": "fa0f67f990a7bfac6d3b799f046ffe74ad72385931284d9685f23913c0c74ee4",
    "MPPI Ackermann": "1c6013202a56026ca774d2691f4dfd3cd9812b6593265cd92a5cb738a7109ba9",
    "MPPI consider_footprint": "d9ce091f81e974f8c2274df1ae860efb79901461499b5659858cfacbef792edd",
    "MPPI ObstaclesCritic": "0cbaecc260385f5cfc46350f331276997234a59eeed1b09d20905ef2256021fe",
    "MPPI all critics": "2400c551292cc6d25ad091bd46335a118b07799eda777e9912209c521aabc604",
    "DWB": "88db47bb36f017aa916e476f51e1c5739d2b175b31c0fe54ab6e3ccfc02781fd",
    "DWB ObstacleFootprint": "af40ebc83c031a5b832b4e90465913fac7c326abe5fcfc45e84a69b61c52cd39",
    "DWB other critics": "ac408c587dc6e8eac8e64e0f11036f0923fde55a1c7e8d185b0d4dec2a26b427",
    "RPP": "7fd5ed02f6c67e73c6a7f88b1517fe0b771338d04b374598e5c6be5dd6249396",
    "Rotation Shim": "f045b79d95311026bcb8e26e6bea7e413a513b34c51c0fb91dd798c19153ef83",
    "NavFn A*": "423285ae4d1bf469d0200cd16a231ed93a25e20d5efc438921d29b455dfb6d47",
    "SmacPlanner2D": "50927b10d950eb2cfae3dd702b99b9d320f224ca036e97cb150619df042fd880",
    "SmacPlannerHybrid Dubins": "2e1af15eec00ba3294ca0bea90f4b041e60debfb2c722588c077188db25402bd",
    "SmacPlannerHybrid Reeds-Shepp": "fe381a102bde68f7a99d2c499b4630eced328d6bd446400172df6a5916e1c644",
    "latency": "71b37517eed9ea98d792a420d7d6db90c5b9ea751eb516c9b76e86540cc24cd0",
}


@each_row("name", STACKS)
def test_short_run_has_the_bytes_it_had(name):
    """Drive 8 s round the end of a wall with noise; the path begins with a turn."""
    cells = np.zeros((120, 200), dtype=np.int8)
    cells[[0, -1]], cells[:, [0, -1]], cells[:70, 90:94] = 100, 100, 100
    parameters = STACKS[name]
    prepared = prepare(OccupancyMap(cells, 0.05, (0.0, 0.0)), Lidar(), parameters)
    mission, start = Mission("navigate_to_pose", (Pose(8.5, 1.5, 0.0),)), Pose(2.0, 2.0, -1.2)
    found = drive(prepared, parameters, Lidar(), robot_of(parameters), start, mission, (), (1, 2, 3), DURATION_S)
    assert found.run.distance_m > 0.5
    here = numeric_class()
    if here != PINNED_ON and found.digest != DIGESTS[name]:
        pytest.skip(f"the digests are of another numeric class: {PINNED_ON!r}, here {here!r}")
    assert found.digest == DIGESTS[name]
