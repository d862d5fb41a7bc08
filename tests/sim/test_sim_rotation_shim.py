"""The Rotation Shim: read from a file, round each controller, in runs that begin with the path behind the robot."""

import math

import numpy as np
import pytest

from vastflow.sim.nav2.parameter_files.chosen import parameters_of
from vastflow.sim.nav2.parameter_files.parameter_file import nav2_file
from vastflow.sim.nav2.parameters.servers import RotationShim, SmacPlannerHybrid

SHIM = "nav2_rotation_shim_controller::RotationShimController"
CLASSES = {
    "mppi": "nav2_mppi_controller::MPPIController",
    "dwb": "dwb_core::DWBLocalPlanner",
    "rpp": "nav2_regulated_pure_pursuit_controller::RegulatedPurePursuitController",
}
PLUG_IN = '''"""Straight on."""

from vastflow.sim.kernels.plug_in import kernel
from vastflow.sim.nav2.controllers.controller import Controller
from vastflow.sim.model.parameter import parameter


@kernel
def straight_on(q, memory, given):
    return True, q.speed, 0.0


class StraightOn(Controller):
    speed: float = parameter(0.3, 0.0, 1.0)
    compute_velocity = straight_on
'''


def shimmed(name, **values):
    """Nav2's default stack with one of the controllers in a shim."""
    return alone(name).with_values(rotation_shim=RotationShim(enabled=True, **values))


def alone(name):
    """The same without one; RPP does not turn in place by itself."""
    stack = parameters_of({"controller": name})
    if name != "rpp":
        return stack
    return stack.with_values(controller=stack.controller.with_values(use_rotate_to_heading=False))


def first_moves(found):
    """Rows before the robot first drives: command's speed, yaw rate (rad/s), and the true yaw (rad) when it drives."""
    names = "command_speed_mmps", "command_yaw_rate_mradps", "yaw_mrad"
    speeds, rates, yaw = (found.columns[name] for name in names)
    first = int(np.argmax(speeds > 0))
    return speeds[:first], rates[:first] * 1e-3, yaw[first] * 1e-3


def test_key_controller_keeps_shim_of_file_round_named_controller(tmp_path):
    file = tmp_path / "nav2.yaml"
    file.write_text(
        "controller_server: {ros__parameters: {controller_plugins: [FollowPath], "
        f"FollowPath: {{plugin: '{SHIM}', primary_controller: '{CLASSES['rpp']}'}}}}}}"
    )
    system = {"nav2_params": nav2_file(file)}
    assert parameters_of({**system, "controller": "rpp"}).rotation_shim.enabled
    assert not parameters_of({**system, "controller": "mppi"}).rotation_shim.enabled


@pytest.mark.parametrize("name", CLASSES)
def test_robot_turns_in_place_to_a_path_behind_it_and_drives_ten_meters(name, over_a_floor):
    stack = shimmed(name)
    found = over_a_floor(stack, yaw_rad=3.0)
    speeds, rates, yaw = first_moves(found)
    assert found.run.outcome == "succeeded"
    assert found.run.distance_m == pytest.approx(10.0, abs=0.5)
    assert not speeds.any()
    assert rates.min() == pytest.approx(-1.8)
    # The plan is NavFn's: of its heading the robot is within the threshold, and by a cycle's turn at most.
    assert 0.5 < abs(yaw) <= 0.785 + 0.1
    assert not np.array_equal(rates[:20], first_moves(over_a_floor(alone(name), yaw_rad=3.0))[1][:20])


def test_own_plug_in_drives_in_shim(tmp_path, over_a_floor):
    (tmp_path / "own.py").write_text(PLUG_IN)
    file = tmp_path / "nav2.yaml"
    file.write_text(
        "controller_server: {ros__parameters: {controller_plugins: [FollowPath], FollowPath: {"
        f"plugin: '{SHIM}', primary_controller: 'own.py:StraightOn', angular_dist_threshold: 0.02, "
        "angular_disengage_threshold: 0.02, speed: 0.4}}}"
    )
    stack = parameters_of({"nav2_params": nav2_file(file)})
    speeds, rates, _ = first_moves(over_a_floor(stack, yaw_rad=1.0))
    assert not speeds.any()
    assert rates.min() < -0.5
    assert stack.controller.speed == 0.4


def test_acceleration_limits_the_first_turn_and_the_angle_left_the_last(over_a_floor):
    found = over_a_floor(shimmed("rpp", angular_dist_threshold=0.05, max_angular_accel=1.0), yaw_rad=2.0)
    _, rates, _ = first_moves(found)
    # A row is two ticks of 50 ms: at most 0.1 rad/s more or less in each, seen from what odometry reports.
    assert np.abs(np.diff(rates[:8])).max() <= 0.1 + 1e-3
    yaw = np.abs(found.columns["yaw_mrad"][: len(rates)] * 1e-3)
    assert (np.abs(rates) <= np.sqrt(2.0 * 1.0 * (yaw + 0.12))).all()


def test_shim_turns_robot_to_goal_heading_when_configured(over_a_floor):
    stack = shimmed("dwb", rotate_to_goal_heading=True)
    found = over_a_floor(stack, 4.0, goal_yaw_rad=2.5)
    assert found.run.outcome == "succeeded"
    near = np.hypot(found.columns["estimated_x_mm"] - 5000, found.columns["estimated_y_mm"] - 2000) < 245
    assert not found.columns["command_speed_mmps"][near].any()
    assert found.columns["command_yaw_rate_mradps"][near].max() == pytest.approx(1800)


def test_shim_leaves_path_to_controller_when_robot_can_not_turn(over_a_floor):
    cells = np.zeros((80, 280), dtype=bool)
    cells[45:47, 5:40] = True
    stack = shimmed("rpp")
    long = "[[0.45, 0.15], [0.45, -0.15], [-0.45, -0.15], [-0.45, 0.15]]"
    costmaps = {name: getattr(stack, name).with_values(footprint=long) for name in ("local_costmap", "global_costmap")}
    stack = stack.with_values(**costmaps)
    turning = over_a_floor(stack, 2.0, yaw_rad=math.pi)
    assert np.abs(turning.columns["command_yaw_rate_mradps"][:20]).max() > 500
    # With a wall 0.25 m beside it the outline would meet that, and RPP's own check, which looks at the same, gives no command.
    blocked = over_a_floor(stack, 2.0, yaw_rad=math.pi, cells=cells)
    assert np.abs(blocked.columns["command_yaw_rate_mradps"][:10]).max() == 0


def test_robot_turns_to_headings_of_its_path_with_use_path_orientations(over_a_floor):
    """The robot shall reach a goal behind it backward; map and odometry head alike at the start."""
    moves = {}
    for oriented in (True, False):
        stack = shimmed("rpp", use_path_orientations=oriented, forward_sampling_distance=0.3)
        stack = stack.with_values(
            planner=SmacPlannerHybrid(motion_model_for_search="REEDS_SHEPP"),
            controller=stack.controller.with_values(allow_reversing=True),
        )
        moves[oriented] = over_a_floor(stack, -0.6).columns
    assert moves[True]["command_speed_mmps"][:10].min() < -100
    assert np.abs(moves[True]["command_yaw_rate_mradps"][:10]).max() < 200
    assert not moves[False]["command_speed_mmps"][:10].any()
    assert np.abs(moves[False]["command_yaw_rate_mradps"][:10]).max() > 1000


def turns_in_place(found):
    """Count how often the robot begins to be told to turn without driving."""
    columns = found.columns
    turning = (columns["command_speed_mmps"] == 0) & (np.abs(columns["command_yaw_rate_mradps"]) > 50)
    return int(np.count_nonzero(turning & ~np.r_[False, turning[:-1]]))


def test_robot_turns_before_the_first_path_with_rotate_to_heading_once(over_a_floor):
    """Round the end of a wall, where the paths of the later replannings lead elsewhere than the robot heads."""
    cells = np.zeros((80, 280), dtype=bool)
    cells[:46, 100:104] = True
    often = {"angular_dist_threshold": 0.25, "angular_disengage_threshold": 0.1}
    each = over_a_floor(shimmed("rpp", **often), 8.0, yaw_rad=2.0, cells=cells)
    once = over_a_floor(shimmed("rpp", rotate_to_heading_once=True, **often), 8.0, yaw_rad=2.0, cells=cells)
    assert each.run.outcome == once.run.outcome == "succeeded"
    assert turns_in_place(once) == 1
    assert turns_in_place(each) > 2
