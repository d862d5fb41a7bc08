"""What is said of each parameter of a Nav2 parameter file."""

import re
from pathlib import Path

from table import each_row

from vastflow.sim.nav2.parameter_files.built_in import TABLES, BuiltIn
from vastflow.sim.nav2.parameter_files.document import parse
from vastflow.sim.nav2.parameter_files.findings import findings, left_out
from vastflow.sim.nav2.parameter_files.interpretation import document_of, interpretation
from vastflow.sim.nav2.parameter_files.nodes import (
    FILTERS,
    GOAL_CHECKERS,
    LAYERS,
    PATH_HANDLERS,
    PLANNERS,
    PROGRESS_CHECKERS,
)
from vastflow.sim.nav2.parameters.stack import NavParameters


def read(text):
    return interpretation(parse(text, "nav2.yaml"))


def statuses(text):
    return {".".join(found.path[2:]): found.status for found in findings(read(text))}


def test_parameter_is_modeled_built_in_without_effect_different_or_not_modeled():
    found = statuses(
        "amcl: {ros__parameters: {alpha1: 0.1, laser_model_type: likelihood_field, scan_topic: s, recovery_alpha_slow: 0.1, x: 1}}"
    )
    assert found == {
        "alpha1": "modeled",
        "laser_model_type": "built in",
        "scan_topic": "no effect",
        "recovery_alpha_slow": "differs",
        "x": "not modeled",
    }


def test_difference_names_what_is_built_in():
    (found,) = findings(read("controller_server: {ros__parameters: {costmap_update_timeout: 0.5}}"))
    assert (found.status, found.used, found.place) == ("differs", 0.3, (1, 63))


@each_row(
    ("rule", "value"),
    [
        (BuiltIn((20.0, 1.0)), 20.0),
        (BuiltIn(((0.0, 0.0),)), [0.0, 0.0]),
        (BuiltIn(low=0.2), "0.2 or more"),
        (BuiltIn(high=0.2), "0.2 or less"),
        (BuiltIn(includes=("a", "b")), ["a", "b"]),
    ],
)
def test_what_is_built_in_says_itself(rule, value):
    assert rule.value == value


def test_polygon_for_a_footprint_is_modeled_and_counts_in_place_of_the_radius():
    polygon = "[[0.2, 0.2], [0.2, -0.2], [-0.2, 0.0]]"
    text = f"local_costmap: {{local_costmap: {{ros__parameters: {{footprint: '{polygon}', robot_radius: 0.3}}}}}}"
    found, radius = findings(read(text))
    assert (found.status, found.used) == ("modeled", polygon)
    assert (radius.status, radius.why) == ("no effect", "the polygon footprint replaces it")


def test_without_a_polygon_the_radius_counts():
    text = "local_costmap: {local_costmap: {ros__parameters: {footprint: '[]', robot_radius: 0.3}}}"
    assert [(found.status, found.used) for found in findings(read(text))] == [("modeled", "[]"), ("modeled", 0.3)]


def test_unknown_node_is_spoken_of_as_a_whole():
    found = findings(
        read("amcl: {ros__parameters: {}}\nslam_toolbox: {ros__parameters: {a: 1, b: {c: 2}, use_sim_time: true}}")
    )
    assert [(f.status, f.about[0]) for f in found[:2]] == [("not modeled", "slam_toolbox")] * 2
    assert {len(f.about) for f in found[:2]} == {2}
    assert found[2].status == "no effect"


def test_unknown_parameter_of_a_plug_in_is_spoken_of_by_itself():
    text = "controller_server: {ros__parameters: {goal_checker_plugins: [g], g: {plugin: nav2_controller::SimpleGoalChecker, x: 1}}}"
    *_, found = findings(read(text))
    assert (found.status, found.about, found.why) == ("not modeled", found.path, "")


def test_nodes_that_no_mission_needs_have_no_effect():
    assert statuses("amcl: {ros__parameters: {}}\nsmoother_server: {ros__parameters: {smoother_plugins: [s]}}") == {
        "smoother_plugins": "no effect"
    }


def test_another_behavior_tree_is_not_the_one_built_in():
    tree = "navigate_to_pose_w_replanning_and_recovery.xml"
    assert statuses(
        f"amcl: {{ros__parameters: {{}}}}\nbt_navigator: {{ros__parameters: {{default_nav_to_pose_bt_xml: /opt/{tree}}}}}"
    ) == {"default_nav_to_pose_bt_xml": "built in"}
    assert statuses(
        "amcl: {ros__parameters: {}}\nbt_navigator: {ros__parameters: {default_nav_to_pose_bt_xml: mine.xml}}"
    ) == {"default_nav_to_pose_bt_xml": "differs"}


@each_row(
    ("text", "asked_for"),
    [
        (
            "controller_server: {ros__parameters: {controller_plugins: [Drive], Drive: {plugin: 'dwb_core/DWBLocalPlanner', critics: []}}}",
            "FollowPath",
        ),
        (
            "planner_server: {ros__parameters: {planner_plugins: [Drive], Drive.plugin: nav2_navfn_planner/NavfnPlanner}}",
            "GridBased",
        ),
    ],
)
def test_name_that_the_default_trees_do_not_ask_for_is_spoken_of(text, asked_for):
    """With them Nav2 fails at every goal; a tree of the robot's own may ask for it."""
    said, *others = findings(read(text))
    why = f"the default behavior trees ask for {asked_for}, which Nav2 would not find; Drive is used"
    assert (said.status, said.why) == ("not modeled", why)
    assert {found.status for found in others} == {"modeled"}
    assert statuses(text.replace("Drive", asked_for)).popitem()[1] == "modeled"


def test_plug_ins_that_no_list_has_are_without_effect():
    text = "planner_server: {ros__parameters: {planner_plugins: [GridBased], GridBased.plugin: nav2_navfn_planner::NavfnPlanner, Old: {plugin: x::Y, a: 1}}}"
    assert statuses(text)["Old.a"] == "no effect"


@each_row(
    ("text", "status"),
    [
        ("planner_server: {ros__parameters: {GridBased: {plugin: nav2_smac_planner/SmacPlanner2D, X}}}", "built in"),
        ("planner_server: {ros__parameters: {GridBased: {plugin: nav2_smac_planner/SmacPlanner2D, Y}}}", "differs"),
        ("amcl: {ros__parameters: {}}\nbt_navigator: {ros__parameters: {bt_loop_duration: 20}}", "built in"),
        ("amcl: {ros__parameters: {}}\nbt_navigator: {ros__parameters: {bt_loop_duration: 100}}", "differs"),
    ],
)
def test_eight_neighbors_and_trees_ticked_with_the_stack_are_built_in(text, status):
    text = text.replace("X", "motion_model_for_search: MOORE").replace("Y", "motion_model_for_search: VON_NEUMANN")
    *_, found = findings(read(text))
    assert found.status == status


def test_frame_may_have_the_robots_name_before_it():
    def status(frame):
        return statuses(f"local_costmap: {{local_costmap: {{ros__parameters: {{global_frame: '{frame}'}}}}}}")

    assert status("robot1odom") == status("<robot_namespace>/odom") == {"ros__parameters.global_frame": "built in"}
    assert status("map") == {"ros__parameters.global_frame": "differs"}


def test_behavior_that_is_listed_and_not_one_of_nav2s_is_not_modeled():
    text = "behavior_server: {ros__parameters: {behavior_plugins: [spin, backup, wait, dance], dance: {plugin: x::Y, a: 1}}}"
    assert statuses(text) == {
        "behavior_plugins": "built in",
        "dance.plugin": "not modeled",
        "dance.a": "not modeled",
    }


def test_what_is_left_out_is_known_with_its_value():
    found = {
        ".".join(path[2:]): value for path, value in left_out(read("amcl: {ros__parameters: {pf_err: 0.1}}")).items()
    }
    assert "pf_err" not in found
    assert found["pf_z"] == 0.99


def test_nothing_that_is_modeled_is_called_built_in():
    modeled = {path[-1] for path in interpretation(document_of(NavParameters())).reader.fields}
    assert (
        modeled & {name for kind in ("amcl", "scan", "NavfnPlanner", "velocity_smoother") for name in TABLES[kind]}
        == set()
    )


@each_row(
    ("rule", "agreeing", "other"),
    [
        (BuiltIn((20.0,)), 20, 10.0),
        (BuiltIn((True,)), True, 1),
        (BuiltIn((1,)), 1.0, True),
        (BuiltIn(((0.0, 0.0),)), [0.0, 0], [0.0]),
        (BuiltIn(("a::B",)), "a/B", "c::B"),
        (BuiltIn(low=0.2), 2.0, 0.1),
        (BuiltIn(high=0.2), 0, "low"),
        (BuiltIn(includes=("a", "b")), ["b", "c", "a"], ["a"]),
    ],
)
def test_what_is_built_in_knows_the_values_that_mean_it(rule, agreeing, other):
    assert rule.agrees(agreeing)
    assert not rule.agrees(other)


def test_plug_in_group_with_a_value_of_its_own_is_not_modeled():
    text = "{controller_plugins: [F], F: {plugin: 'nav2_mppi_controller::MPPIController', critics: [GoalCritic], GoalCritic: true}}"
    assert statuses(f"controller_server: {{ros__parameters: {text}}}")["F.GoalCritic"] == "not modeled"


@each_row("plugins", [PLANNERS, PROGRESS_CHECKERS, GOAL_CHECKERS, PATH_HANDLERS, LAYERS, FILTERS])
def test_docs_list_the_modeled_classes(plugins):
    page = (Path(__file__).parents[2] / "docs" / "use-your-nav2-parameters.md").read_text()
    (row,) = (line for line in page.splitlines() if line.strip().startswith(f"| {plugins.what} "))
    assert re.findall(r"`(\w+::\w+)`", row) == list(plugins.modeled)
