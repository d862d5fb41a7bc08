"""The stack's parameters as a scenario's system dimension chooses them."""

import pytest
from table import each_row

from vastflow.sim.model.digest import FileContent, canonical
from vastflow.sim.model.parameter import ParameterError
from vastflow.sim.nav2.parameter_files.chosen import OWN_KEYS, check_key, default_document, parameters_of, unread
from vastflow.sim.nav2.parameter_files.document import DocumentError
from vastflow.sim.nav2.parameter_files.parameter_file import nav2_file
from vastflow.sim.nav2.parameters.dwb import DwbParameters
from vastflow.sim.nav2.parameters.rpp import RppParameters
from vastflow.sim.nav2.parameters.servers import Perturbation
from vastflow.sim.nav2.parameters.stack import NavParameters
from vastflow.sim.world.noise_parameters import GaussianDropoutParameters

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


def radii(system):
    found = parameters_of(system)
    return found.local_costmap.robot_radius, found.global_costmap.robot_radius


def test_nothing_chosen_is_nav2_jazzys_default():
    assert parameters_of({}) == NavParameters()


@each_row(
    ("parameter", "value"),
    [
        ("local_costmap.robot_radius", 0.22),
        ("local_costmap.footprint_padding", 0.01),
        ("local_costmap.inflation_layer.inflation_radius", 0.70),
        ("local_costmap.inflation_layer.cost_scaling_factor", 3.0),
        ("local_costmap.obstacle_layer.obstacle_max_range", 2.5),
        ("global_costmap.obstacle_layer.raytrace_max_range", 3.0),
        ("goal_checker.xy_goal_tolerance", 0.25),
        ("goal_checker.yaw_goal_tolerance", 0.25),
        ("progress_checker.required_movement_radius", 0.5),
        ("progress_checker.movement_time_allowance", 10.0),
        ("controller_server.failure_tolerance", 0.3),
        ("planner.tolerance", 0.5),
        ("amcl.min_particles", 500),
        ("amcl.max_particles", 2000),
        ("amcl.pf_err", 0.05),
        ("amcl.pf_z", 0.99),
        ("amcl.alpha1", 0.2),
        ("amcl.max_beams", 60),
        ("amcl.sigma_hit", 0.2),
        ("amcl.laser_likelihood_max_dist", 2.0),
        ("amcl.update_min_d", 0.25),
        ("amcl.update_min_a", 0.2),
        ("collision_monitor.time_before_collision", 1.2),
        ("collision_monitor.min_points", 6),
        ("velocity_smoother.max_accel", (2.5, 0.0, 3.2)),
    ],
)
def test_defaults_are_those_of_nav2_jazzy(parameter, value):
    found = NavParameters()
    for name in parameter.split("."):
        found = getattr(found, name)
    assert found == value


def test_leaf_key_rewrites_every_occurrence():
    assert radii({"robot_radius": 0.3}) == (0.3, 0.3)


def test_whole_dotted_key_rewrites_just_one():
    assert radii({GLOBAL_RADIUS: 0.3}) == (0.22, 0.3)


def test_last_names_of_a_path_rewrite_what_ends_so():
    assert radii({"local_costmap.robot_radius": 0.3}) == (0.3, 0.22)
    assert (
        parameters_of({"inflation_layer.inflation_radius": 0.4}).global_costmap.inflation_layer.inflation_radius == 0.4
    )


@each_row("order", [1, -1])
def test_longest_key_counts_whatever_the_order(order):
    keys = [("robot_radius", 0.1), (GLOBAL_RADIUS, 0.3), ("global_costmap.robot_radius", 0.2)]
    assert radii(dict(keys[::order])) == (0.1, 0.3)


def test_item_of_a_list_is_rewritten_by_its_number():
    assert parameters_of({"max_velocity.0": 0.4}).velocity_smoother.max_velocity == (0.4, 0.0, 2.0)


@each_row("end", ["max_velocity.x", "max_velocity.7", "max_velocity.\u00b2", ""])
def test_what_is_no_item_of_a_list_is_unread_or_refused(end):
    key = f"velocity_smoother.ros__parameters.{end}"
    try:
        assert unread({key: 0.1}) == (key,)
    except DocumentError as error:
        assert "max_velocity must be a list of 3 numbers" in str(error)


def test_whole_list_is_rewritten():
    assert parameters_of({"max_accel": [1, 0, 2.0]}).velocity_smoother.max_accel == (1.0, 0.0, 2.0)


def test_text_that_is_a_number_or_a_flag_is_that():
    found = parameters_of(
        {"laserscan_random_drop_percentage": "0.1", "min_particles": "100", "allow_unknown": "False", "pf_err": "1e-2"}
    )
    assert found.lidar_noise.laserscan_random_drop_percentage == 0.1
    assert (found.amcl.min_particles, found.amcl.pf_err, found.planner.allow_unknown) == (100, 0.01, False)


def test_whole_numbers_may_be_written_with_a_point_and_lengths_without():
    found = parameters_of({"max_beams": 30.0, "robot_radius": 1})
    assert (found.amcl.max_beams, type(found.amcl.max_beams)) == (30, int)
    assert isinstance(found.local_costmap.robot_radius, float)


def test_lists_of_plug_ins_can_be_varied():
    assert not parameters_of({"local_costmap.plugins": ["voxel_layer"]}).local_costmap.inflation_layer.enabled


def test_sensing_goes_by_the_launch_arguments_or_the_relays_own_names():
    found = [
        parameters_of({f"{prefix}gaussian_noise_std_deviation": 0.1, f"{prefix}random_drop_percentage": 0.2})
        for prefix in ("", "laserscan_")
    ]
    assert found[0] == found[1]
    assert found[0].lidar_noise == GaussianDropoutParameters(
        laserscan_gaussian_noise_std_deviation=0.1, laserscan_random_drop_percentage=0.2
    )


def test_every_perturbation_has_a_key():
    assert {
        path[-1] for paths in OWN_KEYS.values() for path in paths if len(path) == 1
    } == Perturbation.model_fields.keys()


def test_initial_covariance_is_a_list_of_three():
    found = parameters_of({"initial_pose_covariance": [0.25, "0.2", 0.0685]}).perturbation
    covariances = (
        found.initial_pose_covariance_xx,
        found.initial_pose_covariance_yy,
        found.initial_pose_covariance_yaw,
    )
    assert covariances == (0.25, 0.2, 0.0685)


@each_row(("name", "default"), [("dwb", DwbParameters()), ("rpp", RppParameters())])
def test_controller_by_name_has_its_own_default_parameters(name, default):
    assert parameters_of({"controller": name}) == NavParameters().with_values(controller=default)


def test_default_controller_by_name_changes_nothing():
    assert parameters_of({"controller": "mppi"}) == NavParameters()


def test_other_keys_rewrite_the_controller_that_was_named():
    assert parameters_of({"desired_linear_vel": 0.3, "controller": "rpp"}).controller.desired_linear_vel == 0.3


def test_controller_that_the_file_has_is_the_files_own(content):
    assert parameters_of({"nav2_params": content, "controller": "rpp"}).controller.desired_linear_vel == 0.2
    assert parameters_of({"nav2_params": content, "controller": "dwb"}).controller.max_vel_x == 0.4


def test_controller_that_the_file_does_not_have_comes_with_its_defaults(content):
    found = parameters_of({"nav2_params": content, "controller": "mppi"})
    assert found.controller == NavParameters().controller


def test_file_is_rewritten_like_the_default(content):
    assert radii({"nav2_params": content}) == (0.3, 0.3)  # the file has the local costmap alone
    assert radii({"nav2_params": content, "robot_radius": 0.4}) == (0.4, 0.4)
    assert radii({"nav2_params": content, GLOBAL_RADIUS: 0.4}) == (0.3, 0.4)


def test_file_without_a_controller_server_still_gets_the_controller_asked_for(tmp_path):
    (tmp_path / "nav2.yaml").write_text("amcl: {ros__parameters: {pf_err: 0.1}}")
    found = parameters_of({"nav2_params": nav2_file(tmp_path / "nav2.yaml"), "controller": "rpp"})
    assert (found.amcl.pf_err, found.controller) == (0.1, RppParameters())
    assert found.goal_checker == NavParameters().goal_checker


def test_file_is_the_same_value_wherever_it_lies_and_however_it_is_written(content, tmp_path):
    other = tmp_path / "other.yaml"
    local, _, rest = FILE.rpartition("local_costmap:\n  local")
    other.write_text(f"# A comment.\nlocal_costmap:\n  local{rest}bt_navigator: {{ros__parameters: {{a: 1}}}}\n{local}")
    assert nav2_file(other) == content
    assert canonical(nav2_file(other)) == canonical(content)


@pytest.mark.parametrize("edit", ["0.3}|0.31}", "Fast, Slow|Slow, Fast", "[PathDist]|[GoalDist]"])
def test_file_that_says_something_else_is_another_value(content, tmp_path, edit):
    (tmp_path / "other.yaml").write_text(FILE.replace(*edit.split("|")))
    assert nav2_file(tmp_path / "other.yaml") != content


def test_node_without_parameters_is_not_the_same_as_no_node(content, tmp_path):
    (tmp_path / "other.yaml").write_text(f"{FILE}collision_monitor:\n  ros__parameters:\n")
    assert nav2_file(tmp_path / "other.yaml") != content


def test_file_that_changed_since_it_was_read_is_refused(tmp_path):
    file = tmp_path / "nav2.yaml"
    file.write_text("amcl: {ros__parameters: {pf_err: 0.07}}")
    content = nav2_file(file)
    file.write_text("amcl: {ros__parameters: {pf_err: 0.08}}")
    with pytest.raises(ParameterError, match=r"nav2.yaml changed since the campaign was read; run the campaign again"):
        parameters_of({"nav2_params": content})


def test_keys_that_nothing_reads_are_named():
    system = {"robot_radius": 0.3, "laserscan_gaussian_noise_std_deviation": 0.1, "amcl": 1, "desired_linear_vel": 0.4}
    assert unread(system) == ("amcl", "desired_linear_vel")


def test_keys_whose_values_are_not_decided_are_asked_for_too():
    found = unread(
        {"controller": "rpp"}, ["desired_linear_vel", "max_vel_x", "max_velocity.0", "initial_pose_covariance"]
    )
    assert found == ("max_vel_x",)


def test_key_is_unread_where_the_file_has_nothing_of_that_name(content):
    assert unread({"nav2_params": content, "sigma_hit": 0.1, "robot_radius": 0.2}) == ("sigma_hit",)


def test_parameter_that_is_there_and_not_modeled_is_unread(tmp_path):
    (tmp_path / "nav2.yaml").write_text("controller_server: {ros__parameters: {costmap_update_timeout: 0.3}}")
    assert unread({"nav2_params": nav2_file(tmp_path / "nav2.yaml"), "costmap_update_timeout": 0.5}) == (
        "costmap_update_timeout",
    )


def test_whole_dotted_key_is_read_if_the_file_could_have_it(content):
    keys = [f"controller_server.ros__parameters.Fast.{name}" for name in ("sim_time", "sim_tim")]
    assert unread({"nav2_params": content}, keys) == (keys[1],)


WRONG = [
    ({"robot_radius": -0.1}, r"robot_radius: expected robot_radius must lie in \[0.01, 10\], got -0.1"),
    ({GLOBAL_RADIUS: -0.1}, r"ros__parameters.robot_radius: expected robot_radius must lie, got -0.1"),
    (
        {"random_drop_percentage": 20},
        r"random_drop_percentage: expected \w+random_drop_percentage must lie in \[0, 1\], got 20",
    ),
    ({"robot_radius": "wide"}, "expected robot_radius must be a number, got 'wide'"),
    ({"robot_radius": True}, "expected robot_radius must be a number, got true"),
    ({"robot_radius": float("inf")}, "expected robot_radius must be a number, got inf"),
    ({"robot_radius": 10**400}, "; robot_radius must be a number"),
    ({"robot_radius": None}, "expected robot_radius must be a number, got nothing"),
    ({"robot_radius": [0.2]}, r"expected robot_radius must be a number, got \[0.2\]"),
    ({"max_beams": 2.5}, "expected max_beams must be a whole number, got 2.5"),
    ({"allow_unknown": 1}, "expected allow_unknown must be true or false, got 1"),
    ({"max_velocity": [0.5, 0.0]}, r"expected max_velocity must be a list of 3 numbers, got \[0.5, 0.0\]"),
    ({"max_velocity.1": "fast"}, r"max_velocity\.1: expected max_velocity\[1\] must be a number, got .*"),
    ({"min_particles": 3000}, "contradict each other: amcl.min_particles 3000 must be <= max_particles 2000"),
    ({"controller": "teb"}, "controller: expected one of dwb, mppi, rpp, got 'teb'"),
    ({"controller": None}, "controller: expected one of dwb, mppi, rpp, got nothing"),
    ({"controller": 3}, "controller: expected one of dwb, mppi, rpp, got 3"),
    ({"controller": "dwb", "critics": ["PathDist", "Foo"]}, "critics: DWB has no critic 'Foo'; known: RotateToGoal, "),
    (
        {"GridBased.plugin": "a::B"},
        "GridBased.plugin: no planner 'a::B' is known; known: nav2_navfn_planner::NavfnPlanner",
    ),
    ({"initial_pose_covariance": 0.1}, "initial_pose_covariance: expected a list of three variances, got 0.1"),
    (
        {"initial_pose_covariance": [0.1, 0.1, -1]},
        "initial_pose_covariance: expected initial_pose_covariance_yaw must lie, got -1",
    ),
    ({"nav2_params": "nav2.yaml"}, "nav2_params: expected a file, which execution.nav2_params names, got 'nav2.yaml'"),
]


@each_row(("system", "message"), WRONG)
def test_value_that_cannot_be_used_is_refused_by_its_key(system, message):
    with pytest.raises(ParameterError, match=message):
        parameters_of(system)


@each_row(("system", "message"), [wrong for wrong in WRONG if not {"nav2_params", "min_particles"} & wrong[0].keys()])
def test_one_more_key_is_refused_as_in_the_whole(system, message):
    *others, (key, value) = system.items()
    with pytest.raises(DocumentError, match=message):
        check_key(dict(others), key, value)


def test_all_faults_are_there_at_once_and_each_once():
    with pytest.raises(DocumentError) as caught:
        parameters_of({"robot_radius": -1, "pf_err": "x", "laserscan_gaussian_noise_std_deviation": -1})
    named = sorted(fault.where for fault in caught.value.faults)
    assert named == ["laserscan_gaussian_noise_std_deviation", "pf_err", "robot_radius"]


def test_another_key_is_checked_though_the_system_has_a_fault():
    with pytest.raises(DocumentError) as caught:
        check_key({"pf_err": -1}, "robot_radius", -1)
    assert {fault.where for fault in caught.value.faults} == {"pf_err", "robot_radius"}


def test_one_more_key_says_whether_it_stands_for_anything():
    assert check_key({}, "robot_radius", 0.3)
    assert not check_key({}, "robot_color", "red")


def test_default_document_has_the_names_of_nav2_jazzys_file():
    values = default_document().values
    assert values["controller_server", "ros__parameters", "controller_plugins"] == ["FollowPath"]
    assert values["local_costmap", "local_costmap", "ros__parameters", "plugins"] == ["voxel_layer", "inflation_layer"]
    assert values["global_costmap", "global_costmap", "ros__parameters", "static_layer", "plugin"] == (
        "nav2_costmap_2d::StaticLayer"
    )


def test_value_of_another_files_content_is_not_mistaken_for_it(content):
    with pytest.raises(ParameterError, match="changed since"):
        parameters_of({"nav2_params": FileContent(content.path, "0" * 64)})
