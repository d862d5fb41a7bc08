"""Parameters that a Nav2 file leaves out are as Nav2's code declares them."""

from table import each_row

from vastflow.sim.model.parameter import source_of
from vastflow.sim.nav2.parameter_files.declared import declared_defaults
from vastflow.sim.nav2.parameter_files.document import dotted, parse
from vastflow.sim.nav2.parameter_files.findings import defaults_row, omitted
from vastflow.sim.nav2.parameter_files.interpretation import document_of, interpretation
from vastflow.sim.nav2.parameter_files.nodes import FILTERS, GOAL_CHECKERS, LAYERS, NODES, PLANNERS, PROGRESS_CHECKERS
from vastflow.sim.nav2.parameter_files.reader import is_group
from vastflow.sim.nav2.parameters.dwb import DwbParameters
from vastflow.sim.nav2.parameters.mppi import MppiParameters
from vastflow.sim.nav2.parameters.rpp import RppParameters
from vastflow.sim.nav2.parameters.servers import RotationShim
from vastflow.sim.nav2.parameters.stack import NavParameters
from vastflow.sim.nav2.system.file import notes_of

RPP = "{plugin: 'nav2_regulated_pure_pursuit_controller::RegulatedPurePursuitController'}"
CONTROLLER = f"controller_server: {{ros__parameters: {{controller_plugins: [FollowPath], FollowPath: {RPP}}}}}\n"
OF_THE_SCAN = {"marking", "clearing", "obstacle_max_range", "obstacle_min_range", "raytrace_max_range"}
NOT_OF_JAZZY = {
    ("MPPI", "retry_scores"),
    ("ObstaclesCritic", "inflation_radius"),
    ("ObstaclesCritic", "cost_scaling_factor"),
}


def read(text):
    return interpretation(parse(CONTROLLER + text, "nav2.yaml"))


def costmap(source="{data_type: LaserScan, marking: true, clearing: true}", layer=""):
    own = f"o: {{plugin: 'nav2_costmap_2d::ObstacleLayer', observation_sources: s, {layer} s: {source}}}"
    return f"local_costmap: {{local_costmap: {{ros__parameters: {{rolling_window: true, plugins: [o], {own}}}}}}}"


def mppi(text=""):
    own = f"{{plugin: 'nav2_mppi_controller::MPPIController', critics: [GoalCritic]{text}}}"
    return f"controller_server: {{ros__parameters: {{controller_plugins: [A], A: {own}}}}}"


def modeled_groups():
    yield "RotationShim", RotationShim
    yield "monitored", NavParameters.model_fields["collision_monitor"].annotation
    yield from (("MPPI", MppiParameters), ("DWB", DwbParameters), ("RPP", RppParameters))
    for plugins in (PLANNERS, PROGRESS_CHECKERS, GOAL_CHECKERS, LAYERS, FILTERS):
        for name, each in plugins.modeled.items():
            yield name.rpartition("::")[2], each.model
    yield from ((name[-1], node.model) for name, node in NODES.items())


def test_declared_defaults_have_each_modeled_parameter():
    lacking = set()

    def check(kind, model):
        beside = {"waypoint_follower": "WaitAtWaypoint", "SpeedFilter": "filter info", "monitored": "polygon"}
        own = {**declared_defaults().get(kind, {}), **declared_defaults().get(beside.get(kind, ""), {})}
        own |= declared_defaults()["collision_monitor"] if kind == "monitored" else {}
        for name, field in model.model_fields.items():
            if is_group(field.annotation):
                if kind not in ("local_costmap", "global_costmap"):
                    check(name, field.annotation)
            elif not source_of(field).is_derived and (source_of(field).name or name) not in own:
                lacking.add((kind, name))

    for kind, model in modeled_groups():
        if kind != "SpatioTemporalVoxelLayer":
            check(kind, model)
    others = {("SimpleProgressChecker", "required_movement_angle"), ("PositionGoalChecker", "yaw_goal_tolerance")}
    others |= {
        (kind, f"{axis}_stopped_velocity")
        for kind in ("SimpleGoalChecker", "PositionGoalChecker")
        for axis in ("trans", "rot")
    }
    scans = {(kind, name) for kind in ("ObstacleLayer", "VoxelLayer") for name in OF_THE_SCAN}
    assert lacking == NOT_OF_JAZZY | others | scans
    assert declared_defaults()["scan"].keys() >= OF_THE_SCAN


def test_rotation_shim_disengages_at_half_the_angle_when_left_out():
    shim = "nav2_rotation_shim_controller::RotationShimController"
    primary = "nav2_regulated_pure_pursuit_controller::RegulatedPurePursuitController"
    own = f"FollowPath: {{plugin: '{shim}', primary_controller: '{primary}'}}"
    found = interpretation(
        parse(f"controller_server: {{ros__parameters: {{controller_plugins: [FollowPath], {own}}}}}")
    )
    assert found.parameters.rotation_shim.angular_disengage_threshold == 0.785 / 2
    (row,) = (row for row in omitted(found) if row.path[-1] == "angular_disengage_threshold")
    assert (row.declared.source.rpartition("/")[2], row.other) == ("nav2_rotation_shim_controller.cpp:56", 0.785)


@each_row(
    ("source", "layer", "marks", "clears"),
    [
        ("{data_type: LaserScan, marking: true, clearing: true}", "", False, False),
        ("{marking: true, clearing: true}", "", False, False),
        ("{data_type: LaserScan, clearing: true, max_obstacle_height: 0.0}", "", False, False),
        ("{data_type: LaserScan, clearing: true, max_obstacle_height: 2.0}", "", True, True),
        ("{clearing: true, max_obstacle_height: 2.0}", "", True, True),
        ("{clearing: true, max_obstacle_height: 2.0}", "max_obstacle_height: 0.0,", False, True),
        ("{max_obstacle_height: 2.0}", "", True, False),
    ],
)
def test_scan_marks_only_below_its_maximum_height(source, layer, marks, clears):
    found = read(costmap(source, layer))
    read_layer = found.parameters.local_costmap.obstacle_layer
    assert (read_layer.marking, read_layer.clearing) == (marks, clears)
    assert bool(found.reader.warnings) == (not marks)


def test_absent_nodes_are_as_in_nav2s_code():
    found = read("local_costmap: {ros__parameters: {robot_radius: 0.4}}")  # a level too few: no node of Nav2's
    local, other = found.parameters.local_costmap, found.parameters.global_costmap
    assert (local.robot_radius, other.robot_radius, local.inflation_layer.inflation_radius) == (0.1, 0.1, 0.55)
    assert local.static_layer.enabled
    assert not local.obstacle_layer.marking
    assert found.parameters.velocity_smoother.max_velocity == (0.5, 0.0, 2.5)
    assert {"local_costmap", "global_costmap", "velocity_smoother"} <= set(found.absent)
    built_in = {dotted(row.path): row.other for row in omitted(found) if not row.is_used}
    assert built_in["local_costmap.local_costmap.ros__parameters.rolling_window"] is True


def test_default_critic_of_dwb_has_the_declared_scale():
    own = "{plugin: 'dwb_core::DWBLocalPlanner', critics: [Twirling]}"
    found = interpretation(parse(f"controller_server: {{ros__parameters: {{controller_plugins: [A], A: {own}}}}}"))
    assert found.parameters.controller.Twirling.scale == 1.0


def test_left_out_noise_of_mppi_differs():
    found = interpretation(parse(mppi()))
    rows = {row.path[-1]: row for row in omitted(found)}
    assert (rows["regenerate_noises"].declared.default, rows["regenerate_noises"].is_used) == (False, True)
    assert (rows["batch_size"].declared.default, rows["batch_size"].other) == (1000, 2000)


@each_row(
    ("text", "name", "words"),
    [
        (costmap().replace("window: true", "window: false"), "rolling_window", " is false: Nav2's window stays"),
        (
            costmap().replace("rolling_window: true, ", ""),
            "rolling_window",
            " is false where the file leaves it out: Nav2's window",
        ),
        ("amcl: {ros__parameters: }", "rolling_window", " is false where the file leaves it out"),
        (costmap(), "rolling_window", ""),
    ],
)
def test_flag_that_nav2_has_false_is_a_warning_and_nothing_else(text, name, words):
    said = [
        (fault.kind, fault.problem)
        for fault in notes_of(interpretation(parse(text)))
        if fault.place.where.endswith(f".{name}")
    ]
    assert len(said) == bool(words)
    assert all(kind == "warning" and problem.startswith(f"{name}{words}") for kind, problem in said)


def test_source_without_data_type_has_no_note_of_its_own():
    found = read(costmap("{topic: scan, marking: true, clearing: true, max_obstacle_height: 2.0}"))
    assert found.parameters.local_costmap.obstacle_layer.marking
    assert not [fault for fault in notes_of(found) if fault.place.where.endswith(".s") or "its 3" in fault.problem]


def test_default_stack_leaves_nothing_out():
    found = interpretation(document_of(NavParameters()))
    assert found.parameters == NavParameters()
    assert [row for row in omitted(found) if row.is_used] == []


def test_metadata_row_tells_new_defaults():
    row = defaults_row(read(costmap()))
    assert row["local_costmap.local_costmap.ros__parameters.o.s.max_obstacle_height"] == {"value": 0.0, "since": "0.2"}
    assert row["controller_server.ros__parameters.failure_tolerance"] == {"value": 0.0, "since": ""}
    assert row["velocity_smoother.ros__parameters.max_velocity"]["since"] == "0.2"
