"""Numbers that Nav2 starts with: read as Nav2 reads them, or named with what is used in their place."""

from operator import attrgetter

import pytest
from table import each_row

from vastflow.sim.model.faults import FileError
from vastflow.sim.nav2.parameter_files.chosen import parameters_of
from vastflow.sim.nav2.parameter_files.document import parse
from vastflow.sim.nav2.parameter_files.findings import findings
from vastflow.sim.nav2.parameter_files.interpretation import interpretation
from vastflow.sim.nav2.parameter_files.parameter_file import nav2_file

GOAL = "goal_checker_plugins: [g], g: {plugin: 'nav2_controller::StoppedGoalChecker', "
PROGRESS = "progress_checker_plugins: [p], p: {plugin: 'nav2_controller::PoseProgressChecker', "
MPPI = "controller_plugins: [A], A: {plugin: 'nav2_mppi_controller::MPPIController', critics: [GoalCritic], "
DWB = "controller_plugins: [A], A: {plugin: 'dwb_core::DWBLocalPlanner', critics: [GoalDist], "
RPP = "controller_plugins: [A], A: {plugin: 'nav2_regulated_pure_pursuit_controller::RegulatedPurePursuitController', "
HYBRID = "planner_plugins: [A], A: {plugin: 'nav2_smac_planner::SmacPlannerHybrid', "
LAYER = "plugins: [l], l: {plugin: 'nav2_costmap_2d::InflationLayer', "
SCAN = (
    "plugins: [l], l: {plugin: 'nav2_costmap_2d::ObstacleLayer', observation_sources: s, s: {max_obstacle_height: 2.0, "
)
AREA = (
    "observation_sources: [s], s: {type: scan}, polygons: [a], a: {type: circle, radius: 0.5, action_type: slowdown, "
)


def read(node, text):
    body = f"{{ros__parameters: {{{text}{'}' * (text.count('{') - text.count('}'))}}}}}"
    nested = f"{{{node}: {body}}}" if node.endswith("costmap") else body
    return interpretation(parse(f"{node}: {nested}", "nav2.yaml"))


@each_row(
    ("node", "text", "path", "value"),
    [
        ("controller_server", f"{GOAL}xy_goal_tolerance: -0.3", "goal_checker.xy_goal_tolerance", -0.3),
        ("controller_server", f"{GOAL}trans_stopped_velocity: -1.0", "goal_checker.trans_stopped_velocity", -1.0),
        ("controller_server", f"{PROGRESS}required_movement_angle: .inf", "progress_checker.required_movement_angle", 7.0),
        ("controller_server", f"{PROGRESS}movement_time_allowance: .inf", "progress_checker.movement_time_allowance", 1e6),
        ("controller_server", f"{MPPI}GoalCritic: {{cost_weight: -5.0", "controller.GoalCritic.cost_weight", -5.0),
        ("controller_server", f"{MPPI}GoalCritic: {{threshold_to_consider: -1.0", "controller.GoalCritic.threshold_to_consider", 1.0),
        ("controller_server", f"{MPPI}gamma: -0.015", "controller.gamma", -0.015),
        ("controller_server", f"{DWB}decel_lim_x: 2.5", "controller.decel_lim_x", 2.5),
        ("controller_server", f"{DWB}xy_goal_tolerance: -0.25", "controller.xy_goal_tolerance", 0.25),
        ("controller_server", f"{RPP}desired_linear_vel: 0.0", "controller.desired_linear_vel", 0.0),
        ("controller_server", f"{RPP}cost_scaling_dist: -0.6", "controller.cost_scaling_dist", 0.0),
        ("controller_server", f"{RPP}rotate_to_heading_angular_vel: -1.8", "controller.rotate_to_heading_angular_vel", -1.8),
        ("planner_server", f"{HYBRID}reverse_penalty: 0.5", "planner.reverse_penalty", 0.5),
        ("planner_server", f"{HYBRID}non_straight_penalty: 0.9", "planner.non_straight_penalty", 0.9),
        ("planner_server", f"{HYBRID}tolerance: -0.5", "planner.tolerance", 0.0),
        ("planner_server", f"{HYBRID}minimum_turning_radius: -0.4", "planner.minimum_turning_radius", 0.0),
        ("local_costmap", f"{LAYER}inflation_radius: 12.0", "local_costmap.inflation_layer.inflation_radius", 12.0),
        ("local_costmap", f"{LAYER}inflation_radius: -0.5", "local_costmap.inflation_layer.inflation_radius", 0.0),
        ("local_costmap", f"{SCAN}obstacle_max_range: -2.5", "local_costmap.obstacle_layer.obstacle_max_range", 2.5),
        ("local_costmap", f"{SCAN}raytrace_max_range: .inf", "local_costmap.obstacle_layer.raytrace_max_range", 1000.0),
        ("local_costmap", "robot_radius: -0.3", "local_costmap.robot_radius", 0.3),
        ("local_costmap", "footprint_padding: -0.02", "local_costmap.footprint_padding", -0.02),
        ("amcl", "min_particles: -1, max_particles: -1", "amcl.max_particles", 2000),
        ("amcl", "min_particles: -1, max_particles: 100", "amcl.max_particles", 500),
        ("amcl", "z_hit: 2.0", "amcl.z_hit", 2.0),
        ("collision_monitor", f"{AREA}slowdown_ratio: 1.5", "collision_monitor.zones.0.slowdown_ratio", 1.0),
        ("collision_monitor", f"{AREA}min_points: 0", "collision_monitor.zones.0.min_points", 0),
    ],
)  # fmt: skip
def test_number_is_modeled_as_nav2_takes_it(node, text, path, value):
    found = read(node, text)
    owner, _, name = path.rpartition(".")
    group = found.parameters.collision_monitor.zones[0] if ".zones." in path else attrgetter(owner)(found.parameters)
    assert getattr(group, name) == value
    assert {each.path[-1]: each.status for each in findings(found)}[name] == "modeled"


@each_row(
    ("node", "text", "name", "used"),
    [
        ("controller_server", f"{MPPI}batch_size: 1000000", "batch_size", 100_000),
        ("controller_server", f"{MPPI}model_dt: 0.033}}, controller_frequency: 40.0", "model_dt", 0.05),
        ("controller_server", f"{DWB}GoalDist: {{scale: -24.0", "scale", 0.0),
        ("controller_server", "controller_frequency: 0.1", "controller_frequency", 0.5),
        ("planner_server", f"{HYBRID}cost_penalty: -2.0", "cost_penalty", 0.0),
        ("local_costmap", "update_frequency: 0.0", "update_frequency", 0.05),
        ("local_costmap", "width: 500", "width", 100),
        ("local_costmap", f"{LAYER}cost_scaling_factor: -3.0", "cost_scaling_factor", 0.0),
        ("amcl", "max_beams: 1", "max_beams", 2),
    ],
)  # fmt: skip
def test_number_beyond_the_modeled_range_differs_and_the_bound_is_used(node, text, name, used):
    (row,) = [each for each in findings(read(node, text)) if each.path[-1] == name]
    assert (row.status, row.used, row.why) == ("differs", used, f"{used:g} is used, where the modeled range ends")


@each_row(
    ("node", "text"),
    [
        ("controller_server", "controller_frequency: 0.0"),
        ("controller_server", f"{MPPI}PathAngleCritic: {{}}, PathAngleCritic.mode: 3, vx_std: 0.0"),
        ("local_costmap", "update_frequency: -1.0"),
        ("local_costmap", "width: 0"),
        ("local_costmap", "resolution: 0.0"),
        ("amcl", "alpha1: -0.1"),
        ("velocity_smoother", "max_velocity: [-0.5, 0.0, 2.0]"),
        ("velocity_smoother", "max_decel: [2.5, 0.0, 3.2]"),
    ],
)
def test_number_that_nav2_fails_with_is_refused(node, text):
    with pytest.raises(FileError, match="expected a number in"):
        read(node, text)


def test_number_of_a_campaign_is_refused_beyond_the_modeled_range(tmp_path):
    (file := tmp_path / "nav2.yaml").write_text("local_costmap: {local_costmap: {ros__parameters: {width: 500}}}")
    system = {"nav2_params": nav2_file(file)}
    assert parameters_of(system).local_costmap.width == 100
    with pytest.raises(FileError, match=r"width: expected a number in \[1, 100\], got 500"):
        parameters_of({**system, "width": 500})


def test_step_of_the_model_is_compared_as_the_file_has_it():
    assert read("controller_server", f"{MPPI}model_dt: 0.033}}, controller_frequency: 40.0").parameters.controller
    with pytest.raises(FileError, match=r"30\.303 or more for a model_dt of 0\.033 s, as Nav2 does not start"):
        read("controller_server", f"{MPPI}model_dt: 0.033}}, controller_frequency: 20.0")


@each_row(
    ("footprint", "used"),
    [
        ("[[0.3, 0.2], [0.3, -0.2], [-0.3, -0.2], [-0.3, 0.2]]", "[[0.3, 0.2], [0.3, -0.2], [-0.3, -0.2], [-0.3, 0.2]]"),
        ("[[0.3 0.2] [0.3 -0.2] [-0.3 0.0]]", "[[0.3 0.2] [0.3 -0.2] [-0.3 0.0]]"),
        ("[[0.3, 0.2], [0.3, -0.2]]", "[]"),
        ("[[0.3, 0.2, 0.0], [0.3, -0.2, 0.0], [-0.3, 0.0, 0.0]]", "[]"),
        ("[0.3, 0.2]", "[]"),
        ("[[0.3, 0.2], [0.3, -0.2], [-0.3, 0.0]", "[]"),
    ],
)  # fmt: skip
def test_footprint_that_nav2_can_not_parse_leaves_the_radius(footprint, used):
    found = read("local_costmap", f"footprint: '{footprint}', robot_radius: 0.4")
    assert found.parameters.local_costmap.footprint == used
    assert any(path[-1] == "footprint" for path in found.reader.warnings) == (used == "[]")
