"""DWB on a robot that moves to its sides: its samples, what Oscillation remembers, and a drive that the default can't do."""

import math

import numpy as np
import pytest

from vastflow.sim.kernels.numeric import njit
from vastflow.sim.kernels.record import record_of
from vastflow.sim.loop.drive import drive
from vastflow.sim.model.pose import Pose
from vastflow.sim.model.scenario import Mission
from vastflow.sim.nav2.controllers import dwb
from vastflow.sim.nav2.controllers.controller import ControllerInput
from vastflow.sim.nav2.costmaps.window import Window
from vastflow.sim.nav2.navigator.prepared import prepare
from vastflow.sim.nav2.parameter_files.chosen import parameters_of
from vastflow.sim.nav2.parameter_files.interpretation import document_of, interpretation
from vastflow.sim.nav2.parameters.dwb import DwbParameters
from vastflow.sim.reading.robot import robot_of
from vastflow.sim.world.occupancy import OccupancyMap
from vastflow.sim.world.robot_model import Lidar

CELLS, RESOLUTION_M = 80, 0.05
CENTER = (2.012, 1.993)
OMNI = DwbParameters(
    max_vel_x=0.3, max_speed_xy=0.4, min_vel_y=-0.3, max_vel_y=0.3, acc_lim_y=2.5, decel_lim_y=-2.5, vx_samples=4
)
SIDEWAYS = {
    **{f"FollowPath.{name}": value for name, value in (("min_vel_y", -0.3), ("max_vel_y", 0.3))},
    "FollowPath.acc_lim_y": 2.5,
    "FollowPath.decel_lim_y": -2.5,
}
STACK = {
    "controller": "dwb",
    "robot.drive": "omni",
    "robot_model_type": "nav2_amcl::OmniMotionModel",
    "min_y_velocity_threshold": 0.001,
    "max_velocity": [0.5, 0.5, 2.0],
    "min_velocity": [-0.5, -0.5, -2.0],
    "max_accel": [2.5, 2.5, 3.2],
    "max_decel": [-2.5, -2.5, -3.2],
}


@njit
def scored(records, memory, window, outline, pose, plan, goal, lateral):
    given = ControllerInput(window, outline, 0.2, pose, (0.0, 0.0), plan, 0.0, goal, 0.05, lateral)
    _, n_speeds, n_turns = dwb.score(records[0], memory, given)
    return n_speeds, n_turns


@njit
def commanded(records, memory, window, outline, pose, plan, goal, lateral):
    given = ControllerInput(window, outline, 0.2, pose, (0.0, 0.0), plan, 0.0, goal, 0.05, lateral)
    return dwb.compute_velocity(records[0], memory, given)


def situation(bearing_rad=0.0, lateral_mps=0.0, yaw_rad=0.0):
    """A plan of 1.2 m that leads away in a direction, on free ground."""
    along = np.arange(0.0, 1.2, 0.025)[:, None] * (math.cos(bearing_rad), math.sin(bearing_rad))
    window = Window(np.zeros((CELLS, CELLS), dtype=np.uint8), np.array([0.0, 0.0, RESOLUTION_M]))
    goal = (CENTER[0] + 9 * math.cos(bearing_rad), CENTER[1] + 9 * math.sin(bearing_rad), 0.0)
    return window, np.zeros((4, 2)), (*CENTER, yaw_rad), CENTER + along, goal, lateral_mps


def samples(parameters, **changes):
    memory = dwb.new_memory(parameters, CELLS, CELLS)
    n_speeds, n_turns = scored(record_of(parameters), memory, *situation(**changes))
    return memory, n_speeds, n_turns


def test_each_speed_ahead_has_all_speeds_to_the_side_in_turn():
    memory, n_speeds, _ = samples(OMNI)
    assert n_speeds == 4 * 5
    assert memory.speeds[:6] == pytest.approx([0.0] * 5 + [0.1])
    assert memory.sideways[:5] == pytest.approx([-0.3, -0.15, 0.0, 0.15, 0.3])


def test_without_limits_to_the_side_there_is_one_sample_of_no_motion_there():
    memory, n_speeds, _ = samples(OMNI.with_values(min_vel_y=0.0, max_vel_y=0.0))
    assert n_speeds == 4
    assert not memory.sideways.any()


def test_sample_to_the_side_ends_where_it_leads_at_that_speed():
    """Straight: the robot looks at 0.5 rad and already moves to its left as fast as the sample."""
    memory, n_speeds, n_turns = samples(OMNI.with_values(vtheta_samples=21), lateral_mps=0.3, yaw_rad=0.5)
    straight = int(np.argmin(np.abs(memory.turns[:n_turns])))
    found = next(i for i in range(n_speeds) if memory.speeds[i] == 0.0 and memory.sideways[i] == pytest.approx(0.3))
    assert memory.turns[straight] == pytest.approx(0.0, abs=1e-9)
    x, y = memory.ends[found, straight, :2] * RESOLUTION_M
    reach_m = 0.3 * OMNI.sim_time
    assert (x, y) == pytest.approx((CENTER[0] - reach_m * math.sin(0.5), CENTER[1] + reach_m * math.cos(0.5)))


def test_together_the_speeds_stay_below_max_speed_xy():
    memory, n_speeds, n_turns = samples(OMNI)
    fast = np.hypot(memory.speeds[:n_speeds], memory.sideways[:n_speeds]) > 0.4 + 1e-5
    assert fast.sum() == 2
    assert np.isinf(memory.scores[:n_speeds, :n_turns][fast]).all()
    assert np.isfinite(memory.scores[:n_speeds, :n_turns][~fast]).any(axis=1).all()


def test_oscillation_allows_no_change_of_side_until_the_robot_has_moved():
    only = ("PathDist", "GoalDist", "Oscillation")
    groups = {name: group for name, group in OMNI if hasattr(group, "place")}
    parameters = OMNI.with_values(
        max_vel_x=0.0, **{n: group.with_values(enabled=n in only) for n, group in groups.items()}
    )
    memory = dwb.new_memory(parameters, CELLS, CELLS)
    lateral = [
        commanded(record_of(parameters), memory, *situation(bearing_rad=side * math.pi / 2))[3] for side in (1, -1, 1)
    ]
    assert lateral[0] > 0.1
    assert lateral[1] < -0.1
    assert lateral[2] <= 0.0


def test_stack_with_samples_to_the_side_is_the_same_read_from_its_document_and_its_robot_is_omni():
    stack = parameters_of({**{key: value for key, value in STACK.items() if key != "robot.drive"}, **SIDEWAYS})
    assert robot_of(stack).drive == "omni"
    assert interpretation(document_of(stack)).parameters == stack


def test_robot_that_may_moves_to_the_side_along_a_path_of_ten_meters_where_the_default_never_does():
    floor = np.zeros((120, 280), dtype=np.int8)
    floor[[0, -1]], floor[:, [0, -1]] = 100, 100
    lateral = {}
    for sideways in (True, False):
        parameters = parameters_of({**STACK, **(SIDEWAYS if sideways else {})})
        prepared = prepare(OccupancyMap(floor, 0.05, (0.0, 0.0)), Lidar(), parameters)
        mission, start = Mission("navigate_to_pose", (Pose(11.0, 3.0),)), Pose(1.0, 3.0, 1.2)
        found = drive(prepared, parameters, Lidar(), robot_of(parameters), start, mission, (), (1, 2, 3), 90.0)
        assert found.run.outcome == "succeeded"
        assert found.run.distance_m == pytest.approx(10.0, abs=0.5)
        lateral[sideways] = np.abs(found.columns["command_lateral_speed_mmps"]).max()
    assert lateral[True] > 100
    assert lateral[False] == 0
