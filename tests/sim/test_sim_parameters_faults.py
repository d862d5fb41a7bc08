"""What a Nav2 parameter file cannot set the stack to, with its place."""

from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from table import each_row

from vastflow.sim.nav2.parameter_files.document import DocumentError, parse
from vastflow.sim.nav2.parameter_files.findings import findings
from vastflow.sim.nav2.parameter_files.interpretation import interpretation

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


def test_file_of_dashing_is_refused_where_it_differs_from_todays():
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
        "nav2.yaml:2:1: dwb_controller: expected controller_server with a list of plug-ins, as since Foxy, got a node of Nav2 Dashing's",
        "nav2.yaml:3:1: navfn_planner: expected planner_server with a list of plug-ins, as since Foxy, got a node of Nav2 Dashing's",
        "nav2.yaml:7:7: local_costmap.local_costmap.ros__parameters.plugin_names: expected 'plugins', and 'plugin: package::Class' below each name, as since Foxy, got a list of Nav2 Eloquent's, which has the classes in another list",
    ]


def test_faults_of_a_parameter_file_have_place_and_message(golden):
    golden("nav2_parameters", "file", faults)


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
def test_file_with_accidents_is_read_or_has_faults(name, data):
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


def test_footprint_to_consider_must_be_a_polygon_as_nav2_does_not_start_otherwise():
    (fault,) = faults(OUTLINED)
    assert "got true, and the local costmap has no polygon `footprint`" in fault
    polygon = "'[[0.3, 0.3], [0.3, -0.3], [-0.3, 0.0]]'"
    costmap = f"local_costmap: {{local_costmap: {{ros__parameters: {{footprint: {polygon}}}}}}}"
    assert parameters(OUTLINED + costmap).controller.CostCritic.consider_footprint


@each_row("value", ["0.3", "'[[0.2, 0.2]]'"])
def test_footprint_that_is_no_text_or_no_polygon_is_a_fault_with_its_place(value):
    (fault,) = faults(
        f"local_costmap: {{local_costmap: {{ros__parameters: {{robot_radius: 0.2, footprint: {value}}}}}}}"
    )
    assert "footprint must be text" in fault


def test_period_longer_than_mppis_step_is_a_fault_as_nav2_does_not_start():
    text = "controller_server: {ros__parameters: {controller_frequency: 10.0, FollowPath: {plugin: nav2_mppi_controller::MPPIController}}}"
    with pytest.raises(
        DocumentError, match=r"expected 20 or more for a model_dt of 0.05 s, as Nav2 does not start, got 10"
    ):
        parameters(text)


@each_row(
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
    assert f"path_handler.{fault}: expected false, got true, which is not modeled" in line


def test_path_handler_of_an_unknown_class_is_refused_where_it_is_named():
    own = "plugin: nav2_mppi_controller::MPPIController"
    (line,) = faults(controller(f"{own}}}, path_handler_plugins: [P], P: {{plugin: mine::Handler"))
    assert "P.plugin: no path handler 'mine::Handler' is known; known: nav2_controller::FeasiblePathHandler" in line
