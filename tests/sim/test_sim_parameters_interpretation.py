"""What Nav2 parameter files set the stack to."""

import math
from pathlib import Path
from typing import Literal, get_args, get_origin

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from vastflow.sim.nav.parameters.controller_server import critics_of
from vastflow.sim.nav.parameters.costmap import Costmap, InflationLayer, ObstacleLayer, StaticLayer
from vastflow.sim.nav.parameters.costmap_layers import OF_THE_MAP
from vastflow.sim.nav.parameters.document import DocumentError, dotted, parse, read_document
from vastflow.sim.nav.parameters.dwb import DwbParameters
from vastflow.sim.nav.parameters.findings import findings
from vastflow.sim.nav.parameters.interpretation import NO_SMOOTHER, interpretation
from vastflow.sim.nav.parameters.mppi import MppiParameters
from vastflow.sim.nav.parameters.parameter import ParameterGroup, range_of
from vastflow.sim.nav.parameters.rpp import RppParameters
from vastflow.sim.nav.parameters.servers import CollisionMonitor, NavFn, VelocitySmoother
from vastflow.sim.nav.parameters.stack import NavParameters
from vastflow.sim.nav.parameters.written import document_of

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


def test_the_shipped_file_of_jazzy_is_what_the_stack_has_by_default():
    assert shipped("jazzy_mppi.yaml").parameters == NavParameters()


def test_the_shipped_file_with_rpp_differs_from_it_in_the_controller_alone():
    assert shipped("rpp.yaml").parameters == NavParameters(controller=RppParameters())


def test_the_shipped_file_with_dwb_is_a_turtlebot_4_under_humble():
    found = shipped("dwb.yaml").parameters
    assert found.controller == DwbParameters()
    assert (found.global_costmap.robot_radius, found.local_costmap.inflation_layer.inflation_radius) == (0.175, 0.45)
    assert found.local_costmap.static_layer.enabled
    assert not found.collision_monitor.enabled
    assert found.velocity_smoother.max_velocity == (0.26, 0.0, 1.0)


@pytest.mark.parametrize("name", ["jazzy_mppi.yaml", "dwb.yaml", "rpp.yaml"])
def test_everything_in_a_shipped_file_is_modeled_or_built_in(name):
    others = {dotted(found.path): found.status for found in findings(shipped(name))}
    assert {path: status for path, status in others.items() if status in ("differs", "not modeled")} == {}


def test_what_a_file_leaves_out_is_as_in_nav2s_code():
    layer = local("plugins: [i], i: {plugin: 'nav2_costmap_2d::InflationLayer'}").inflation_layer
    assert layer == InflationLayer(inflation_radius=0.55, cost_scaling_factor=10.0)
    assert parameters(MINIMAL).controller_server.min_x_velocity_threshold == 0.0001


def test_the_minimal_example_selects_its_controller():
    found = parameters(MINIMAL)
    assert isinstance(found.controller, MppiParameters)
    assert found.controller.batch_size == 1500


def test_a_controller_server_that_names_no_controller_has_jazzys():
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


def test_a_node_with_nothing_in_it_is_there_and_as_in_nav2s_code():
    found = parameters("velocity_smoother: {ros__parameters: }\nplanner_server: {ros__parameters: {}}\n" + MINIMAL)
    assert found.velocity_smoother == VelocitySmoother(max_velocity=(0.5, 0.0, 2.5), min_velocity=(-0.5, 0.0, -2.5))


def test_nodes_are_found_in_a_namespace_and_the_least_deep_of_two_counts():
    found = parameters("robot: {amcl: {ros__parameters: {pf_err: 0.1}}}\n/amcl: {ros__parameters: {pf_err: 0.2}}")
    assert found.amcl.pf_err == 0.2
    assert parameters("robot/amcl: {ros__parameters: {pf_err: 0.1}}").amcl.pf_err == 0.1


def test_a_costmap_is_the_node_in_its_namespace():
    assert read(f"local_costmap: {{ros__parameters: {{robot_radius: 0.3}}}}\n{MINIMAL}").replaced[1] == "local_costmap"


def test_the_list_of_plug_ins_decides_which_layers_there_are():
    found = local(
        "plugins: [a, b], a: {plugin: 'nav2_costmap_2d::StaticLayer'}, b: {plugin: 'nav2_costmap_2d/InflationLayer'}"
    )
    assert (found.static_layer.enabled, found.obstacle_layer.enabled, found.inflation_layer.enabled) == (
        True,
        False,
        True,
    )


def test_an_inflation_may_reach_across_a_whole_room():
    text = "plugins: [i], i: {plugin: 'nav2_costmap_2d::InflationLayer', inflation_radius: 5.5}"
    assert local(text).inflation_layer.inflation_radius == 5.5


def test_a_layer_may_be_switched_off():
    text = "plugins: [a], a: {plugin: 'nav2_costmap_2d::StaticLayer', enabled: false}"
    assert local(text).static_layer == StaticLayer(enabled=False)


@pytest.mark.parametrize(("layer", "cells"), [("VoxelLayer", 2), ("ObstacleLayer", 0)])
def test_a_voxel_layer_clears_short_of_the_beams_end(layer, cells):
    scan = "observation_sources: s, s: {data_type: LaserScan, clearing: true, obstacle_max_range: 2.0}"
    found = local(f"plugins: [a], a: {{plugin: 'nav2_costmap_2d::{layer}', {scan}}}").obstacle_layer
    assert found == ObstacleLayer(obstacle_max_range=2.0, short_clearing_cells=cells)


@pytest.mark.parametrize(
    "sources", ["", "observation_sources: [],", "observation_sources: s, s: {data_type: PointCloud2, marking: false},"]
)
def test_a_layer_without_a_source_that_marks_neither_marks_nor_clears(sources):
    found = local(f"plugins: [a], a: {{{sources} plugin: 'nav2_costmap_2d::ObstacleLayer'}}").obstacle_layer
    assert (found.enabled, found.marking, found.clearing) == (True, False, False)


def test_a_point_cloud_that_marks_is_read_as_the_laser_scan_where_there_is_none():
    sources = "observation_sources: up down, up: {obstacle_max_range: 4.0}, down: {marking: false, clearing: true}"
    text = f"local_costmap: {{local_costmap: {{ros__parameters: {{plugins: [a], a: {{plugin: nav2_costmap_2d::ObstacleLayer, {sources}}}}}}}}}"
    found = read(text)
    layer = found.parameters.local_costmap.obstacle_layer
    assert (layer.marking, layer.clearing, layer.obstacle_max_range) == (True, True, 4.0)
    why = {path[-1]: why for path, why in found.reader.unmodeled.items()}
    assert why == {
        "up": "a point cloud is read as the laser scan",
        "down": "only one source, a LaserScan, is modeled",
    }


@pytest.mark.parametrize(
    "other",
    [
        "o: {plugin: nav2_costmap_2d::VoxelLayer, observation_sources: camera, camera: {data_type: PointCloud2}}",
        "o: {plugin: nav2_costmap_2d::VoxelLayer, enabled: false, observation_sources: s, s: {data_type: LaserScan}}",
        "o: {plugin: spatio_temporal_voxel_layer/SpatioTemporalVoxelLayer}",
    ],
)
def test_of_two_obstacle_layers_the_one_is_read_that_is_on_and_sees_the_scan(other):
    scan = "a: {plugin: nav2_costmap_2d::ObstacleLayer, observation_sources: s, s: {data_type: LaserScan, obstacle_max_range: 7.0}}"
    found = read(f"local_costmap: {{local_costmap: {{ros__parameters: {{plugins: [o, a], {other}, {scan}}}}}}}")
    assert found.parameters.local_costmap.obstacle_layer.obstacle_max_range == 7.0
    assert "a second layer beside a is not modeled" in found.reader.unmodeled.values()


def test_a_file_with_one_costmap_gives_the_other_its_body():
    footprint = "'[[0.2, 0.4], [0.2, -0.4], [-0.9, 0.0]]'"
    body = f"footprint: {footprint}, footprint_padding: 0.02, robot_radius: 0.5"
    found = parameters(f"global_costmap: {{global_costmap: {{ros__parameters: {{{body}}}}}}}")
    assert found.local_costmap.footprint == found.global_costmap.footprint != "[]"
    assert found.local_costmap.footprint_padding == 0.02
    assert local("robot_radius: 0.4").robot_radius == 0.4
    text = "local_costmap: {local_costmap: {ros__parameters: {robot_radius: 0.4}}}"
    assert parameters(text).global_costmap.robot_radius == 0.4


def test_without_amcl_in_the_file_an_omni_robot_is_localized_as_one():
    text = "plugin: nav2_mppi_controller::MPPIController, motion_model: "
    assert parameters(controller(f"{text}Omni")).amcl.omni
    assert not parameters(controller(f"{text}DiffDrive")).amcl.omni
    assert not parameters(f"amcl: {{ros__parameters: {{}}}}\n{controller(f'{text}Omni')}").amcl.omni


def test_of_several_sources_the_first_laser_scan_is_used_and_the_others_are_not_modeled():
    sources = (
        "observation_sources: depth scan, depth: {data_type: PointCloud2}, scan: {data_type: LaserScan, clearing: true}"
    )
    text = f"local_costmap: {{local_costmap: {{ros__parameters: {{plugins: [a], a: {{plugin: nav2_costmap_2d::VoxelLayer, {sources}}}}}}}}}"
    assert read(text).parameters.local_costmap.obstacle_layer.clearing
    found = statuses(text)
    assert found["ros__parameters.a.depth.data_type"] == "not modeled"
    assert found["ros__parameters.a.scan.data_type"] == "modeled"


def test_costmaps_without_a_list_have_nav2s_default_layers():
    found = local("robot_radius: 0.3")
    assert (found.static_layer.enabled, found.obstacle_layer.enabled, found.inflation_layer.enabled) == (
        True,
        True,
        True,
    )


def test_the_global_costmaps_size_is_the_maps():
    text = "global_costmap: {global_costmap: {ros__parameters: {width: 80, resolution: 0.1, plugins: []}}}"
    assert parameters(text).global_costmap.resolution == 0.05
    assert statuses(text)["ros__parameters.width"] == "no effect"


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


def test_an_mppi_critic_can_be_switched_off_in_its_group():
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


def test_a_file_of_dashing_is_refused_where_it_differs_from_todays():
    text = """
dwb_controller: {ros__parameters: {max_vel_x: 0.26}}
navfn_planner: {ros__parameters: {tolerance: 0.0}}
local_costmap:
  local_costmap:
    ros__parameters:
      plugin_names: [obstacle_layer]
      plugin_types: ["nav2_costmap_2d::ObstacleLayer"]
"""
    assert faults(text) == [
        "nav2.yaml:2:1: dwb_controller: found a node of Nav2 Dashing's; controller_server with a list of plug-ins, as since Foxy",
        "nav2.yaml:3:1: navfn_planner: found a node of Nav2 Dashing's; planner_server with a list of plug-ins, as since Foxy",
        "nav2.yaml:7:7: local_costmap.local_costmap.ros__parameters.plugin_names: found a list of Nav2 Eloquent's, which has the classes in another list; 'plugins', and 'plugin: package::Class' below each name, as since Foxy",
    ]


def test_names_of_dashing_beside_todays_have_no_say():
    assert (
        parameters(f"{MINIMAL}\ndwb_controller: {{ros__parameters: {{max_vel_x: 0.26}}}}").controller.batch_size == 1500
    )


def test_a_rotation_shim_has_its_controller_in_a_group_since_kilted():
    shim = "plugin: nav2_rotation_shim_controller::RotationShimController, angular_dist_threshold: 0.5"
    inside = "primary_controller: {plugin: nav2_regulated_pure_pursuit_controller::RegulatedPurePursuitController, desired_linear_vel: 0.4}"
    found = parameters(controller(f"{shim}, {inside}, desired_linear_vel: 0.9"))
    assert found.rotation_shim.angular_dist_threshold == 0.5
    assert found.controller == RppParameters(desired_linear_vel=0.4)


def test_the_position_goal_checker_lets_the_robot_face_anywhere():
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
    assert set(statuses(controller(text)).values()) == {"modeled"}
    (fault,) = faults(controller(text.replace("Ackermann", "Tracked")))
    assert (
        "C.mine.plugin: no motion model 'mppi::TrackedMotionModel' is known; known: mppi::DiffDriveMotionModel, "
        in fault
    )


def test_dwb_with_few_samples_or_for_a_fast_robot_is_read():
    text = "plugin: dwb_core::DWBLocalPlanner, critics: [PathDist], vtheta_samples: 0, max_vel_theta: 12.0, min_speed_xy: -8.0, max_speed_xy: 8.0, min_speed_theta: -12.0"
    found = parameters(controller(text)).controller
    assert (found.vtheta_samples, found.max_vel_theta, found.min_speed_xy) == (0, 12.0, -8.0)


def test_a_waypoint_task_that_is_off_or_another_does_not_pause():
    def pause(task):
        text = f"waypoint_follower: {{ros__parameters: {{waypoint_task_executor_plugin: w, w: {{{task}}}}}}}"
        return parameters(text).waypoint_follower.waypoint_pause_duration

    wait = "plugin: nav2_waypoint_follower::WaitAtWaypoint, waypoint_pause_duration: 700"
    assert pause(wait) == 700
    assert pause(f"{wait}, enabled: false") == 0
    assert pause("plugin: nav2_waypoint_follower::PhotoAtWaypoint") == 0


PLUGIN_FAULTS = [
    (controller("plugin: nav2_mppi_controller::MPPIController, motion_model: Tracked"), "C.motion_model: found 'Tracked'; motion_model: Input should be 'DiffDrive', 'Ackermann' or 'Omni'"),
    ("local_costmap: {local_costmap: {ros__parameters: {filters: [k]}}}", "local_costmap.ros__parameters.filters.0: no 'plugin' below 'k'; the class of a costmap filter; known: nav2_costmap_2d::KeepoutFilter, "),
    ("local_costmap: {local_costmap: {ros__parameters: {filters: [k], k.plugin: nav2_costmap_2d::BinaryFilter}}}", "k.plugin: nav2_costmap_2d::BinaryFilter is not modeled; a costmap filter that is: "),
    ("local_costmap: {local_costmap: {ros__parameters: {filters: [k], k.plugin: nav2_costmap_2d::SpeedFilter}}}", "k: no 'filter_info_topic'; filter_info_topic: costmap_filter_info, and a node costmap_filter_info_server with the same"),
    ("local_costmap: {local_costmap: {ros__parameters: {filters: [k], k: {plugin: nav2_costmap_2d::SpeedFilter, filter_info_topic: /zones}}}}", "k.filter_info_topic: no node publishes on 'zones'; a node that does, costmap_filter_info_server: {ros__parameters: {filter_info_topic: zones, "),
    (controller(f"{OBSTACLES}, ObstaclesCritic: {{consider_footprint: true}}"), "C.ObstaclesCritic.consider_footprint: found true, which is not modeled; false"),
    (controller(OBSTACLES.replace("GoalCritic", "CostCritic")), "C.critics: CostCritic and ObstaclesCritic together are not modeled; one of them"),
    (controller("plugin: 'my::Controller'"), "C.plugin: no controller 'my::Controller' is known; known: dwb_core::DWBLocalPlanner, nav2_mppi_controller::MPPIController, "),
    (controller("plugin: nav2_rotation_shim_controller::RotationShimController"), "controller_plugins.0: no 'primary_controller' below 'C'; the class of a controller; known: "),
    (controller("gain: 1"), "controller_plugins.0: no 'plugin' below 'C'; the class of a controller; known: "),
    ("planner_server: {ros__parameters: {planner_plugins: [G], G.plugin: 'nav2_smac_planner/SmacPlannerLattice'}}", "G.plugin: nav2_smac_planner::SmacPlannerLattice is not modeled; a planner that is: nav2_navfn_planner::NavfnPlanner"),
    ("planner_server: {ros__parameters: {planner_plugins: []}}", "planner_plugins: found an empty list; the name of a planner"),
    ("planner_server: {ros__parameters: {planner_plugins: 3}}", "planner_plugins: found 3; a list of names"),
    (controller("plugin: dwb_core::DWBLocalPlanner, critics: [PathDist], max_vel_y: 0.5"), "C.max_vel_y: found 0.5, which is not modeled; 0.0"),
    (controller("plugin: graceful_controller/GracefulControllerROS"), "C.plugin: graceful_controller::GracefulControllerROS is not modeled; a controller that is: dwb_core::DWBLocalPlanner, "),
    ("local_costmap: {local_costmap: {ros__parameters: {plugins: [i, o], i.plugin: nav2_costmap_2d::InflationLayer, o.plugin: nav2_costmap_2d::ObstacleLayer}}}", "o.plugin: o comes after the inflation: Nav2 does not inflate what it marks, which is not modeled; 'o' before 'i' in the list 'plugins'"),
    ("slam_toolbox: {ros__parameters: {resolution: 0.05}}", "nav2.yaml:1:1: file: none of its nodes is modeled; one that is, beside others: amcl, controller_server, "),
    (controller("plugin: dwb_core::DWBLocalPlanner"), "C: no 'critics'; a list of them, without which DWB does not start: RotateToGoal, "),
    ("planner_server: {ros__parameters: {GridBased.plugin: 3}}", "GridBased.plugin: found 3; text"),
    ("controller_server: {ros__parameters: {controller_plugins: [F], F.plugin: nav2_mppi_controller::MPPIController, goal_checker_plugins: [g], g.plugin: nav2_controller::AxisGoalChecker}}", "g.plugin: nav2_controller::AxisGoalChecker is not modeled; a goal checker that is: "),
    ("controller_server: {ros__parameters: {controller_plugins: [F], F.plugin: nav2_mppi_controller::MPPIController, progress_checker_plugins: [g], g.plugin: x::P}}", "g.plugin: no progress checker 'x::P' is known; known: "),
    ("local_costmap: {local_costmap: {ros__parameters: {plugins: [d], d.plugin: nav2_costmap_2d::RangeSensorLayer}}}", "d.plugin: nav2_costmap_2d::RangeSensorLayer is not modeled; a costmap layer that is: nav2_costmap_2d::StaticLayer, "),
    ("local_costmap: {local_costmap: {ros__parameters: {plugins: [d], d.plugin: x::L}}}", "d.plugin: no costmap layer 'x::L' is known; known: "),
    (controller("plugin: nav2_mppi_controller::MPPIController, critics: [CostCritic, Cost]"), "C.critics.1: MPPI has no critic 'Cost'; known: "),
    (controller("plugin: dwb_core::DWBLocalPlanner, critics: [MapGrid]"), "C.critics.0: the critic MapGrid of DWB is not modeled; known: RotateToGoal, "),
    (controller("plugin: dwb_core::DWBLocalPlanner, critics: [1]"), "C.critics: found [1]; a list of names"),
    ("local_costmap: {local_costmap: {ros__parameters: {robot_radius: -0.2}}}", "robot_radius: found -0.2; robot_radius must lie in [0.01, 10]"),
    ("local_costmap: {local_costmap: {ros__parameters: {robot_radius: '0.2'}}}", "robot_radius: found '0.2'; robot_radius must be a number"),
    ("amcl: {ros__parameters: {pf_err: }}", "amcl.ros__parameters.pf_err: found nothing; pf_err must be a number"),
    ("amcl: {ros__parameters: {min_particles: 9, max_particles: 8}}", "amcl.ros__parameters.min_particles: found parameters that contradict each other: amcl.min_particles 9 must be <= max_particles 8; values that agree"),
]  # fmt: skip


@pytest.mark.parametrize(("text", "message"), PLUGIN_FAULTS)
def test_what_the_stack_cannot_be_set_to_is_a_fault(text, message):
    (found,) = faults(text)
    assert message in found


def test_faults_are_at_their_places_and_all_there():
    text = """
controller_server:
  ros__parameters:
    controller_plugins: [FollowPath]
    FollowPath:
      plugin: nav2_mppi_controller::MPPIController
      batch_size: none
      critics:
        - CostCritic
        - Foo
amcl:
  ros__parameters:
    alpha1: -1
"""
    assert [line.split(":")[:3] for line in faults(text)] == [
        ["nav2.yaml", "7", "19"],
        ["nav2.yaml", "10", "11"],
        ["nav2.yaml", "13", "13"],
    ]


def test_values_that_contradict_each_other_are_told_beside_other_faults():
    text = """
amcl:
  ros__parameters: {min_particles: 9, max_particles: 8}
velocity_smoother:
  ros__parameters: {max_velocity: [0.5, 0.0, fast], max_accel: [2.5, 0.0], max_decel: -2.5, velocity_timeout: .inf}
"""
    contradiction, *others = faults(text)
    assert contradiction.startswith(
        "nav2.yaml:3:36: amcl.ros__parameters.min_particles: found parameters that contradict"
    )
    assert [line.rpartition("; ")[2] for line in others] == [
        "max_velocity[2] must be a number",
        "max_accel must be a list of 3 numbers",
        "max_decel must be a list of 3 numbers",
        "velocity_timeout must be a number",
    ]


def test_every_item_of_a_list_that_is_out_of_range_is_told():
    text = "velocity_smoother: {ros__parameters: {max_decel: [2.5, 0.0, 3.2]}}"
    assert [line.rpartition("; ")[2] for line in faults(text)] == [
        "max_decel[0] must lie in [-1000, 0]",
        "max_decel[2] must lie in [-1000, 0]",
    ]


_ONE_BY_ONE = ("short_clearing_cells", "place", "consider_footprint", "group_connectivity_type")


@st.composite
def varied(draw, default):
    """Parameters like `default` with other values; those of a group that is not enabled stay."""
    values = {}
    for name, value in default:
        if isinstance(value, ParameterGroup):
            values[name] = draw(varied(value))
        elif name not in _ONE_BY_ONE and draw(st.booleans()):
            field = type(default).model_fields[name]
            chosen = get_args(field.annotation) if get_origin(field.annotation) is Literal else ()
            values[name] = draw(st.sampled_from(chosen) if chosen else values_of(value, *range_of(field)))
    if values.get("enabled", getattr(default, "enabled", True)) is False:
        return type(default)(enabled=False)
    if "max_particles" in values or "min_particles" in values:
        values |= {"min_particles": 1}
    if isinstance(default, MppiParameters) and values["CostCritic"].enabled:
        values["ObstaclesCritic"] = default.ObstaclesCritic.with_values(enabled=False)
    if isinstance(default, Costmap) and default.track_unknown_space:  # the global one
        values = {name: value for name, value in values.items() if name not in OF_THE_MAP}
    return default.with_values(**values)


def values_of(value, low, high):
    low, high = max(low, -1e9), min(high, 1e9)
    if isinstance(value, str):
        return st.sampled_from(["[]", "", "[[0.3, 0.3], [0.3, -0.3], [-0.3, 0.0]]"])
    if isinstance(value, bool):
        return st.booleans()
    if isinstance(value, int):
        return st.integers(int(low), int(high))
    if isinstance(value, tuple):
        return st.tuples(*(st.floats(low, high) for _ in value))
    return st.floats(low, high)


@settings(max_examples=40, deadline=None)
@given(st.data(), st.sampled_from([MppiParameters(), DwbParameters(), RppParameters()]))
def test_what_is_written_as_a_document_is_read_as_it_was(data, controller):
    default = NavParameters(controller=controller)
    parts = {name: data.draw(varied(group)) for name, group in default if name != "robot"}
    kept = {name: getattr(default, name) for name in ("perturbation", "latency", "robot", "rotation_shim")}
    often = parts["controller_server"].with_values(controller_frequency=1000.0)
    wanted = default.with_values(**parts | kept | {"controller_server": often})
    assert interpretation(document_of(wanted)).parameters == wanted


@settings(max_examples=40, deadline=None)
@given(st.sampled_from(["jazzy_mppi.yaml", "dwb.yaml", "rpp.yaml"]), st.data())
def test_a_file_with_accidents_is_read_or_has_faults(name, data):
    lines = (SHIPPED / name).read_text().splitlines()
    for _ in range(data.draw(st.integers(1, 4))):
        at = data.draw(st.integers(0, len(lines) - 1))
        accident = data.draw(st.sampled_from(["lose", "double", "indent", "cut", "put"]))
        if accident == "lose":
            del lines[at]
        elif accident == "double":
            lines.insert(at, lines[at])
        elif accident == "indent":
            lines[at] = "  " + lines[at]
        elif accident == "cut":
            lines[at] = lines[at][: data.draw(st.integers(0, 40))]
        else:
            key, _, _ = lines[at].partition(":")
            lines[at] = (
                f"{key}: {data.draw(st.sampled_from(['x', '-1', '[1, x]', '{a: 1}', '', '.inf', 'true', '*a']))}"
            )
    try:
        found = read("\n".join(lines))
    except DocumentError as error:
        assert all(fault.place > (0, 0) for fault in error.faults)
    else:
        assert len(findings(found)) > 100


OUTLINED = """
controller_server:
  ros__parameters:
    controller_plugins: [FollowPath]
    FollowPath: {plugin: "nav2_mppi_controller::MPPIController", critics: [CostCritic], CostCritic: {consider_footprint: true}}
"""


def test_a_footprint_to_consider_must_be_a_polygon_as_nav2_does_not_start_otherwise():
    (fault,) = faults(OUTLINED)
    assert "found true, and the local costmap has no polygon `footprint`" in fault
    polygon = "'[[0.3, 0.3], [0.3, -0.3], [-0.3, 0.0]]'"
    costmap = f"local_costmap: {{local_costmap: {{ros__parameters: {{footprint: {polygon}}}}}}}"
    assert parameters(OUTLINED + costmap).controller.CostCritic.consider_footprint


@pytest.mark.parametrize("value", ["0.3", "'[[0.2, 0.2]]'"])
def test_a_footprint_that_is_no_text_or_no_polygon_is_a_fault_with_its_place(value):
    (fault,) = faults(
        f"local_costmap: {{local_costmap: {{ros__parameters: {{robot_radius: 0.2, footprint: {value}}}}}}}"
    )
    assert "footprint must be text" in fault


def test_a_period_longer_than_mppis_step_is_a_fault_as_nav2_does_not_start():
    text = "controller_server: {ros__parameters: {controller_frequency: 10.0, FollowPath: {plugin: nav2_mppi_controller::MPPIController}}}"
    with pytest.raises(DocumentError, match=r"found 10; 20 or more for a model_dt of 0.05 s, as Nav2 does not start"):
        parameters(text)


def test_a_spatio_temporal_voxel_layer_is_read_as_a_voxel_layer_and_said():
    text = """local_costmap: {local_costmap: {ros__parameters: {plugins: [stvl], stvl: {
        plugin: spatio_temporal_voxel_layer/SpatioTemporalVoxelLayer, voxel_decay: 15.0, observation_sources: [clear, mark],
        clear: {data_type: PointCloud2, marking: false}, mark: {data_type: PointCloud2, marking: true, obstacle_range: 4.0}}}}}"""
    found = read(text)
    layer = found.parameters.local_costmap.obstacle_layer
    assert (layer.enabled, layer.marking, layer.clearing, layer.short_clearing_cells) == (True, True, True, 2)
    assert (layer.obstacle_max_range, layer.raytrace_max_range) == (4.0, 4.0)
    assert set(found.reader.unmodeled.values()) == {
        "it is read as a VoxelLayer of the laser scan: no voxel decays, and there is no camera"
    }
