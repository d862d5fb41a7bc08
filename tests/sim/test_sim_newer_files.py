"""Valid Nav2 parameter files of other releases and forms: launch words, filters among the layers, special values."""

from dataclasses import replace
from operator import attrgetter

import pytest
from table import each_row

from vastflow.producers.campaign import system_file_of
from vastflow.producers.campaign_file.document import read_document as read_campaign
from vastflow.sim.model.faults import FileError
from vastflow.sim.nav2.parameter_files.chosen import parameters_of
from vastflow.sim.nav2.parameter_files.document import parse
from vastflow.sim.nav2.parameter_files.findings import findings
from vastflow.sim.nav2.parameter_files.interpretation import interpretation
from vastflow.sim.nav2.parameter_files.parameter_file import nav2_file
from vastflow.sim.nav2.parameter_files.refusals import refusals
from vastflow.sim.nav2.parameter_files.releases import release_of
from vastflow.sim.nav2.parameters.costmap import NEVER_HZ

INFLATION = "inflation_layer: {plugin: 'nav2_costmap_2d::InflationLayer'}"
GOAL = "general_goal_checker: {plugin: 'nav2_controller::SimpleGoalChecker'"
GOALS = "goal_checker_plugins: [general_goal_checker]"
KEEPOUT = "plugin: 'nav2_costmap_2d::KeepoutFilter', filter_info_topic: info"


def costmap(text):
    return f"global_costmap: {{global_costmap: {{ros__parameters: {{{text}}}}}}}"


def read(text):
    return interpretation(parse(text, "nav2.yaml"))


def test_launch_word_is_on_where_the_campaign_names_a_mask(tmp_path):
    file = tmp_path / "nav2.yaml"
    own = f"filters: [k], k: {{{KEEPOUT}, enabled: KEEPOUT_ZONE_ENABLED, override_lethal_cost: true}}"
    file.write_text(costmap(own))
    content = nav2_file(file)
    assert not parameters_of({"nav2_params": content}).global_costmap.keepout_filter.enabled
    assert parameters_of({"nav2_params": content, "keepout_mask": content}).global_costmap.keepout_filter.enabled
    statuses = {each.path[-1]: each.status for each in findings(read(costmap(own)))}
    assert (statuses["enabled"], statuses["override_lethal_cost"]) == ("modeled", "no effect")


def test_lethal_override_of_a_filter_is_read():
    own = f"{KEEPOUT}, override_lethal_cost: true, lethal_override_cost: 200"
    found = read(costmap(f"filters: [k], k: {{{own}}}"))
    q = found.parameters.global_costmap.keepout_filter
    assert (q.override_lethal_cost, q.lethal_override_cost) == (True, 200)
    assert {each.status for each in findings(found)} <= {"modeled", "no effect"}


def test_filter_in_the_list_of_layers_is_read():
    found = read(costmap(f"plugins: [inflation_layer, k], {INFLATION}, k: {{{KEEPOUT}}}")).parameters.global_costmap
    assert (found.keepout_filter.enabled, found.inflation_layer.enabled, found.static_layer.enabled) == (
        True,
        True,
        False,
    )


def test_keepout_filter_before_the_inflation_is_refused():
    with pytest.raises(FileError, match="'k' comes before the inflation, and Nav2 inflates its mask"):
        read(costmap(f"plugins: [k, inflation_layer], {INFLATION}, k: {{{KEEPOUT}}}"))


@each_row(
    ("text", "group", "name", "value"),
    [
        ("failure_tolerance: -1.0", "controller_server", "failure_tolerance", 1e6),
        ("failure_tolerance: 0.0", "controller_server", "failure_tolerance", 0.0),
        ("general_goal_checker: {xy_goal_tolerance: 0.0}", "goal_checker", "xy_goal_tolerance", 0.0),
        ("general_goal_checker: {yaw_goal_tolerance: 10.0}", "goal_checker", "yaw_goal_tolerance", 10.0),
        ("progress_checker: {movement_time_allowance: 0.0}", "progress_checker", "movement_time_allowance", 0.0),
        ("failure_tolerance: -2.0", "controller_server", "failure_tolerance", 0.0),  # any but -1 is no patience
        ("min_x_velocity_threshold: -1.0", "controller_server", "min_x_velocity_threshold", 0.0),
        ("costmap_update_timeout: -1.0", "controller_server", "costmap_update_timeout", -1.0),
        ("general_goal_checker: {yaw_goal_tolerance: -1.0}", "goal_checker", "yaw_goal_tolerance", -1.0),
        ("progress_checker: {required_movement_radius: -1.0}", "progress_checker", "required_movement_radius", -1.0),
        ("progress_checker: {movement_time_allowance: -1.0}", "progress_checker", "movement_time_allowance", -1.0),
    ],
)
def test_special_values_are_read(text, group, name, value):
    lists = "goal_checker_plugins: [general_goal_checker]"
    text = text.replace(
        "general_goal_checker: {", "general_goal_checker: {plugin: 'nav2_controller::SimpleGoalChecker', "
    )
    lists = f"{lists}, " if "general" in text else ""
    found = read(f"controller_server: {{ros__parameters: {{{lists}{text}}}}}").parameters
    assert getattr(getattr(found, group), name) == value


def test_launch_word_does_not_end_a_node():
    assert [*refusals(read(costmap(f"filters: [k], k: {{{KEEPOUT}, enabled: KEEPOUT_ZONE_ENABLED}}")))] == []
    assert len([*refusals(read(costmap("always_send_full_costmap: 'yes'")))]) == 1


RPP = "FollowPath: {plugin: 'nav2_regulated_pure_pursuit_controller::RegulatedPurePursuitController'"
MPPI = "FollowPath: {plugin: 'nav2_mppi_controller::MPPIController', critics: [GoalCritic]"


def server(text):
    return f"controller_server: {{ros__parameters: {{controller_plugins: [FollowPath], {text}}}}}"


DWB = "FollowPath: {plugin: 'dwb_core::DWBLocalPlanner', critics: [PathDist]"
ALIGN = f"{MPPI.replace('GoalCritic', 'PathAlignCritic')}, PathAlignCritic:"
SMAC = (
    "planner_server: {ros__parameters: {GridBased: {plugin: 'nav2_smac_planner::SmacPlanner2D', max_iterations: -5}}}"
)
DENOISE = "plugins: [d], d: {plugin: 'nav2_costmap_2d::DenoiseLayer'"


@each_row(
    ("text", "path", "value"),
    [
        (costmap("publish_frequency: 0.0").replace("global", "local"), "local_costmap.publish_frequency", NEVER_HZ),
        (costmap("publish_frequency: -1.0").replace("global", "local"), "local_costmap.publish_frequency", NEVER_HZ),
        (costmap(f"{DENOISE}, minimal_group_size: -1}}"), "global_costmap.denoise_layer.minimal_group_size", 0),
        (
            costmap(f"{DENOISE}, group_connectivity_type: 6}}"),
            "global_costmap.denoise_layer.group_connectivity_type",
            8,
        ),
        (
            costmap(f"filters: [k], k: {{{KEEPOUT}, lethal_override_cost: -1}}"),
            "global_costmap.keepout_filter.lethal_override_cost",
            252,
        ),
        (
            costmap("robot_radius: 0.0, footprint: '[[0.3, 0.2], [0.3, -0.2], [-0.3, -0.2], [-0.3, 0.2]]'"),
            "global_costmap.robot_radius",
            0.22,
        ),
        ("amcl: {ros__parameters: {min_particles: 3000}}", "amcl.max_particles", 3000),
        ("amcl: {ros__parameters: {resample_interval: 0}}", "amcl.resample_interval", 1),
        ("amcl: {ros__parameters: {update_min_d: -1.0}}", "amcl.update_min_d", -1.0),
        ("amcl: {ros__parameters: {laser_likelihood_max_dist: -1.0}}", "amcl.laser_likelihood_max_dist", 2.0),
        ("velocity_smoother: {ros__parameters: {velocity_timeout: -1.0}}", "velocity_smoother.velocity_timeout", -1.0),
        (
            "waypoint_follower: {ros__parameters: {wait_at_waypoint: {waypoint_pause_duration: -1}}}",
            "waypoint_follower.waypoint_pause_duration",
            0,
        ),
        (SMAC, "planner.max_iterations", -1),
        (
            server(f"{RPP}, inflation_cost_scaling_factor: 0.0}}"),
            "controller.use_cost_regulated_linear_velocity_scaling",
            False,
        ),
        (server(f"{DWB}, forward_prune_distance: -5.0}}"), "controller.forward_prune_distance", 100.0),
        (
            server(f"{ALIGN} {{max_path_occupancy_ratio: 2.0}}}}"),
            "controller.PathAlignCritic.max_path_occupancy_ratio",
            2.0,
        ),
    ],
)
def test_numbers_that_nav2_takes_otherwise_are_read_as_it_takes_them(text, path, value):
    assert attrgetter(path)(read(text).parameters) == value


@each_row(
    ("text", "release"),
    [
        ("ros__parameters: {a: 1}", "jazzy"),  # of no node
        (server(RPP + "}"), "jazzy"),
        (server(RPP + ", min_distance_to_obstacle: 0.4}"), "kilted"),
        (costmap(f"filters: [k], k: {{{KEEPOUT}, enabled: KEEPOUT_ZONE_ENABLED}}"), "kilted"),
        (server(RPP + ", max_linear_vel: 0.3}"), "lyrical"),
        (server(MPPI + ", model_delay_vx: 0.1}"), "lyrical"),
        # Other nodes' parameters may have any name.
        (server(RPP + "}") + "\nteleop: {ros__parameters: {max_linear_vel: 0.3}}", "jazzy"),
    ],
)
def test_release_is_guessed_from_the_names_in_a_file(text, release):
    assert release_of(parse(text)) == release


@each_row(
    ("text", "name", "used"),
    [
        (server(RPP + ", min_distance_to_obstacle: 0.4}"), "min_distance_to_obstacle", "0 or less"),
        (server(RPP + ", use_dynamic_window: true}"), "use_dynamic_window", False),
        (server(MPPI + ", model_delay_wz: 0.1}"), "model_delay_wz", 0.0),
        (server(f"{GOALS}, {GOAL}, xy_goal_tolerance_buffer: 0.1}}, {RPP}}}"), "xy_goal_tolerance_buffer", 0.0),
        (server(f"{GOALS}, {GOAL}, path_length_tolerance: 1.0}}, {RPP}}}"), "path_length_tolerance", "1000 or more"),
    ],
)
def test_parameter_of_a_newer_release_differs(text, name, used):
    (found,) = (each for each in findings(read(text)) if each.path[-1] == name)
    assert (found.status, found.used) == ("differs", used)


@each_row(
    ("release", "others"),
    [
        ("jazzy", set()),
        ("kilted", {"BackUp"}),
        ("lyrical", {"BackUp", "the goal", "within 4", "a trajectory", "no goal is"}),
    ],
)
def test_release_of_campaign_tells_differences(tmp_path, release, others):
    (tmp_path / "nav2.yaml").write_text(server(f"{GOALS}, {GOAL}}}, {MPPI}}}"))
    (file := tmp_path / "a.vast").write_text(f"execution: {{nav2_params: nav2.yaml, nav2_release: {release}}}")
    found = system_file_of(read_campaign(file), tmp_path)
    assert found.values["nav2_release"] == release
    said = [str(note.problem).partition(" ")[2] for note in found.notes if str(note.problem).startswith("since ")]
    assert {start for start in others if any(start in words for words in said)} == others
    assert len(said) == len(others)


@each_row(
    ("text", "own", "notes"),
    [
        (server(RPP + ", max_linear_vel: 0.3}"), "", ["the file is for Nav2 Lyrical, the first with 'max_linear_vel'"]),
        (
            server(RPP + ", min_distance_to_obstacle: 0.4}"),
            "",
            ["the file is for Nav2 Kilted, the first with 'min_distance_to_obstacle'"],
        ),
        (server(RPP + ", max_linear_vel: 0.3}"), ", nav2_release: jazzy", []),
        (server(RPP + "}"), "", []),
    ],
)
def test_guessed_release_is_noted(tmp_path, text, own, notes):
    (tmp_path / "nav2.yaml").write_text(text)
    (file := tmp_path / "a.vast").write_text(f"execution: {{nav2_params: nav2.yaml{own}}}")
    found = system_file_of(read_campaign(file), tmp_path).notes
    assert [note.problem for note in found if "the first with" in note.problem] == notes


def test_release_without_a_file_is_an_error(tmp_path):
    (file := tmp_path / "a.vast").write_text("execution: {nav2_release: kilted}")
    (fault,) = system_file_of(read_campaign(file), tmp_path).faults
    assert "Add nav2_params" in str(fault)


def test_several_goal_checkers_are_as_the_release_says():
    text = server(f"goal_checker_plugins: [g, general_goal_checker], g: {GOAL.partition(': ')[2]}}}, {GOAL}}}, {RPP}}}")
    found = []
    for release in ("jazzy", "lyrical"):
        document = parse(f"{text}")
        document = replace(document, values={**document.values, ("nav2_release",): release})
        found.append(interpretation(document).parameters.controller_server.refusal)
    assert found == [100, 0]


def test_speed_of_rpp_has_another_name_since_lyrical():
    speeds = [
        server(f"{RPP}, {each}}}") for each in ("max_linear_vel: 0.3", "desired_linear_vel: 0.2, max_linear_vel: 0.3")
    ]
    assert [read(text).parameters.controller.desired_linear_vel for text in speeds] == [0.3, 0.2]


def test_smoother_may_have_six_numbers_since_lyrical():
    text = "velocity_smoother: {ros__parameters: {max_velocity: [0.4, 0.1, 0.0, 0.0, 0.0, 1.5]}}"
    found = read(text)
    assert found.parameters.velocity_smoother.max_velocity == (0.4, 0.1, 1.5)
    assert [each.status for each in findings(found)] == ["modeled"]


@each_row(("release", "is_on"), [("lyrical", False), ("jazzy", True)])
def test_collision_monitor_may_be_off_since_lyrical(release, is_on):
    scan = "observation_sources: [scan], scan: {type: scan}"
    area = "polygons: [P], P: {type: polygon, action_type: approach}"
    document = parse(f"collision_monitor: {{ros__parameters: {{enabled: false, {area}, {scan}}}}}")
    document = replace(document, values={**document.values, ("nav2_release",): release})
    assert interpretation(document).parameters.collision_monitor.enabled == is_on


def test_signs_of_mppis_limits_are_mended_as_in_nav2():
    found = read(server(f"{MPPI}, ax_max: -2.0, ax_min: 2.5}}")).parameters.controller
    assert (found.ax_max, found.ax_min) == (2.0, -2.5)
    with pytest.raises(FileError, match="ax_min: expected a number"):
        read(server(f"{MPPI}, ax_min: fast}}"))


def test_path_of_dwb_may_be_searched_as_a_whole():
    assert read(server(f"{DWB}, forward_prune_distance: -1.0}}")).parameters.controller.forward_prune_distance == 100.0


@each_row(
    ("text", "name", "status"),
    [
        # Stamps, timeouts, folders, and what is shown of a mission make no other mission (1.3.12 velocity_smoother.cpp:149; Lyrical's bt_navigator).
        (
            "velocity_smoother: {ros__parameters: {NAME: false}}",
            "stamp_smoothed_velocity_with_smoothing_time",
            "no effect",
        ),
        ("bt_navigator: {ros__parameters: {NAME: 50}}", "default_cancel_timeout", "no effect"),
        ("bt_navigator: {ros__parameters: {NAME: [a]}}", "bt_search_directories", "no effect"),
        ("bt_navigator: {ros__parameters: {navigate_to_pose: {NAME: 2.0}}}", "search_window", "no effect"),
        ("bt_navigator: {ros__parameters: {navigate_through_poses: {NAME: 1669}}}", "groot_server_port", "no effect"),
        # The default trees call no DriveOnHeading.
        ("behavior_server: {ros__parameters: {drive_on_heading: {NAME: 2.5}}}", "acceleration_limit", "no effect"),
        ("behavior_server: {ros__parameters: {backup: {NAME: 2.5}}}", "acceleration_limit", "not modeled"),
        ("planner_server: {ros__parameters: {NAME: false}}", "allow_partial_planning", "built in"),
        ("planner_server: {ros__parameters: {NAME: true}}", "allow_partial_planning", "differs"),
        ("planner_server: {ros__parameters: {GridBased: {NAME: 4}}}", "max_cycles_factor", "built in"),
    ],
)
def test_note_of_parameter_tells_its_effect(text, name, status):
    whole = f"{text.replace('NAME', name)}\namcl: {{ros__parameters: {{max_beams: 60}}}}"
    (found,) = (each for each in findings(read(whole)) if each.path[-1] == name)
    assert found.status == status
