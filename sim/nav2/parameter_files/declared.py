"""The defaults that Nav2's code declares, which count for what a parameter file leaves out; those of Jazzy, tag 1.3.12.

`tests/proofs/nav2_defaults.py` compares them with Nav2's source.
"""

import functools
import json
from collections.abc import Mapping
from typing import Final, NamedTuple

from vastflow.sim.model.digest import Value


class Declared(NamedTuple):
    """A parameter as Nav2's code declares it.

    Attributes:
        default: None where the code declares a type alone. The number's type is the parameter's: an integer in a file is no double.
        source: File and line in Nav2's repository.
    """

    default: Value
    source: str


_TABLE: Final = """
amcl: nav2_amcl/src/amcl_node.cpp alpha1=0.2@74 alpha2=0.2@78 alpha3=0.2@82 alpha4=0.2@86 alpha5=0.2@90
  base_frame_id="base_footprint"@94 beam_skip_distance=0.5@98 beam_skip_error_threshold=0.9@99
  beam_skip_threshold=0.3@100 do_beamskip=false@101 global_frame_id="map"@103 lambda_short=0.1@107
  laser_likelihood_max_dist=2.0@111 laser_max_range=100.0@115 laser_min_range=-1.0@120
  laser_model_type="likelihood_field"@125 set_initial_pose=false@130 initial_pose.x=0.0@135 initial_pose.y=0.0@139
  initial_pose.z=0.0@143 initial_pose.yaw=0.0@147 max_beams=60@151 max_particles=2000@155 min_particles=500@159
  odom_frame_id="odom"@163 pf_err=0.05@167 pf_z=0.99@168 recovery_alpha_fast=0.0@170 recovery_alpha_slow=0.0@176
  resample_interval=1@182 robot_model_type="nav2_amcl::DifferentialMotionModel"@186 save_pose_rate=0.5@188
  sigma_hit=0.2@195 tf_broadcast=true@197 transform_tolerance=1.0@202 update_min_a=0.2@207 update_min_d=0.25@211
  z_hit=0.5@215 z_max=0.05@216 z_rand=0.5@217 z_short=0.05@218 always_reset_initial_pose=false@220 scan_topic="scan"@226
  map_topic="map"@230 first_map_only=false@234 freespace_downsampling=false@238
bt_navigator: nav2_bt_navigator/src/bt_navigator.cpp plugin_lib_names=[]@42 transform_tolerance=0.1@44
  global_frame="map"@46 robot_base_frame="base_link"@48 odom_topic="odom"@50
  navigators=["navigate_to_pose","navigate_through_poses"]@106
bt_navigator: nav2_behavior_tree/include/nav2_behavior_tree/bt_action_server_impl.hpp bt_loop_duration=10@59
  default_server_timeout=20@62 always_reload_bt_xml=false@71 wait_for_service_timeout=1000@74 error_code_names=null@83
bt_navigator: nav2_bt_navigator/src/navigators/navigate_to_pose.cpp goal_blackboard_id="goal"@33
  path_blackboard_id="path"@39 enable_groot_monitoring=false@55
controller_server: nav2_controller/src/controller_server.cpp controller_frequency=20.0@52
  progress_checker_plugins=["progress_checker"]@56 goal_checker_plugins=["goal_checker"]@57
  controller_plugins=["FollowPath"]@58 min_x_velocity_threshold=0.0001@59 min_y_velocity_threshold=0.0001@60
  min_theta_velocity_threshold=0.0001@61 speed_limit_topic="speed_limit"@63 failure_tolerance=0.0@65
  publish_zero_velocity=true@67 costmap_update_timeout=0.3@68
SimpleProgressChecker, PoseProgressChecker: nav2_controller/plugins/simple_progress_checker.cpp
  required_movement_radius=0.5@40 movement_time_allowance=10.0@42
PoseProgressChecker: nav2_controller/plugins/pose_progress_checker.cpp required_movement_angle=0.5@41
SimpleGoalChecker, StoppedGoalChecker: nav2_controller/plugins/simple_goal_checker.cpp xy_goal_tolerance=0.25@73
  yaw_goal_tolerance=0.25@76 stateful=true@79 symmetric_yaw_tolerance=false@82
StoppedGoalChecker: nav2_controller/plugins/stopped_goal_checker.cpp rot_stopped_velocity=0.25@68
  trans_stopped_velocity=0.25@71
PositionGoalChecker: nav2_controller/plugins/position_goal_checker.cpp xy_goal_tolerance=0.25@44 stateful=true@47
RotationShim: nav2_rotation_shim_controller/src/nav2_rotation_shim_controller.cpp angular_dist_threshold=0.785@54
  angular_disengage_threshold=0.3925@56 forward_sampling_distance=0.5@58 rotate_to_heading_angular_vel=1.8@60
  max_angular_accel=3.2@62 simulate_ahead_time=1.0@64 primary_controller=null@66 rotate_to_goal_heading=false@68
  rotate_to_heading_once=false@70 closed_loop=true@72 use_path_orientations=false@74
RPP: nav2_regulated_pure_pursuit_controller/src/parameter_handler.cpp desired_linear_vel=0.5@39 lookahead_dist=0.6@41
  min_lookahead_dist=0.3@43 max_lookahead_dist=0.9@45 lookahead_time=1.5@47 rotate_to_heading_angular_vel=1.8@49
  transform_tolerance=0.1@51 use_velocity_scaled_lookahead_dist=false@53 min_approach_linear_velocity=0.05@56
  approach_velocity_scaling_dist=0.6@58 max_allowed_time_to_collision_up_to_carrot=1.0@61
  use_regulated_linear_velocity_scaling=true@64 use_cost_regulated_linear_velocity_scaling=true@66
  cost_scaling_dist=0.6@69 cost_scaling_gain=1.0@71 inflation_cost_scaling_factor=3.0@73
  regulated_linear_scaling_min_radius=0.9@75 regulated_linear_scaling_min_speed=0.25@77
  use_fixed_curvature_lookahead=false@79 curvature_lookahead_dist=0.6@81 use_rotate_to_heading=true@83
  rotate_to_heading_min_angle=0.785@85 max_angular_accel=3.2@87 use_cancel_deceleration=false@89
  cancel_deceleration=3.2@91 allow_reversing=false@93 interpolate_curvature_after_goal=false@98
  use_collision_detection=true@101 stateful=true@104
MPPI: nav2_mppi_controller/src/optimizer.cpp model_dt=0.05@70 time_steps=56@71 batch_size=1000@72 iteration_count=1@73
  temperature=0.3@74 gamma=0.015@75 vx_max=0.5@76 vx_min=-0.35@77 vy_max=0.5@78 wz_max=1.9@79 ax_max=3.0@80
  ax_min=-3.0@81 ay_max=3.0@82 ay_min=-3.0@83 az_max=3.5@84 vx_std=0.2@85 vy_std=0.2@86 wz_std=0.4@87
  retry_attempt_limit=1@88 motion_model="DiffDrive"@105
MPPI: nav2_mppi_controller/src/noise_generator.cpp regenerate_noises=false@35
MPPI: nav2_mppi_controller/src/path_handler.cpp prune_distance=1.5@38 transform_tolerance=0.1@39
  enforce_path_inversion=false@40 inversion_xy_tolerance=0.2@42 inversion_yaw_tolerance=0.4@43
MPPI: nav2_mppi_controller/src/controller.cpp visualize=false@39
AckermannConstraints: nav2_mppi_controller/include/nav2_mppi_controller/motion_models.hpp min_turning_r=0.2@155
ConstraintCritic, CostCritic, ObstaclesCritic, GoalCritic, GoalAngleCritic, PathAlignCritic, PathFollowCritic,
  PathAngleCritic, PreferForwardCritic, TwirlingCritic, VelocityDeadbandCritic:
  nav2_mppi_controller/include/nav2_mppi_controller/critic_function.hpp enabled=true@81
ConstraintCritic: nav2_mppi_controller/src/critics/constraint_critic.cpp cost_power=1@25 cost_weight=4.0@26
CostCritic: nav2_mppi_controller/src/critics/cost_critic.cpp consider_footprint=false@26 cost_power=1@27
  cost_weight=3.81@28 critical_cost=300.0@29 near_collision_cost=253@30 collision_cost=1000000.0@31
  near_goal_distance=0.5@32 inflation_layer_name=""@33 trajectory_point_step=2@34
ObstaclesCritic: nav2_mppi_controller/src/critics/obstacles_critic.cpp consider_footprint=false@27 cost_power=1@28
  repulsion_weight=1.5@29 critical_weight=20.0@30 collision_cost=100000.0@31 collision_margin_distance=0.1@32
  near_goal_distance=0.5@33 inflation_layer_name=""@34
GoalCritic: nav2_mppi_controller/src/critics/goal_critic.cpp cost_power=1@27 cost_weight=5.0@28
  threshold_to_consider=1.4@29
GoalAngleCritic: nav2_mppi_controller/src/critics/goal_angle_critic.cpp cost_power=1@24 cost_weight=3.0@25
  threshold_to_consider=0.5@27 symmetric_yaw_tolerance=false@28
PathAlignCritic: nav2_mppi_controller/src/critics/path_align_critic.cpp cost_power=1@26 cost_weight=10.0@27
  max_path_occupancy_ratio=0.07@29 offset_from_furthest=20@30 trajectory_point_step=4@31 threshold_to_consider=0.5@32
  use_path_orientations=false@35
PathFollowCritic: nav2_mppi_controller/src/critics/path_follow_critic.cpp threshold_to_consider=1.4@27
  offset_from_furthest=6@30 cost_power=1@31 cost_weight=5.0@32
PathAngleCritic: nav2_mppi_controller/src/critics/path_angle_critic.cpp offset_from_furthest=4@37 cost_power=1@38
  cost_weight=2.2@39 threshold_to_consider=0.5@40 max_angle_to_furthest=0.785398@43 mode=0@48
PreferForwardCritic: nav2_mppi_controller/src/critics/prefer_forward_critic.cpp cost_power=1@23 cost_weight=5.0@24
  threshold_to_consider=0.5@25
TwirlingCritic: nav2_mppi_controller/src/critics/twirling_critic.cpp cost_power=1@24 cost_weight=10.0@25
VelocityDeadbandCritic: nav2_mppi_controller/src/critics/velocity_deadband_critic.cpp cost_power=1@24
  cost_weight=35.0@25 deadband_velocities=[0.0,0.0,0.0]@29
DWB: nav2_dwb_controller/dwb_core/src/dwb_local_planner.cpp critics=null@81 default_critic_namespaces=[]@84
  prune_plan=true@87 prune_distance=2.0@90 forward_prune_distance=2.0@93 debug_trajectory_details=false@96
  trajectory_generator_name="dwb_plugins::StandardTrajectoryGenerator"@99 transform_tolerance=0.1@102
  shorten_transformed_plan=true@105 short_circuit_trajectory_evaluation=true@108
DWB: nav2_dwb_controller/dwb_core/src/publisher.cpp publish_evaluation=true@75 publish_global_plan=true@78
  publish_transformed_plan=true@81 publish_local_plan=true@84 publish_trajectories=true@87 publish_cost_grid_pc=false@90
  marker_lifetime=0.1@93
DWB: nav2_dwb_controller/dwb_plugins/src/kinematic_parameters.cpp min_vel_x=0.0@74 min_vel_y=0.0@75 max_vel_x=0.0@76
  max_vel_y=0.0@77 max_vel_theta=0.0@78 min_speed_xy=0.0@81 max_speed_xy=0.0@84 min_speed_theta=0.0@87 acc_lim_x=0.0@90
  acc_lim_y=0.0@91 acc_lim_theta=0.0@92 decel_lim_x=0.0@95 decel_lim_y=0.0@96 decel_lim_theta=0.0@97
DWB: nav2_dwb_controller/dwb_plugins/src/standard_traj_generator.cpp sim_time=1.7@58 discretize_by_time=false@61
  time_granularity=0.5@65 linear_granularity=0.5@68 angular_granularity=0.025@71 include_last_point=true@74
  limit_vel_cmd_in_traj=false@78
DWB: nav2_dwb_controller/dwb_plugins/src/xy_theta_iterator.cpp vx_samples=20@53 vy_samples=5@56 vtheta_samples=20@59
RotateToGoal, Oscillation, BaseObstacle, ObstacleFootprint, GoalAlign, PathAlign, PathDist, GoalDist, PreferForward,
  Twirling: nav2_dwb_controller/dwb_core/include/dwb_core/trajectory_critic.hpp scale=1.0@106
RotateToGoal: nav2_dwb_controller/dwb_critics/src/rotate_to_goal.cpp slowing_factor=5.0@69 lookahead_time=-1.0@72
DWB: nav2_dwb_controller/dwb_critics/src/rotate_to_goal.cpp xy_goal_tolerance=0.25@61 trans_stopped_velocity=0.25@65
Oscillation: nav2_dwb_controller/dwb_critics/src/oscillation.cpp oscillation_reset_dist=0.05@101
  oscillation_reset_angle=0.2@105 oscillation_reset_time=-1.0@109 x_only_threshold=0.05@113
BaseObstacle, ObstacleFootprint: nav2_dwb_controller/dwb_critics/src/base_obstacle.cpp sum_scores=false@58
GoalAlign: nav2_dwb_controller/dwb_critics/src/goal_align.cpp forward_point_distance=0.325@55
PathAlign: nav2_dwb_controller/dwb_critics/src/path_align.cpp forward_point_distance=0.325@55
GoalAlign, PathAlign, PathDist, GoalDist: nav2_dwb_controller/dwb_critics/src/map_grid.cpp aggregation_type="last"@71
PreferForward: nav2_dwb_controller/dwb_critics/src/prefer_forward.cpp penalty=1.0@54 strafe_x=0.1@57 strafe_theta=0.2@60
  theta_scale=10.0@63
local_costmap, global_costmap: nav2_costmap_2d/src/costmap_2d_ros.cpp map_topic="map"@73
  always_send_full_costmap=false@112 footprint_padding=0.01@114 footprint="[]"@115 global_frame="map"@116 height=5@117
  width=5@118 lethal_cost_threshold=100@119 observation_sources=""@120 origin_x=0.0@121 origin_y=0.0@122
  plugins=["static_layer","obstacle_layer","inflation_layer"]@123 filters=[]@124 publish_frequency=1.0@125
  resolution=0.1@126 robot_base_frame="base_link"@127 robot_radius=0.1@128 rolling_window=false@129
  track_unknown_space=false@130 transform_tolerance=0.3@131 initial_transform_timeout=60.0@132 trinary_costmap=true@133
  unknown_cost_value=255@134 update_frequency=5.0@135 use_maximum=false@136
StaticLayer: nav2_costmap_2d/plugins/static_layer.cpp enabled=true@137 subscribe_to_updates=false@138
  map_subscribe_transient_local=true@139 transform_tolerance=0.0@140 map_topic=""@141
  footprint_clearing_enabled=false@142
ObstacleLayer: nav2_costmap_2d/plugins/obstacle_layer.cpp enabled=true@83 footprint_clearing_enabled=true@84
  min_obstacle_height=0.0@85 max_obstacle_height=2.0@86 combination_method=1@87 observation_sources=""@88
scan: nav2_costmap_2d/plugins/obstacle_layer.cpp sensor_frame=""@145 observation_persistence=0.0@146
  expected_update_rate=0.0@147 data_type="LaserScan"@148 min_obstacle_height=0.0@149 max_obstacle_height=0.0@150
  inf_is_valid=false@151 marking=true@152 clearing=false@153 obstacle_max_range=2.5@154 obstacle_min_range=0.0@155
  raytrace_max_range=3.0@156 raytrace_min_range=0.0@157
VoxelLayer: nav2_costmap_2d/plugins/voxel_layer.cpp enabled=true@65 footprint_clearing_enabled=true@66
  min_obstacle_height=0.0@67 max_obstacle_height=2.0@68 z_voxels=10@69 origin_z=0.0@70 z_resolution=0.2@71
  unknown_threshold=15@72 mark_threshold=0@73 combination_method=1@74 publish_voxel_map=false@75
DenoiseLayer: nav2_costmap_2d/plugins/denoise_layer.cpp enabled=true@31 minimal_group_size=2@33
  group_connectivity_type=8@35
InflationLayer: nav2_costmap_2d/plugins/inflation_layer.cpp enabled=true@92 inflation_radius=0.55@93
  cost_scaling_factor=10.0@94 inflate_unknown=false@95 inflate_around_unknown=false@96
KeepoutFilter, SpeedFilter: nav2_costmap_2d/plugins/costmap_filters/costmap_filter.cpp enabled=true@74
  filter_info_topic=null@75 transform_tolerance=0.1@76
KeepoutFilter: nav2_costmap_2d/plugins/costmap_filters/keepout_filter.cpp override_lethal_cost=false@78
  lethal_override_cost=252@80
SpeedFilter: nav2_costmap_2d/plugins/costmap_filters/speed_filter.cpp speed_limit_topic="speed_limit"@69
filter info: nav2_map_server/src/costmap_filter_info/costmap_filter_info_server.cpp
  filter_info_topic="costmap_filter_info"@30 type=0@31 mask_topic="filter_mask"@32 base=0.0@33 multiplier=1.0@34
planner_server: nav2_planner/src/planner_server.cpp planner_plugins=["GridBased"]@54 expected_planner_frequency=1.0@55
  costmap_update_timeout=1.0@57
NavfnPlanner: nav2_navfn_planner/src/navfn_planner.cpp tolerance=0.5@84 use_astar=false@86 allow_unknown=true@88
  use_final_approach_orientation=false@90
SmacPlanner2D: nav2_smac_planner/src/smac_planner_2d.cpp tolerance=0.125@64 downsample_costmap=false@67
  downsampling_factor=1@70 cost_travel_multiplier=1.0@73 allow_unknown=true@77 max_iterations=1000000@80
  max_on_approach_iterations=1000@83 terminal_checking_interval=5000@86 use_final_approach_orientation=false@89
  max_planning_time=2.0@93
SmacPlannerHybrid: nav2_smac_planner/src/smac_planner_hybrid.cpp downsample_costmap=false@72 downsampling_factor=1@75
  angle_quantization_bins=72@79 tolerance=0.25@85 allow_unknown=true@88 max_iterations=1000000@91
  max_on_approach_iterations=1000@94 terminal_checking_interval=5000@97 smooth_path=true@100
  minimum_turning_radius=0.4@104 allow_primitive_interpolation=false@107 cache_obstacle_heuristic=false@111
  reverse_penalty=2.0@114 change_penalty=0.0@117 non_straight_penalty=1.2@120 cost_penalty=2.0@123
  retrospective_penalty=0.015@126 analytic_expansion_ratio=3.5@129 analytic_expansion_max_cost=200.0@132
  analytic_expansion_max_cost_override=false@136 use_quadratic_cost_penalty=false@141
  downsample_obstacle_heuristic=true@145 analytic_expansion_max_length=3.0@150 max_planning_time=5.0@156
  lookup_table_size=20.0@159 debug_visualizations=false@163 motion_model_for_search="DUBIN"@167
smoother: nav2_smac_planner/include/nav2_smac_planner/types.hpp tolerance=1e-10@80 max_iterations=1000@83 w_data=0.2@86
  w_smooth=0.3@89 do_refinement=true@92 refinement_num=2@95
behavior_server: nav2_behaviors/src/behavior_server.cpp local_costmap_topic="local_costmap/costmap_raw"@34
  global_costmap_topic="global_costmap/costmap_raw"@38 local_footprint_topic="local_costmap/published_footprint"@42
  global_footprint_topic="global_costmap/published_footprint"@46 cycle_frequency=10.0@50
  behavior_plugins=["spin","backup","drive_on_heading","wait"]@51 local_frame="odom"@60 global_frame="map"@63
  robot_base_frame="base_link"@66 transform_tolerance=0.1@69
behavior_server: nav2_behaviors/plugins/spin.cpp simulate_ahead_time=2.0@53 max_rotational_vel=1.0@58
  min_rotational_vel=0.4@63 rotational_acc_lim=3.2@68
behavior_server: nav2_behaviors/plugins/assisted_teleop.cpp projection_time=1.0@35 simulation_time_step=0.1@39
waypoint_follower: nav2_waypoint_follower/src/waypoint_follower.cpp stop_on_failure=true@37 loop_rate=20@38
  global_frame_id="map"@42 waypoint_task_executor_plugin="wait_at_waypoint"@44
  wait_at_waypoint.plugin="nav2_waypoint_follower::WaitAtWaypoint"@47
WaitAtWaypoint: nav2_waypoint_follower/plugins/wait_at_waypoint.cpp waypoint_pause_duration=0@46 enabled=true@50
velocity_smoother: nav2_velocity_smoother/src/velocity_smoother.cpp smoothing_frequency=20.0@55 feedback="OPEN_LOOP"@56
  scale_velocities=false@58 max_velocity=[0.5,0.0,2.5]@64 min_velocity=[-0.5,0.0,-2.5]@66 max_accel=[2.5,0.0,3.2]@68
  max_decel=[-2.5,0.0,-3.2]@70 odom_topic="odom"@112 odom_duration=0.1@113 deadband_velocity=[0.0,0.0,0.0]@114
  velocity_timeout=1.0@116
collision_monitor: nav2_collision_monitor/src/collision_monitor_node.cpp cmd_vel_in_topic="cmd_vel_smoothed"@248
  cmd_vel_out_topic="cmd_vel"@251 state_topic=""@254 base_frame_id="base_footprint"@258 odom_frame_id="odom"@261
  transform_tolerance=0.1@264 source_timeout=2.0@268 base_shift_correction=true@272 stop_pub_timeout=1.0@277
  polygons=null@304 observation_sources=null@357
polygon: nav2_collision_monitor/src/collision_monitor_node.cpp type=null@309
monitored scan: nav2_collision_monitor/src/collision_monitor_node.cpp type="scan"@361
polygon: nav2_collision_monitor/src/polygon.cpp action_type=null@332 enabled=true@351 min_points=4@355
  max_points=null@360 slowdown_ratio=0.5@373 linear_limit=0.5@379 angular_limit=0.5@382 time_before_collision=2.0@388
  simulation_time_step=0.1@392 visualize=false@398 polygon_sub_topic=null@416
  footprint_topic="local_costmap/published_footprint"@422 points=null@480
polygon: nav2_collision_monitor/src/circle.cpp radius=null@98
monitored scan: nav2_collision_monitor/src/source.cpp topic="scan"@65 enabled=true@70
"""
"""Kinds of nodes, plug-ins, and groups: source file, then `name=default@line` for each parameter."""


@functools.cache
def declared_defaults() -> Mapping[str, Mapping[str, Declared]]:
    """Return the declared parameters of each kind of node, plug-in, or group in one."""
    found: dict[str, dict[str, Declared]] = {}
    for entry in _TABLE.replace("\n  ", " ").strip().splitlines():
        kinds, _, rest = entry.partition(": ")
        file, *parameters = rest.split()
        for kind in kinds.split(", "):
            group = found.setdefault(kind, {})
            for parameter in parameters:
                name, _, text = parameter.partition("=")
                default, _, line = text.rpartition("@")
                group[name] = Declared(json.loads(default), f"{file}:{line}")
    return found
