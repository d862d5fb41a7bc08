"""The stack's parameters as a scenario's system dimension chooses them."""

import pytest
from table import each_row

from vastflow.sim.model.digest import canonical
from vastflow.sim.model.faults import FileError
from vastflow.sim.nav2.parameter_files.chosen import OWN_KEYS, check_key, converted, parameters_of, unread
from vastflow.sim.nav2.parameter_files.parameter_file import nav2_file
from vastflow.sim.nav2.parameters.dwb import DwbParameters
from vastflow.sim.nav2.parameters.rpp import RppParameters
from vastflow.sim.nav2.parameters.servers import Perturbation
from vastflow.sim.nav2.parameters.stack import NavParameters

GLOBAL_RADIUS = "global_costmap.global_costmap.ros__parameters.robot_radius"

FILE = """
controller_server:
  ros__parameters:
    controller_plugins: [Fast, Slow]
    Fast: {plugin: "dwb_core::DWBLocalPlanner", max_vel_x: 0.4, critics: [PathDist]}
    Slow: {plugin: "nav2_regulated_pure_pursuit_controller::RegulatedPurePursuitController", desired_linear_vel: 0.2}
local_costmap:
  local_costmap:
    ros__parameters: {robot_radius: 0.3}
"""


@pytest.fixture
def content(tmp_path):
    """A parameter file as a value."""
    (tmp_path / "nav2.yaml").write_text(FILE)
    return nav2_file(tmp_path / "nav2.yaml")


def value_of(parameters, path):
    for name in path.split("."):
        parameters = getattr(parameters, name)
    return parameters


def radii(system):
    return tuple(value_of(parameters_of(system), f"{name}_costmap.robot_radius") for name in ("local", "global"))


def test_default_stack_is_nav2_jazzys_with_the_named_controller():
    assert parameters_of({}) == parameters_of({"controller": "mppi"}) == NavParameters()
    assert parameters_of({"controller": "dwb"}) == NavParameters(controller=DwbParameters())
    assert parameters_of({"controller": "rpp"}) == NavParameters(controller=RppParameters())


@each_row(
    ("system", "expected"),
    [
        ({"robot_radius": 0.3}, (0.3, 0.3)),
        ({GLOBAL_RADIUS: 0.3}, (0.22, 0.3)),
        ({"local_costmap.robot_radius": 0.3}, (0.3, 0.22)),
        ({"robot_radius": 0.1, GLOBAL_RADIUS: 0.3, "global_costmap.robot_radius": 0.2}, (0.1, 0.3)),
        ({"global_costmap.robot_radius": 0.2, GLOBAL_RADIUS: 0.3, "robot_radius": 0.1}, (0.1, 0.3)),
    ],
)
def test_key_rewrites_every_path_that_ends_with_it_and_longest_key_counts(system, expected):
    assert radii(system) == expected


@each_row(
    ("system", "path", "expected"),
    [
        ({"inflation_layer.inflation_radius": 0.4}, "global_costmap.inflation_layer.inflation_radius", 0.4),
        ({"max_velocity.0": 0.4}, "velocity_smoother.max_velocity", (0.4, 0.0, 2.0)),
        ({"max_accel": [1, 0, 2.0]}, "velocity_smoother.max_accel", (1.0, 0.0, 2.0)),
        ({"laserscan_random_drop_percentage": "0.1"}, "lidar_noise.laserscan_random_drop_percentage", 0.1),
        ({"min_particles": "100"}, "amcl.min_particles", 100),
        ({"allow_unknown": "False"}, "planner.allow_unknown", False),
        ({"pf_err": "1e-2"}, "amcl.pf_err", 0.01),
        ({"max_beams": 30.0}, "amcl.max_beams", 30),
        ({"robot_radius": 1}, "local_costmap.robot_radius", 1.0),
        ({"local_costmap.plugins": ["voxel_layer"]}, "local_costmap.inflation_layer.enabled", False),
        ({"initial_pose_covariance": [0.25, "0.2", 0.07]}, "perturbation.initial_pose_covariance_yy", 0.2),
        ({"initial_pose_covariance": [0.25, "0.2", 0.07]}, "perturbation.initial_pose_covariance_yaw", 0.07),
        ({"desired_linear_vel": 0.3, "controller": "rpp"}, "controller.desired_linear_vel", 0.3),
    ],
)
def test_key_sets_a_parameter_from_numbers_lists_and_text(system, path, expected):
    found = value_of(parameters_of(system), path)
    assert (found, type(found)) == (expected, type(expected))


@each_row(
    ("text", "value"),
    [("1", 1), ("-2", -2), ("1.", 1.0), (" .5 ", 0.5), ("1e3", 1000.0), ("TRUE", True), ("1x", "1x"), ("", "")],
)
def test_rewritten_text_is_converted_to_number_or_flag(text, value):
    found = converted(text)
    assert (found, type(found)) == (value, type(value))


@each_row("end", ["max_velocity.x", "max_velocity.7", "max_velocity.\u00b2", ""])
def test_key_outside_list_is_unread_or_refused(end):
    key = f"velocity_smoother.ros__parameters.{end}"
    try:
        assert unread({key: 0.1}) == (key,)
    except FileError as error:
        assert "expected a list of 3 numbers" in str(error)


def test_perturbations_have_keys():
    own = {path[-1] for paths in OWN_KEYS.values() for path in paths if len(path) == 1}
    assert own - {"nav2_release"} == Perturbation.model_fields.keys()


def test_named_controller_has_the_parameters_of_the_file_or_its_defaults(content, tmp_path):
    file = {"nav2_params": content}
    assert parameters_of({**file, "controller": "rpp"}).controller.desired_linear_vel == 0.2
    assert parameters_of({**file, "controller": "dwb"}).controller.max_vel_x == 0.4
    assert parameters_of({**file, "controller": "mppi"}).controller == NavParameters().controller
    (tmp_path / "other.yaml").write_text("amcl: {ros__parameters: {pf_err: 0.1}}")
    found = parameters_of({"nav2_params": nav2_file(tmp_path / "other.yaml"), "controller": "rpp"})
    assert (found.amcl.pf_err, found.controller) == (0.1, RppParameters())
    assert found.goal_checker == NavParameters().goal_checker


def test_file_is_rewritten_like_the_default(content):
    assert radii({"nav2_params": content}) == (0.3, 0.1)  # the file has the local costmap alone
    assert radii({"nav2_params": content, "robot_radius": 0.4}) == (0.4, 0.1)
    assert radii({"nav2_params": content, GLOBAL_RADIUS: 0.4}) == (0.3, 0.4)


def test_file_value_ignores_path_comments_order_and_unmodeled_nodes(content, tmp_path):
    other = tmp_path / "other.yaml"
    local, _, rest = FILE.rpartition("local_costmap:\n  local")
    other.write_text(f"# A comment.\nlocal_costmap:\n  local{rest}bt_navigator: {{ros__parameters: {{a: 1}}}}\n{local}")
    assert canonical(nav2_file(other)) == canonical(content)


@each_row(
    "edit",
    ["0.3}|0.31}", "Fast, Slow|Slow, Fast", "[PathDist]|[GoalDist]", "\nlocal|\namcl: {ros__parameters: }\nlocal"],
)
def test_file_value_depends_on_parameters_and_empty_nodes(content, tmp_path, edit):
    (tmp_path / "other.yaml").write_text(FILE.replace(*edit.split("|"), 1))
    assert nav2_file(tmp_path / "other.yaml") != content


def test_file_that_changed_since_it_was_read_is_refused(tmp_path):
    file = tmp_path / "other.yaml"
    file.write_text("amcl: {ros__parameters: {pf_err: 0.07}}")
    content = nav2_file(file)
    file.write_text("amcl: {ros__parameters: {pf_err: 0.08}}")
    with pytest.raises(ValueError, match=r"other.yaml changed since the campaign was read.* Run the campaign again"):
        parameters_of({"nav2_params": content})


@each_row(
    ("system", "undecided", "expected"),
    [
        ({"robot_radius": 0.3, "random_drop_percentage": 0.1, "amcl": 1, "vx_ma": 0.4}, [], ("amcl", "vx_ma")),
        ({"controller": "rpp"}, ["desired_linear_vel", "max_vel_x", "max_velocity.0"], ("max_vel_x",)),
        ({}, ["initial_pose_covariance", "keepout_mask", "controller"], ("keepout_mask",)),
    ],
)
def test_unread_names_ineffective_keys(system, undecided, expected):
    assert unread(system, undecided) == expected


def test_unread_depends_on_the_parameters_of_the_file(content, tmp_path):
    assert unread({"nav2_params": content, "sigma_hit": 0.1, "robot_radius": 0.2}) == ("sigma_hit",)
    keys = [f"controller_server.ros__parameters.Fast.{name}" for name in ("sim_time", "sim_tim")]
    assert unread({"nav2_params": content}, keys) == (keys[1],)
    (tmp_path / "other.yaml").write_text("controller_server: {ros__parameters: {publish_zero_velocity: true}}")
    system = {"nav2_params": nav2_file(tmp_path / "other.yaml"), "publish_zero_velocity": False}
    assert unread(system) == ("publish_zero_velocity",)


def test_further_key_is_checked_beside_faults_of_the_system():
    with pytest.raises(FileError) as caught:
        check_key({"pf_err": -1}, "robot_radius", 0)
    assert {fault.place.where for fault in caught.value.faults} == {"pf_err", "robot_radius"}
    assert check_key({}, "robot_radius", 0.3)
    assert not check_key({}, "robot_color", "red")
