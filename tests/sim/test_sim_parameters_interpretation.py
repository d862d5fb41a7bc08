"""What Nav2 parameter files set the stack to."""

import math
from pathlib import Path

import pytest
from table import each_row

from vastflow.sim.nav2.parameter_files.controller_server import critics_of
from vastflow.sim.nav2.parameter_files.document import DocumentError, dotted, parse, read_document
from vastflow.sim.nav2.parameter_files.findings import findings
from vastflow.sim.nav2.parameter_files.interpretation import NO_SMOOTHER, document_of, interpretation
from vastflow.sim.nav2.parameters.costmap import InflationLayer
from vastflow.sim.nav2.parameters.dwb import DwbParameters
from vastflow.sim.nav2.parameters.mppi import MppiParameters
from vastflow.sim.nav2.parameters.rpp import RppParameters
from vastflow.sim.nav2.parameters.servers import CollisionMonitor, NavFn, VelocitySmoother
from vastflow.sim.nav2.parameters.stack import NavParameters

SHIPPED = Path(__file__).parents[2] / "campaigns" / "nav2"


MINIMAL = """
controller_server:
  ros__parameters:
    controller_frequency: 20.0
    controller_plugins: [FollowPath]
    FollowPath: {plugin: "nav2_mppi_controller::MPPIController", batch_size: 1500}
"""


def read(text):
    return interpretation(parse(text, "nav2.yaml"))


def parameters(text):
    return read(text).parameters


def faults(text):
    with pytest.raises(DocumentError) as caught:
        read(text)
    return str(caught.value).splitlines()


def local(text):
    """A local costmap of a document with these parameters, in flow style."""
    return parameters(f"local_costmap: {{local_costmap: {{ros__parameters: {{{text}}}}}}}").local_costmap


def controller(text):
    return f"controller_server: {{ros__parameters: {{controller_plugins: [C], C: {{{text}}}}}}}"


def statuses(text):
    return {".".join(found.path[2:]): found.status for found in findings(read(text))}


def shipped(name):
    return interpretation(read_document(SHIPPED / name))


OBSTACLES = "plugin: nav2_mppi_controller::MPPIController, critics: [ObstaclesCritic, GoalCritic]"


def test_obstacles_critic_takes_distances_by_its_own_parameters_as_in_humble_else_by_the_local_costmap_s_inflation():
    humble = read(controller(f"{OBSTACLES}, ObstaclesCritic: {{inflation_radius: 0.4, cost_scaling_factor: 7.0}}"))
    critic = humble.parameters.controller.ObstaclesCritic
    assert (critic.enabled, critic.inflation_radius, critic.cost_scaling_factor) == (True, 0.4, 7.0)
    assert not humble.parameters.controller.CostCritic.enabled
    costmap = (
        "local_costmap: {local_costmap: {ros__parameters: {plugins: [i], "
        "i: {plugin: 'nav2_costmap_2d::InflationLayer', inflation_radius: 0.9, cost_scaling_factor: 2.0}}}}"
    )
    critic = read(f"{controller(OBSTACLES)}\n{costmap}").parameters.controller.ObstaclesCritic
    assert (critic.inflation_radius, critic.cost_scaling_factor) == (0.9, 2.0)


def test_shipped_file_of_jazzy_is_what_the_stack_has_by_default():
    assert shipped("jazzy_mppi.yaml").parameters == NavParameters()


def test_shipped_file_with_rpp_differs_from_it_in_the_controller_alone():
    assert shipped("rpp.yaml").parameters == NavParameters(controller=RppParameters())


def test_shipped_file_with_dwb_is_a_turtlebot_4_under_humble():
    found = shipped("dwb.yaml").parameters
    assert found.controller == DwbParameters()
    assert (found.global_costmap.robot_radius, found.local_costmap.inflation_layer.inflation_radius) == (0.175, 0.45)
    assert found.local_costmap.static_layer.enabled
    assert not found.collision_monitor.enabled
    assert found.velocity_smoother.max_velocity == (0.26, 0.0, 1.0)


@each_row("name", ["jazzy_mppi.yaml", "dwb.yaml", "rpp.yaml"])
def test_everything_in_a_shipped_file_is_modeled_or_built_in(name):
    others = {dotted(found.path): found.status for found in findings(shipped(name))}
    assert {path: status for path, status in others.items() if status in ("differs", "not modeled")} == {}


def test_what_a_file_leaves_out_is_as_in_nav2s_code():
    layer = local("plugins: [i], i: {plugin: 'nav2_costmap_2d::InflationLayer'}").inflation_layer
    assert layer == InflationLayer(inflation_radius=0.55, cost_scaling_factor=10.0)
    assert parameters(MINIMAL).controller_server.min_x_velocity_threshold == 0.0001


def test_minimal_example_selects_its_controller():
    found = parameters(MINIMAL)
    assert isinstance(found.controller, MppiParameters)
    assert found.controller.batch_size == 1500


def test_controller_server_that_names_no_controller_has_jazzys():
    found = read("controller_server: {ros__parameters: {failure_tolerance: 0.5}}")
    assert found.parameters.controller_server.failure_tolerance == 0.5
    assert found.parameters.controller == NavParameters().controller
    assert "controller" in found.replaced


def test_without_a_list_of_critics_mppi_has_none():
    critics = critics_of(parameters(MINIMAL).controller).values()
    assert [critic.enabled for critic in critics] == [False] * len(critics)


def test_without_a_collision_monitor_there_is_none_and_without_a_smoother_no_limit():
    found = parameters(MINIMAL)
    assert found.collision_monitor == CollisionMonitor(enabled=False)
    assert found.velocity_smoother == NO_SMOOTHER


def test_other_nodes_that_are_missing_are_as_in_jazzys_file_and_named():
    found = read(MINIMAL)
    assert found.parameters.amcl == NavParameters().amcl
    assert found.parameters.local_costmap == NavParameters().local_costmap
    assert found.replaced == (
        *("amcl", "local_costmap", "global_costmap", "planner_server", "behavior_server", "waypoint_follower"),
    )
    assert found.left_away == ("velocity_smoother", "collision_monitor")


def test_node_with_nothing_in_it_is_there_and_as_in_nav2s_code():
    found = parameters("velocity_smoother: {ros__parameters: }\nplanner_server: {ros__parameters: {}}\n" + MINIMAL)
    assert found.velocity_smoother == VelocitySmoother(max_velocity=(0.5, 0.0, 2.5), min_velocity=(-0.5, 0.0, -2.5))


def test_nodes_are_found_in_a_namespace_and_the_least_deep_of_two_counts():
    found = parameters("robot: {amcl: {ros__parameters: {pf_err: 0.1}}}\n/amcl: {ros__parameters: {pf_err: 0.2}}")
    assert found.amcl.pf_err == 0.2
    assert parameters("robot/amcl: {ros__parameters: {pf_err: 0.1}}").amcl.pf_err == 0.1


def test_without_amcl_in_the_file_an_omni_robot_is_localized_as_one():
    text = "plugin: nav2_mppi_controller::MPPIController, motion_model: "
    assert parameters(controller(f"{text}Omni")).amcl.omni
    assert not parameters(controller(f"{text}DiffDrive")).amcl.omni
    assert not parameters(f"amcl: {{ros__parameters: {{}}}}\n{controller(f'{text}Omni')}").amcl.omni


def test_critics_in_the_list_are_enabled_by_whatever_spelling():
    text = controller(
        "plugin: dwb_core/DWBLocalPlanner, critics: [PathDist, 'dwb_critics::GoalDistCritic', Mine], Mine.class: PathAlign, PathDist.scale: 3.0, Mine.scale: 4.0"
    )
    found = parameters(text).controller
    enabled = {name for name, critic in critics_of(found).items() if critic.enabled}
    assert enabled == {"PathDist", "GoalDist", "PathAlign"}
    assert (found.PathDist.scale, found.PathAlign.scale, found.GoalDist.scale) == (3.0, 4.0, 1.0)


def test_dwbs_critics_are_summed_in_the_order_of_the_list():
    text = controller("plugin: dwb_core::DWBLocalPlanner, critics: [PathDist, RotateToGoal, GoalDist]")
    found = parameters(text).controller
    places = {critic: getattr(found, critic).place for critic in ("PathDist", "RotateToGoal", "GoalDist")}
    assert sorted(places, key=places.get) == ["PathDist", "RotateToGoal", "GoalDist"]
    assert interpretation(document_of(NavParameters(controller=found))).parameters.controller == found


def test_mppi_critic_can_be_switched_off_in_its_group():
    text = controller(
        "plugin: nav2_mppi_controller::MPPIController, critics: [CostCritic, GoalCritic], GoalCritic: {enabled: false}"
    )
    found = parameters(text).controller
    assert (found.CostCritic.enabled, found.GoalCritic.enabled) == (True, False)


def test_parameters_of_a_critic_that_is_not_in_the_list_have_no_effect():
    text = controller(
        "plugin: nav2_mppi_controller::MPPIController, critics: [CostCritic], GoalCritic: {cost_weight: 1.0}"
    )
    assert statuses(text)["C.GoalCritic.cost_weight"] == "no effect"


def test_of_several_plug_ins_the_default_trees_own_counts_and_the_others_need_not_be_known():
    text = """
controller_server:
  ros__parameters:
    controller_plugins: [Other, FollowPath]
    Other: {plugin: "mine::Controller", gain: 1.0}
    FollowPath: {plugin: "nav2_regulated_pure_pursuit_controller::RegulatedPurePursuitController"}
planner_server:
  ros__parameters:
    planner_plugins: [Mine, GridBased]
    Mine: {plugin: "mine::Planner"}
    GridBased: {plugin: "nav2_navfn_planner/NavfnPlanner", tolerance: 0.75, use_astar: true}
"""
    found = read(text).parameters
    assert (type(found.controller), found.planner) == (RppParameters, NavFn(tolerance=0.75, use_astar=True))
    assert statuses(text)["Other.gain"] == "no effect"


def test_humbles_single_progress_checker_is_read():
    text = "controller_server: {ros__parameters: {progress_checker_plugin: p, p: {plugin: nav2_controller::SimpleProgressChecker, movement_time_allowance: 5.0}, controller_plugins: [F], F.plugin: nav2_mppi_controller::MPPIController}}"
    assert parameters(text).progress_checker.movement_time_allowance == 5.0


def test_galactics_recoveries_server_is_the_behavior_server_unless_there_is_one():
    old = "recoveries_server: {ros__parameters: {max_rotational_vel: 2.5, recovery_plugins: [spin, backup, wait], spin.plugin: nav2_recoveries/Spin}}"
    found = read(old)
    assert found.parameters.behavior_server.max_rotational_vel == 2.5
    assert "behavior_server" not in found.replaced
    assert set(statuses(old).values()) == {"modeled", "built in"}
    both = f"{old}\nbehavior_server: {{ros__parameters: {{max_rotational_vel: 1.5}}}}"
    assert parameters(both).behavior_server.max_rotational_vel == 1.5


def test_names_of_dashing_beside_todays_have_no_say():
    assert (
        parameters(f"{MINIMAL}\ndwb_controller: {{ros__parameters: {{max_vel_x: 0.26}}}}").controller.batch_size == 1500
    )


def test_rotation_shim_has_its_controller_in_a_group_since_kilted():
    shim = "plugin: nav2_rotation_shim_controller::RotationShimController, angular_dist_threshold: 0.5"
    inside = "primary_controller: {plugin: nav2_regulated_pure_pursuit_controller::RegulatedPurePursuitController, desired_linear_vel: 0.4}"
    found = parameters(controller(f"{shim}, {inside}, desired_linear_vel: 0.9"))
    assert found.rotation_shim.angular_dist_threshold == 0.5
    assert found.controller == RppParameters(desired_linear_vel=0.4)


def test_position_goal_checker_lets_the_robot_face_anywhere():
    checkers = "goal_checker_plugins: [g], g: {plugin: nav2_controller::PositionGoalChecker, xy_goal_tolerance: 0.2, yaw_goal_tolerance: 0.1}"
    found = parameters(f"controller_server: {{ros__parameters: {{{checkers}}}}}").goal_checker
    assert (found.xy_goal_tolerance, found.stateful) == (0.2, True)
    assert found.yaw_goal_tolerance > math.pi


def test_what_mppi_has_for_omni_alone_may_be_anything_for_another_robot():
    text = "plugin: nav2_mppi_controller::MPPIController, vy_std: 0.0, motion_model: "
    assert isinstance(parameters(controller(f"{text}DiffDrive")).controller, MppiParameters)
    (fault,) = faults(controller(f"{text}Omni"))
    assert "vy_std must lie in [0.001, 10]" in fault


def test_mppis_motion_model_is_a_plug_in_with_parameters_since_lyrical():
    text = "plugin: nav2_mppi_controller::MPPIController, motion_model: mine, mine: {plugin: 'mppi::AckermannMotionModel', min_turning_r: 0.7}"
    found = parameters(controller(text)).controller
    assert (found.motion_model, found.AckermannConstraints.min_turning_r) == ("Ackermann", 0.7)
    unmodeled = {name for name, status in statuses(controller(text)).items() if status != "modeled"}
    assert unmodeled == {"controller_plugins"}, "its name is not the one that the default trees ask for"
    (fault,) = faults(controller(text.replace("Ackermann", "Tracked")))
    assert (
        "C.mine.plugin: no motion model 'mppi::TrackedMotionModel' is known; known: mppi::DiffDriveMotionModel, "
        in fault
    )


def test_since_lyrical_the_path_handler_has_what_mppi_had():
    own = "plugin: nav2_mppi_controller::MPPIController, prune_distance: 1.1"
    given = "plugin: nav2_controller::FeasiblePathHandler, enforce_path_inversion: true, inversion_xy_tolerance: 0.3"
    text = controller(f"{own}}}, path_handler_plugins: [P], P: {{{given}")
    found = parameters(text).controller
    assert (found.prune_distance, found.enforce_path_inversion) == (2.0, True)
    assert (found.inversion_xy_tolerance, found.inversion_yaw_tolerance) == (0.3, 0.4)
    assert statuses(text)["C.prune_distance"] == "not modeled"
    assert statuses(text)["P.inversion_xy_tolerance"] == "modeled"
    shorter = parameters(text.replace("P: {", "P: {prune_distance: 1.3, ")).controller
    assert shorter == found.with_values(prune_distance=1.3)


def test_dwb_with_few_samples_or_for_a_fast_robot_is_read():
    text = "plugin: dwb_core::DWBLocalPlanner, critics: [PathDist], vtheta_samples: 0, max_vel_theta: 12.0, min_speed_xy: -8.0, max_speed_xy: 8.0, min_speed_theta: -12.0"
    found = parameters(controller(text)).controller
    assert (found.vtheta_samples, found.max_vel_theta, found.min_speed_xy) == (0, 12.0, -8.0)


def test_waypoint_task_that_is_off_or_another_does_not_pause():
    def pause(task):
        text = f"waypoint_follower: {{ros__parameters: {{waypoint_task_executor_plugin: w, w: {{{task}}}}}}}"
        return parameters(text).waypoint_follower.waypoint_pause_duration

    wait = "plugin: nav2_waypoint_follower::WaitAtWaypoint, waypoint_pause_duration: 700"
    assert pause(wait) == 700
    assert pause(f"{wait}, enabled: false") == 0
    assert pause("plugin: nav2_waypoint_follower::PhotoAtWaypoint") == 0
