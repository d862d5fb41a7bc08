"""The section `robot` of a family: its values, its faults, and its notes."""

import math

import pytest

from vastflow.producers.campaign import load_campaign
from vastflow.producers.campaign_file.sections import LatencySpec, LidarSpec, OdometrySpec, RobotSpec
from vastflow.producers.instantiation.robots import robots_json
from vastflow.sim.model.faults import FileError
from vastflow.sim.nav2.parameter_files.chosen import parameters_of
from vastflow.sim.nav2.system.robot import lidar_of, robot_of
from vastflow.sim.system.robot import NOISE_MODEL_KEY, PRESETS, robot_keys


@pytest.fixture
def family(tmp_path, drawn_map):
    """The family of a campaign with this section `robot`."""
    place = f"{{map_file: {drawn_map('.' * 60, *['.' * 60] * 40).path}}}, {{start_pose: {{x: 1, y: -1}}}}, {{goal_pose: {{x: 1.5, y: -1}}}}"

    def made(robot, variations="[]", parameters=""):
        file = tmp_path / "robot.vast"
        file.write_text(
            f"configuration:\n- name: home\n  robot: {robot}\n  parameters: [{place}{parameters}]\n  variations: {variations}\n"
        )
        return load_campaign(file).families[0]

    return made


def of_robot(family):
    return {key: value for key, value in family.values.items() if key.startswith("robot.")}


def test_given_quantities_replace_the_turtlebot_4s(family):
    given = family(
        "{polygon: [[0.5, 0.3], [0.5, -0.3], [-0.2, 0.0]], mass: 40, max_speed: 0.22, max_yaw_rate: 1, lidar: {x: 0.1, yaw: 0, "
        "beams: 181, angle_min: -1.5708, angle_max: 1.5708, range_min: 0.05, range_max: 12, rate: 5}}"
    )
    parameters = parameters_of(of_robot(given))
    robot, lidar = robot_of(parameters), lidar_of(parameters)
    assert robot.vertices == ((0.5, 0.3), (0.5, -0.3), (-0.2, 0.0))
    assert robot.radius_m == pytest.approx(math.hypot(0.5, 0.3))
    assert (robot.mass_kg, robot.max_speed_mps, robot.max_yaw_rate_radps) == (40, 0.22, 1)
    assert robot.max_acceleration_mps2 == 2.0
    assert (lidar.mount_xyt, lidar.beams, lidar.rate_hz) == ((0.1, 0.0, 0.0), 181, 5.0)
    assert (lidar.range_min_m, lidar.range_max_m) == (0.05, 12)
    assert lidar.directions()[[0, 90, 180]].ravel() == pytest.approx([0.0, -1.0, 1.0, 0.0, 0.0, 1.0], abs=1e-5)


def test_section_has_every_quantity_that_a_robot_has(family):
    keys = {f"robot.{name}" for name in RobotSpec.model_fields if name not in ("lidar", "latency", "odometry")}
    keys |= {f"robot.lidar.{name}" for name in LidarSpec.model_fields if name != "noise"} | {NOISE_MODEL_KEY}
    keys |= {f"robot.latency.{name}" for name in LatencySpec.model_fields}
    assert keys | {f"robot.odometry.{name}" for name in OdometrySpec.model_fields} == set(robot_keys())
    robot = robot_of(parameters_of(of_robot(family("{drive: ackermann, min_turning_radius: 0.8}"))))
    assert (robot.drive, robot.min_turning_radius_m) == ("ackermann", 0.8)


def test_robot_odometry_reaches_the_stack_and_its_numbers_are_checked(family):
    drift = parameters_of(dict(family("{odometry: {translation_std_per_meter: 0.05}}").values)).odometry
    assert (drift.translation_std_per_meter, drift.rotation_std_per_meter) == (0.05, 0.0)


def test_robot_latency_combines_preset_and_overrides(family):
    given = family("{lidar: {sweeps: true}, latency: {preset: gazebo, scan_age: 0.05}}")
    parameters = parameters_of(of_robot(given))
    assert parameters.latency == PRESETS["gazebo"].with_values(scan_age=0.05)
    assert lidar_of(parameters).sweeps
    said = robots_json([given])[0]["robot"][0]
    assert "scans late by 0.05 s + 0.01 s in the mean" in said
    assert "odometry at 30 Hz" in said


def test_radius_is_the_bodys_and_leaves_the_costmaps_their_footprint(family):
    parameters = parameters_of(of_robot(family("{radius: 0.105}")))
    assert robot_of(parameters).radius_m == 0.105
    assert parameters.local_costmap.robot_radius == 0.22


def test_producers_vary_a_robot_as_they_vary_parameters(family):
    varied = family("{max_speed: 0.3}", "[ParameterVariationList: {name: robot.lidar.range_max, values: [3.5, 12]}]")
    ((given, *_, how),) = [each["robot"] for each in robots_json([varied])]
    assert (given, how) == ("the robot: speed up to 0.3 m/s", "varied: robot.lidar.range_max")


def test_faults_of_a_robot_have_place_and_message(golden, family, tmp_path):
    def faults(robot):
        with pytest.raises(FileError, match="robot") as caught:
            family(robot)
        return [str(fault).removeprefix(f"{tmp_path}/") for fault in caught.value.faults]

    golden("campaign_files", "robot", faults)


def test_quantity_is_given_once(family):
    with pytest.raises(FileError, match=r"Duplicate key 'robot.mass', given in line 4"):
        family("{mass: 3}", parameters=", {robot.mass: 4}")
