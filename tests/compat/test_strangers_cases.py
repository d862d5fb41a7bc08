"""Right values of others' files that were once misread, by `validate` and `params`.

The verdict of C06, a mission that Nav2 ends at its start, is a test of the oracle `success`.
"""

import warnings

import pytest
from outside import SHARED
from typer.testing import CliRunner

from vastflow.flows.cli.__main__ import app
from vastflow.sim.nav2.parameter_files.chosen import parameters_of
from vastflow.sim.nav2.parameter_files.parameter_file import nav2_file
from vastflow.sim.nav2.system.robot import robot_of
from vastflow.sim.world.map_file import load_map

CASES = SHARED / "cases"

pytestmark = pytest.mark.skipif(not CASES.is_dir(), reason="the strangers' cases are not beside the repository")


def said(command, case, name):
    """Exit code and words of a command on a file of a case, in single spaces."""
    done = CliRunner().invoke(app, [command, str(CASES / case / name)], env={"COLUMNS": "400"})
    return done.exit_code, " ".join(done.output.split())


def read(case, name="params.yaml"):
    return parameters_of({"nav2_params": nav2_file(CASES / case / name)})


@pytest.mark.parametrize(
    ("case", "command", "code", "words"),
    [
        ("C01", "params", 0, ["0.3925 Jazzy: 0.785"]),
        ("C02", "validate", 0, ["max_obstacle_height is 0 where it is left out", "nothing of the scan is marked"]),
        ("C04", "validate", 0, ["2 goal checkers", "nav2 refuses each path", "missions abort"]),
        ("C06", "validate", 0, ["OK: 1 family"]),
        ("C07", "params", 0, ["'KEEPOUT_ZONE_ENABLED' modeled: false", "override_lethal_cost true no effect"]),
        ("C08", "validate", 0, ["OK: 1 family"]),
        ("C09", "params", 0, ["failure_tolerance -1.0 modeled: 1000000.0"]),
        ("C11", "validate", 0, ["no limit arrives, as the controller listens on speed_limit", "'speed_mask' has no"]),
        (
            "C13",
            "validate",
            0,
            [
                "parameters of other robots, /robot2",
                "the robot is /robot1, unless a family says 'robot: {namespace: ...}'",
            ],
        ),
        ("C14", "validate", 0, ["2 critics of the class of pathaligncritic", "nav2 counts each of them"]),
        ("C15", "validate", 2, ["expected a double, such as 20.0", "expected an integer, as the node ends otherwise"]),
        ("C17", "validate", 0, ["OK: 1 family"]),
        ("C18", "validate", 0, ["OK: 1 family"]),
        ("C19", "validate", 0, ["not modeled", "nav2's node is local_costmap/local_costmap"]),
        ("C21", "validate", 2, ["base: no controller_plugins names it", "controller_plugins: [base]"]),
        ("C22", "validate", 0, ["OK: 1 family"]),
    ],
)
def test_command_tells_of_case_as_nav2_acts(case, command, code, words):
    campaign = {"C06": "round_trip.vast", "C13": "one_first.vast"}.get(case, "case.vast")
    name = "params.yaml" if command == "params" else campaign
    exit_code, text = said(command, case, name)
    assert exit_code == code, text
    assert [each for each in words if each.lower() not in text.lower()] == [], text


def test_rotation_shim_without_its_disengage_threshold_is_the_file_that_has_half():
    assert read("C01") == read("C01", "params_written_out.yaml")


def test_scan_without_a_greatest_height_marks_nothing():
    layers = [read("C02", name).local_costmap.obstacle_layer for name in ("params.yaml", "expected_like.yaml")]
    assert [layer.marking for layer in layers] == [False, False]


@pytest.mark.parametrize(("case", "is_on"), [("C07", False), ("C08", True)])
def test_keepout_filter_is_on_where_nav2_has_it_on(case, is_on):
    assert read(case).global_costmap.keepout_filter.enabled is is_on


def test_repeated_critic_is_another_controller_than_one(tmp_path):
    twice = (CASES / "C14/params.yaml").read_text()
    assert twice.count("PathAlignCritic") > 1
    head, _, tail = twice.rpartition(", PathAlignCritic")
    (tmp_path / "once.yaml").write_text(head + tail)
    assert parameters_of({"nav2_params": nav2_file(tmp_path / "once.yaml")}).controller != read("C14").controller


def test_order_of_two_robots_makes_two_systems():
    files = [nav2_file(CASES / f"C13/{name}_first.yaml") for name in ("one", "two")]
    assert files[0].digest != files[1].digest
    assert [parameters_of({"nav2_params": file}).local_costmap.robot_radius for file in files] == [0.22, 0.35]


def test_transparent_half_of_a_bitmap_is_unknown():
    cells = load_map(CASES / "C17/half.yaml").cells
    assert 0.4 < (cells < 0).mean() < 0.6


def test_source_without_a_type_is_a_laser_scan_without_a_note():
    assert "not modeled" not in said("validate", "C18", "case.vast")[1]
    assert "point cloud" not in said("params", "C18", "params.yaml")[1]


def test_node_one_level_too_high_leaves_nav2s_defaults():
    costmap = read("C19").local_costmap
    assert (costmap.robot_radius, costmap.inflation_layer.inflation_radius) == (0.1, 0.55)


def test_footprint_that_repeats_its_first_vertex_warns_of_nothing():
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assert robot_of(read("C22")).vertices
