"""What a Nav2 parameter file cannot set the stack to, with its place."""

from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from vastflow.sim.nav.parameters.document import DocumentError, parse
from vastflow.sim.nav.parameters.findings import findings
from vastflow.sim.nav.parameters.interpretation import interpretation

SHIPPED = Path(__file__).parents[2] / "campaigns" / "nav2"


def read(text):
    return interpretation(parse(text, "nav2.yaml"))


def parameters(text):
    return read(text).parameters


def faults(text):
    with pytest.raises(DocumentError) as caught:
        read(text)
    return str(caught.value).splitlines()


def controller(text):
    return f"controller_server: {{ros__parameters: {{controller_plugins: [C], C: {{{text}}}}}}}"


OBSTACLES = "plugin: nav2_mppi_controller::MPPIController, critics: [ObstaclesCritic, GoalCritic]"


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
    ("planner_server: {ros__parameters: {planner_plugins: [GridBased, G], G.plugin: nav2_navfn_planner::NavfnPlanner}}", "planner_plugins.0: no 'plugin' below 'GridBased'; the class of a planner; known: nav2_navfn_planner::NavfnPlanner, "),
    ("controller_server: {ros__parameters: {controller_plugins: [FollowPath, G], G.plugin: dwb_core::DWBLocalPlanner}}", "controller_plugins.0: no 'plugin' below 'FollowPath'; the class of a controller; known: "),
    ("local_costmap: {local_costmap: {ros__parameters: {plugins: [o, inflation_layer], o.plugin: nav2_costmap_2d::ObstacleLayer}}}", "plugins.1: no 'plugin' below 'inflation_layer'; the class of a costmap layer; known: nav2_costmap_2d::StaticLayer, "),
    ("planner_server: {ros__parameters: {planner_plugins: []}}", "planner_plugins: found an empty list; the name of a planner"),
    ("planner_server: {ros__parameters: {planner_plugins: 3}}", "planner_plugins: found 3; a list of names"),
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


@pytest.mark.parametrize(
    ("own", "handler", "fault"),
    [
        ("plugin: nav2_mppi_controller::MPPIController", "enforce_path_rotation: true", "enforce_path_rotation"),
        (
            "plugin: nav2_regulated_pure_pursuit_controller::RegulatedPurePursuitController",
            "enforce_path_inversion: true",
            "enforce_path_inversion",
        ),
    ],
)
def test_what_a_path_handler_of_lyrical_can_do_and_the_controllers_here_can_not_is_refused(own, handler, fault):
    (line,) = faults(controller(f"{own}}}, path_handler: {{plugin: nav2_controller::FeasiblePathHandler, {handler}"))
    assert f"path_handler.{fault}: found true, which is not modeled; false" in line


def test_a_path_handler_of_an_unknown_class_is_refused_where_it_is_named():
    own = "plugin: nav2_mppi_controller::MPPIController"
    (line,) = faults(controller(f"{own}}}, path_handler_plugins: [P], P: {{plugin: mine::Handler"))
    assert "P.plugin: no path handler 'mine::Handler' is known; known: nav2_controller::FeasiblePathHandler" in line
