"""Tests that pin the end and the bytes of a run of each controller and planner.

The end holds everywhere, within small tolerances. The bytes hold on every x86-64 machine with Linux and the libraries of
`deployments/constraints.txt`; elsewhere a run with other bytes is reported as skipped.
"""

import functools
import math
import platform
import re
from collections.abc import Mapping
from importlib.metadata import version
from pathlib import Path
from typing import Any, Final, NamedTuple

import numpy as np
import pytest
from driving import drive
from packaging.requirements import Requirement
from table import each_row

from vastflow.sim.model.obstacle import Obstacle
from vastflow.sim.model.pose import Pose
from vastflow.sim.model.recording import Recording
from vastflow.sim.model.scenario import Mission
from vastflow.sim.model.shape import Box
from vastflow.sim.nav2.navigator.prepared import prepare
from vastflow.sim.nav2.parameter_files.chosen import parameters_of
from vastflow.sim.nav2.parameters.servers import RotationShim, SmacPlanner2D, SmacPlannerHybrid
from vastflow.sim.nav2.parameters.stack import NavParameters
from vastflow.sim.nav2.system.robot import robot_of
from vastflow.sim.world.occupancy import OccupancyMap
from vastflow.sim.world.robot_model import Lidar
from vastflow.sim.world.world import World

CONSTRAINTS: Final = Path(__file__).parents[2] / "deployments" / "constraints.txt"
LIBRARIES: Final = ("llvmlite", "numba", "numpy", "pymunk", "scipy", "shapely")
"""Distributions that a run's numbers come from."""
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


STACKS: Final[Mapping[str, NavParameters]] = {
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


class Golden(NamedTuple):
    """End of a run.

    Attributes:
        digest: First digits of its digest.
        t_s, distance_m, recoveries: Totals of the whole run.
        x_m, y_m, yaw_rad: True pose at its end.
    """

    digest: str
    t_s: float
    distance_m: float
    x_m: float
    y_m: float
    yaw_rad: float
    recoveries: int = 0


SHORT_S: Final = 8.0
GOLDEN: Final[Mapping[tuple[str, str], Golden]] = {
    ("RPP", "whole"): Golden("a4462bc5ae2175c01e34", 18.6, 8.25, 8.46, 1.69, -0.14),
    ("RPP", "blocked"): Golden("5a0d1ca556907955c1af", 23.8, 3.15, 3.67, 4.34, -1.59, 15),
    ("DWB", "whole"): Golden("bb9a9f0482b8ef0742b8", 35.2, 8.31, 8.48, 1.7, -0.23),
    ("DWB", "blocked"): Golden("c300572c45ff25760a08", 27.8, 2.91, 3.54, 3.97, -1.57, 15),
    ("MPPI DiffDrive", "short"): Golden("1381dc03fce4fad29b10", 8.0, 2.43, 3.62, 3.64, 0.86),
    ("MPPI Omni", "short"): Golden("fa0f67f990a7bfac6d3b", 8.0, 3.89, 4.93, 4.25, -0.91),
    ("MPPI Ackermann", "short"): Golden("1c6013202a56026ca774", 8.0, 0.63, 1.85, 2.33, -0.06),
    ("MPPI consider_footprint", "short"): Golden("d9ce091f81e974f8c227", 8.0, 2.41, 3.59, 3.66, 0.78),
    ("MPPI ObstaclesCritic", "short"): Golden("0cbaecc260385f5cfc46", 8.0, 2.43, 3.63, 3.63, 0.83),
    ("MPPI all critics", "short"): Golden("2400c551292cc6d25ad0", 8.0, 0.63, 1.66, 2.52, -0.62),
    ("DWB", "short"): Golden("88db47bb36f017aa916e", 8.0, 1.87, 3.3, 3.16, 0.9),
    ("DWB ObstacleFootprint", "short"): Golden("af40ebc83c031a5b832b", 8.0, 1.87, 3.3, 3.16, 0.92),
    ("DWB other critics", "short"): Golden("ac408c587dc6e8eac8e6", 8.0, 1.86, 3.29, 3.16, 0.93),
    ("RPP", "short"): Golden("7fd5ed02f6c67e73c6a7", 8.0, 3.4, 4.49, 4.27, 0.24),
    ("Rotation Shim", "short"): Golden("f045b79d95311026bcb8", 8.0, 1.77, 3.27, 3.22, 0.81),
    ("NavFn A*", "short"): Golden("423285ae4d1bf469d020", 8.0, 3.37, 4.36, 4.24, 0.35),
    ("SmacPlanner2D", "short"): Golden("50927b10d950eb2cfae3", 8.0, 3.41, 4.53, 4.24, 0.2),
    ("SmacPlannerHybrid Dubins", "short"): Golden("2e1af15eec00ba3294ca", 8.0, 3.13, 3.9, 3.88, 0.88),
    ("SmacPlannerHybrid Reeds-Shepp", "short"): Golden("fe381a102bde68f7a99d", 8.0, 3.37, 4.32, 4.19, 0.33),
    ("latency", "short"): Golden("71b37517eed9ea98d792", 8.0, 0.91, 2.3, 2.6, 0.84),
    ("MPPI DiffDrive", "whole"): Golden("2a7ebc5178d4fb28b764", 21.4, 8.52, 8.65, 1.67, -0.22),
    ("MPPI DiffDrive", "blocked"): Golden("1117e839770f1118581d", 25.8, 3.21, 3.64, 4.31, -1.59, 15),
}
"""By stack and kind of run: its first 8 s, the whole mission, or one whose only passage is blocked."""


@functools.cache
def run_of(name: str, kind: str) -> Recording:
    """Drive round the end of a wall with noise; the path begins with a turn."""
    cells = np.zeros((120, 200), dtype=np.int8)
    cells[[0, -1]], cells[:, [0, -1]], cells[:70, 90:94] = 100, 100, 100
    parameters = STACKS[name]
    prepared = prepare(World(OccupancyMap(cells, 0.05, (0.0, 0.0))), Lidar(), parameters)
    mission, start = Mission("navigate_to_pose", (Pose(8.5, 1.5, 0.0),)), Pose(2.0, 2.0, -1.2)
    obstacles = (Obstacle("block", Box(0.3, 2.4), Pose(4.6, 4.75, 0.0)),) if kind == "blocked" else ()
    lasts_s = SHORT_S if kind == "short" else 60.0
    return drive(prepared, parameters, Lidar(), robot_of(parameters), start, mission, obstacles, (1, 2, 3), lasts_s)


def digests_hold(machine: str, versions: Mapping[str, str]) -> bool:
    """True where golden bytes are promised."""
    pinned = constraints()
    tested = all(pinned[name] == found for name, found in versions.items())
    return machine == "Linux x86_64" and tested


def constraints() -> Mapping[str, str]:
    """Return the tested versions of this Python's distributions."""
    lines = map(Requirement, re.findall(r"^[^\s#].*$", CONSTRAINTS.read_text(), re.MULTILINE))
    here = (line for line in lines if not line.marker or line.marker.evaluate())
    return {line.name: str(line.specifier).removeprefix("==") for line in here}


def machine_here() -> tuple[str, Mapping[str, str]]:
    """Return what `digests_hold` asks for."""
    return f"{platform.system()} {platform.machine()}", {name: version(name) for name in LIBRARIES}


@each_row("name, kind", GOLDEN)
def test_run_has_golden_bytes(name, kind):
    found, golden = run_of(name, kind).digest, GOLDEN[name, kind].digest
    if found.startswith(golden):
        return
    machine, versions = here = machine_here()
    told = ", ".join(f"{library} {number}" for library, number in versions.items())
    told = f"expected digest {golden}, got {found[: len(golden)]} on {machine} with Python {platform.python_version()}, {told}"
    if not digests_hold(*here):
        pytest.skip(told)
    pytest.fail(told)


@each_row("name, kind", GOLDEN)
def test_run_has_golden_end(name, kind):
    found, golden = run_of(name, kind), GOLDEN[name, kind]
    *place_m, yaw_rad = (float(found.columns[column][-1]) / 1e3 for column in ("x_mm", "y_mm", "yaw_mrad"))
    assert found.run.recoveries == golden.recoveries
    assert found.run.simulated_s == pytest.approx(golden.t_s, abs=0.3)
    assert found.run.distance_m == pytest.approx(golden.distance_m, abs=0.03)
    assert math.dist(place_m, (golden.x_m, golden.y_m)) < 0.05
    assert abs(math.remainder(yaw_rad - golden.yaw_rad, math.tau)) < 0.05


@each_row(
    "machine, changed, hold",
    [
        ("Linux x86_64", {}, True),
        ("Linux aarch64", {}, False),
        ("Darwin x86_64", {}, False),
        ("Linux x86_64", {"numba": "0.1"}, False),
        ("Linux x86_64", {"pymunk": "0.1"}, False),
    ],
)
def test_digests_hold_where_libraries_are_the_tested_ones(machine, changed, hold):
    tested = {name: constraints()[name] for name in LIBRARIES}
    assert digests_hold(machine, {**tested, **changed}) == hold
