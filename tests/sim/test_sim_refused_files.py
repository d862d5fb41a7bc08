"""Nav2 parameter files with which Nav2 does not start, or starts and refuses every path."""

import warnings
from operator import attrgetter

import pytest
from table import each_row

from vastflow.sim.model.polygon import vertices_of
from vastflow.sim.nav2.costmaps.inflation import cost_stamp
from vastflow.sim.nav2.costmaps.outline import inscribed_radius_m, inscribed_radius_of, outline_of
from vastflow.sim.nav2.parameter_files.chosen import parameters_of
from vastflow.sim.nav2.parameter_files.document import parse
from vastflow.sim.nav2.parameter_files.interpretation import interpretation
from vastflow.sim.nav2.parameter_files.parameter_file import nav2_file
from vastflow.sim.nav2.parameter_files.refusals import refusals

RPP = "{plugin: 'nav2_regulated_pure_pursuit_controller::RegulatedPurePursuitController'}"
SIMPLE = "{plugin: 'nav2_controller::SimpleGoalChecker', xy_goal_tolerance: 0.05}"
LYRICAL = "path_handler_plugins: [p], p: {plugin: 'nav2_controller::FeasiblePathHandler'}"
SHIM_CLASS = "'nav2_rotation_shim_controller::RotationShimController'"
SHIM = f"controller_plugins: [FollowPath], FollowPath: {{plugin: {SHIM_CLASS}"
MONITOR = "observation_sources: [scan, cloud], cloud.type: pointcloud, polygons: [p], p: {"
APPROACH = f"{MONITOR}type: polygon, action_type: approach"
CIRCLE = f"{MONITOR}type: circle, action_type: slowdown"
HYBRID = "planner_plugins: [GridBased], GridBased: {plugin: 'nav2_smac_planner::SmacPlannerHybrid'"
MOVING = "{plugin: 'nav2_controller::SimpleProgressChecker'}"


def controller_server(text):
    return interpretation(parse(f"controller_server: {{ros__parameters: {{{text}}}}}", "nav2.yaml"))


def mppi(critics, text=""):
    own = f"{{plugin: 'nav2_mppi_controller::MPPIController', critics: [{critics}]{text}}}"
    return controller_server(f"controller_plugins: [A], A: {own}").parameters.controller


@each_row(
    ("text", "is_followed"),
    [
        (f"goal_checker_plugins: [a, b], a: {SIMPLE}, b: {SIMPLE}", False),
        (f"goal_checker_plugins: [general_goal_checker, b], general_goal_checker: {SIMPLE}, b: {SIMPLE}", False),
        (f"progress_checker_plugins: [a, b], a: {MOVING}, b: {MOVING}", False),
        (f"goal_checker_plugins: [a], a: {SIMPLE}", True),
        (f"goal_checker_plugins: [a, a], a: {SIMPLE}", True),
        ("progress_checker_plugins: []", True),
        (
            f"{LYRICAL}, goal_checker_plugins: [general_goal_checker, b], general_goal_checker: {SIMPLE}, b: {SIMPLE}",
            True,
        ),
    ],
)
def test_several_checkers_without_one_named_by_tree_refuse_every_path(text, is_followed):
    found = controller_server(text)
    assert found.parameters.controller_server.refusal == (0 if is_followed else 100)
    assert any("refuses each path" in consequence for _, consequence in found.reader.warnings.values()) != is_followed


@each_row(
    ("tree", "is_followed"),
    [
        ("default_nav_to_pose_bt_xml: /home/me/mine.xml", True),
        ("default_nav_through_poses_bt_xml: mine.xml", True),
        ("default_nav_to_pose_bt_xml: /opt/ros/navigate_w_replanning_time.xml", False),
        ("default_nav_to_pose_bt_xml: ''", False),
        ("odom_topic: mine.xml", False),
    ],
)
def test_several_checkers_count_where_the_tree_is_a_users(tree, is_followed):
    own = f"goal_checker_plugins: [a, b], a: {SIMPLE}, b: {{plugin: 'nav2_controller::StoppedGoalChecker'}}"
    text = f"controller_server: {{ros__parameters: {{{own}}}}}\nbt_navigator: {{ros__parameters: {{{tree}}}}}"
    found = interpretation(parse(text))
    assert found.parameters.controller_server.refusal == (0 if is_followed else 100)
    assert not is_followed or found.parameters.goal_checker.xy_goal_tolerance == 0.05
    said = {path[-1]: words for path, words in found.reader.warnings.items()}
    words, consequence = said["goal_checker_plugins"]
    assert ("a is used, as if" in consequence and "mine.xml" in words) == is_followed


NAVFN = "{plugin: nav2_navfn_planner/NavfnPlanner}"


@each_row(
    ("text", "tree", "refusals", "words"),
    [
        (f"controller_server: {{ros__parameters: {{controller_plugins: [F], F: {RPP}}}}}", "", (101, 0), "FollowPath"),
        (
            f"controller_server: {{ros__parameters: {{controller_plugins: [F, G], F: {RPP}, G: {RPP}}}}}",
            "/opt/navigate_w_replanning_time.xml",
            (101, 0),
            "FollowPath",
        ),
        (f"controller_server: {{ros__parameters: {{controller_plugins: [F], F: {RPP}}}}}", "mine.xml", (0, 0), ""),
        (
            f"controller_server: {{ros__parameters: {{controller_plugins: [F, FollowPath], F: {RPP}, FollowPath: {RPP}}}}}",
            "",
            (0, 0),
            "",
        ),
        (f"planner_server: {{ros__parameters: {{planner_plugins: [P], P: {NAVFN}}}}}", "", (0, 201), "GridBased"),
        (f"planner_server: {{ros__parameters: {{planner_plugins: [P], P: {NAVFN}}}}}", "mine.xml", (0, 0), ""),
    ],
)
def test_action_ends_where_no_tree_asks_for_the_plug_in(text, tree, refusals, words):
    found = interpretation(
        parse(f"{text}\nbt_navigator: {{ros__parameters: {{default_nav_to_pose_bt_xml: '{tree}'}}}}")
    )
    servers = found.parameters.controller_server, found.parameters.planner_server
    assert tuple(server.refusal for server in servers) == refusals
    said = [words for words, then in found.reader.warnings.values() if "missions abort" in then]
    assert len(said) == (words != "")
    assert all(f"ask for {words}, and there is " in each for each in said)


def test_controller_of_a_campaigns_key_is_found(tmp_path):
    own = "{plugin: 'dwb_core::DWBLocalPlanner', critics: [PathDist]}"
    text = (
        f"controller_server: {{ros__parameters: {{controller_plugins: [FollowPath, D], FollowPath: {RPP}, D: {own}}}}}"
    )
    (file := tmp_path / "nav2.yaml").write_text(text)
    assert parameters_of({"nav2_params": nav2_file(file), "controller": "dwb"}).controller_server.refusal == 0


@each_row(
    ("text", "words"),
    [
        ("controller_frequency: 20", "expected a double, such as 20.0"),
        ("min_x_velocity_threshold: 1", "expected a double"),
        (f"controller_plugins: [A], A: {RPP[:-1]}, lookahead_dist: 1}}", "expected a double"),
        ("speed_limit_topic: 3", "expected text"),
        ("publish_zero_velocity: 1", "expected true or false"),
        ("speed_limit_topic: [a, 1]", "expected a list of one type, as no node reads the file otherwise"),
        ("own: [1.0, null]", "expected a list of one type"),
        ("own: []", "expected items, or no such line, as the node ends otherwise"),
        ("progress_checker_plugins: []", "expected items"),
        ("publish_zero_velocity: null", "expected true or false, as the node ends otherwise, got nothing"),
        (f"controllers: [Base], Base: {RPP}", "No controller_plugins names it. Add 'controller_plugins: [Base]'"),
    ],
)
def test_file_with_which_a_node_ends_is_refused(text, words):
    (fault,) = refusals(controller_server(text))
    assert words in str(fault)


@each_row(
    ("node", "text", "count"),
    [
        ("velocity_smoother", "max_velocity: [1, 0, 2]", 1),
        ("velocity_smoother", "max_velocity: [0.5, 0, 2.0]", 1),
        ("velocity_smoother", "max_velocity: [0.5, 0.0, 2.0]", 0),
        ("amcl", "max_beams: 60.0", 1),
        ("amcl", "alpha1: 1", 1),
        ("velocity_smoother", f"deadband_velocity: [{'9' * 400}, 0.0, 2.0]", 1),
        ("amcl", "alpha1: 1.0", 0),
        ("amcl", "robot_model_type: differential", 0),
        ("amcl", "map_topic: null", 0),
        ("amcl", "own: [$(var x), 1.0]", 0),
        ("my_node", "own: []", 0),
        ("my_node", "use_sim_time: 1", 1),
        ("my_node", "use_sim_time: $(var use_sim_time)", 0),
        ("amcl", "use_sim_time: true", 0),
        ("bt_navigator", "transform_tolerance: 1", 1),
        ("bt_navigator", "bt_loop_duration: 10.0", 1),
        ("bt_navigator", "bt_loop_duration: 10, transform_tolerance: 0.1, plugin_lib_names: [a]", 0),
        ("costmap_filter_info_server", "base: 100, multiplier: -1", 2),
        ("my_info", "filter_info_topic: info, base: 100", 1),
        ("controller_server", f"{SHIM}, primary_controller: {RPP[9:-1]}, angular_dist_threshold: 1}}", 1),
        ("controller_server", f"{SHIM}, primary_controller: {RPP}, simulate_ahead_time: 1}}", 1),
        (
            "controller_server",
            f"{SHIM}, primary_controller: {RPP[9:-1]}, lookahead_dist: 1, simulate_ahead_time: 1}}",
            2,
        ),
        ("controller_server", f"controller_plugins: [A], A: {RPP}, B: {{plugin: {SHIM_CLASS}, closed_loop: 1}}", 0),
        ("collision_monitor", f"{APPROACH}, time_before_collision: 2}}", 1),
        ("collision_monitor", f"{APPROACH}, min_points: 4.0}}", 1),
        ("collision_monitor", f"{CIRCLE}, radius: 1}}", 1),
        ("collision_monitor", f"{CIRCLE}, radius: 1.0, slowdown_ratio: 1}}", 1),
        ("collision_monitor", f"{CIRCLE}, radius: 1.0, min_points: 4}}", 0),
        ("collision_monitor", f"{CIRCLE}, radius: 1.0}}, scan: {{topic: 3}}", 1),
        ("collision_monitor", f"{CIRCLE}, radius: 1.0}}, scan: {{min_height: 0}}", 0),  # a scan declares none
        ("collision_monitor", f"{CIRCLE}, radius: 1.0}}, cloud: {{enabled: 1}}", 1),
        ("collision_monitor", f"{CIRCLE}, radius: 1.0}}, cloud: {{min_height: 0, max_height: 1, min_range: 0}}", 3),
        ("collision_monitor", f"{CIRCLE}, radius: 1.0}}, scan: {{source_timeout: 1}}", 1),
        ("collision_monitor", "use_realtime_priority: 1", 1),
        ("velocity_smoother", "stamp_smoothed_velocity_with_smoothing_time: 1, use_realtime_priority: 1", 2),
        ("planner_server", f"{HYBRID}, smoother: {{max_iterations: 1000.0}}}}", 1),
        ("my_node", "own: [1, 1.0]", 1),
    ],
)
def test_numbers_of_another_type_are_refused(node, text, count):
    found = interpretation(parse(f"{node}: {{ros__parameters: {{{text}}}}}\nwaypoint_follower: {{ros__parameters: }}"))
    assert len([*refusals(found)]) == count


@each_row(
    ("kind", "source", "words"),
    [
        (
            "ObstacleLayer",
            "data_type: Range",
            "expected one of LaserScan, PointCloud2, as the node ends otherwise, got 'Range'",
        ),
        ("VoxelLayer", "data_type: PointCloud", "expected one of LaserScan, PointCloud2"),
        ("ObstacleLayer", "data_type: PointCloud2", ""),
        ("VoxelLayer", "topic: scan", ""),
        ("monitor", "type: laser", "expected one of scan, pointcloud, range, polygon, costmap"),
        ("monitor", "type: range", ""),
        ("monitor", "topic: scan", ""),
    ],
)
def test_source_of_a_type_that_nav2_has_not_is_refused(kind, source, words):
    own = f"o: {{plugin: 'nav2_costmap_2d::{kind}', observation_sources: a s, s: {{{source}}}, unlisted: {{data_type: x}}}}"
    text = f"local_costmap: {{local_costmap: {{ros__parameters: {{plugins: [o], {own}}}}}}}"
    if kind == "monitor":
        text = f"collision_monitor: {{ros__parameters: {{polygons: [p], p: {{type: polygon, action_type: approach}}, observation_sources: [s], s: {{{source}}}}}}}"
    assert [words in str(fault) for fault in refusals(interpretation(parse(text)))] == [True] * bool(words)


@each_row(
    ("critics", "more", "path", "weight"),
    [
        ("GoalCritic, GoalCritic, GoalCritic", "", "GoalCritic.cost_weight", 15.0),
        ("CostCritic, CostCritic", ", CostCritic: {cost_weight: 2.0}", "CostCritic.cost_weight", 4.0),
        ("GoalCritic, GoalCritic", ", GoalCritic: {enabled: false}", "GoalCritic.enabled", False),
    ],
)
def test_critic_counts_as_often_as_it_is_listed(critics, more, path, weight):
    assert attrgetter(path)(mppi(critics, more)) == weight


def test_repeated_critic_counts_twice():
    once, twice = mppi("GoalCritic, PathAlignCritic"), mppi("GoalCritic, PathAlignCritic, PathAlignCritic")
    assert twice.PathAlignCritic.cost_weight == 2.0 * once.PathAlignCritic.cost_weight == 20.0
    assert twice.GoalCritic == once.GoalCritic
    squared = mppi("TwirlingCritic, TwirlingCritic", ", TwirlingCritic: {cost_weight: 3.0, cost_power: 2}")
    assert squared.TwirlingCritic.cost_weight == pytest.approx(18.0**0.5)
    own = "{plugin: 'dwb_core::DWBLocalPlanner', critics: [PathDist, Far], PathDist: {scale: 2.0}, Far: {class: PathDist, scale: 3.0}}"
    assert controller_server(f"controller_plugins: [A], A: {own}").parameters.controller.PathDist.scale == 5.0


@each_row(
    "vertices",
    [
        "[0.3, 0.2], [0.3, -0.2], [-0.3, -0.2], [-0.3, 0.2]",
        "[0.3, 0.2], [0.3, -0.2], [-0.3, -0.2], [-0.3, 0.2], [0.3, 0.2]",
        "[0.3, 0.2], [0.3, -0.2], [-0.3, -0.2], [-0.3, 0.2], [0.3, 0.2], [0.3, 0.2]",
        "[0.3, 0.2], [0.3, -0.2], [0.3, -0.2], [-0.3, -0.2], [-0.3, 0.2]",
        "[0.3, 0.2], [0.3, 0.2], [0.3, -0.2], [-0.3, -0.2], [-0.3, 0.2]",
    ],
)
def test_repeated_vertices_count_once_and_warn_of_nothing(vertices):
    zone = f"z: {{type: polygon, action_type: stop, points: '[{vertices}]'}}"
    monitor = f"collision_monitor: {{ros__parameters: {{polygons: [z], {zone}, observation_sources: [s], s: {{}}}}}}"
    text = f"local_costmap: {{local_costmap: {{ros__parameters: {{footprint: '[{vertices}]'}}}}}}\n{monitor}"
    corners = [(0.3, 0.2), (0.3, -0.2), (-0.3, -0.2), (-0.3, 0.2)]
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        found, own = interpretation(parse(text)).parameters, parameters_of({"robot.polygon": f"[{vertices}]"})
        assert inscribed_radius_of(found) == inscribed_radius_of(own) == 0.2
    assert vertices_of(found.local_costmap.footprint) == vertices_of(own.robot.polygon) == tuple(corners)
    assert found.collision_monitor.zones[0].vertices == tuple(corners)


@each_row(
    ("own", "inscribed_m"),
    [
        # A padding below 0 lays vertices together, and Nav2 goes on with the line that is left (nav2_costmap_2d, footprint.cpp).
        ("footprint: '[[0.3, 0.2], [0.3, -0.2], [-0.3, -0.2], [-0.3, 0.2]]', footprint_padding: -0.2", 0.0),
        ("robot_radius: 0.22, footprint_padding: -0.22", 0.0),
        ("footprint: '[[0.3, 0.2], [0.3, -0.2], [-0.3, -0.2], [-0.3, 0.2], [0.3, 0.2]]'", 0.21),
        ("inflation_layer: {plugin: 'nav2_costmap_2d::InflationLayer', cost_scaling_factor: 50000.0}", 0.1078),
    ],
)
def test_odd_but_valid_costmap_warns_of_nothing(own, inscribed_m):
    text = f"local_costmap: {{local_costmap: {{ros__parameters: {{plugins: [inflation_layer], {own}}}}}}}"
    text = text if "inflation_layer: " in own else text.replace("plugins: [inflation_layer], ", "")
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        costmap = interpretation(parse(text)).parameters.local_costmap
        inscribed = inscribed_radius_m(outline_of(costmap))
        layer = costmap.inflation_layer
        stamp = cost_stamp(0.05, inscribed, layer.inflation_radius, layer.cost_scaling_factor)
    assert inscribed == pytest.approx(inscribed_m, abs=2e-3)
    assert stamp.max() == 254
