"""Mistakes in a campaign file end validate and run with exit code 2, and what is assumed is listed."""

import importlib.util
import json

import pytest
from typer.testing import CliRunner

from vastflow.flows.__main__ import app
from vastflow.oracles.situation import situation_of
from vastflow.sim.nav.parameters.chosen import parameters_of
from vastflow.sim.nav.parameters.robot import robot_keys
from vastflow.sim.reading.robot import lidar_of, robot_facts
from vastflow.sim.scenario import Scenario

NAV2 = "local_costmap: {local_costmap: {ros__parameters: {%s}}}\n"
SQUARE = "[[0.4, 0.3], [0.4, -0.3], [-0.4, -0.3], [-0.4, 0.3]]"

TEMPLATE = """\
version: 1
$top
configuration:
  - name: room
    parameters: [{map_file: room.yaml}, $parameters]
    robot: {$robot}
    variations:
      - PathVariationRandom: {path_length: 3.0, $path}
    $family
execution: {runs: 1, $execution}
evaluation: {oracles: [performance: {$performance}, safety: {$safety}, robustness: {$robustness}], $evaluation}
"""

MISSPELLED = [
    ("top", "metdata: {}", "metadata"),
    ("top", "serch: {}", "search"),
    ("family", "varations: []", "variations"),
    ("family", "constrants: []", "constraints"),
    ("execution", "timout: 60", "timeout"),
    ("execution", "scenario_fil: a.osc", "scenario_file"),
    ("execution", "max_run: 60", "max_runs"),
    ("evaluation", "visualisation: []", "visualization"),
    ("path", "path_lenght_tolerance: 1.0", "path_length_tolerance"),
    ("path", "num_path: 3", "num_paths"),
    ("path", "min_distanc: 1.0", "min_distance"),
    ("path", "robot_diametre: 1.0", "robot_diameter"),
    ("path", "goal_pose: goal_pose", "goal_poses"),
    ("parameters", "number_of_lops: 2", "number_of_loops"),
    ("parameters", "laserscan_random_drop_percentge: 0.1", "laserscan_random_drop_percentage"),
    ("parameters", "odometry_noise_std_devation: 0.1", "odometry_noise_std_deviation"),
    ("parameters", "contoller: dwb", "controller"),
    ("parameters", "max_speed: 0.3", "robot.max_speed"),
    ("parameters", "lidar.beams: 90", "robot.lidar.beams"),
    ("robot", "mas: 9.0", "mass"),
    ("robot", "lidar: {rang_max: 9.0}", "range_max"),
    ("parameters", "inflation_raduis: 0.3", "inflation_radius"),
    ("parameters", "FollowPath.vx_mx: 0.3", "FollowPath.vx_max"),
    ("parameters", "FolowPath.vx_max: 0.3", "FollowPath.vx_max"),
    ("parameters", "global_costmap.robot_raduis: 0.3", "global_costmap.robot_radius"),
    ("parameters", "xy_goal_tolerence: 0.3", "xy_goal_tolerance"),
    ("nav2", "robot_raduis: 0.3", "robot_radius"),
    ("performance", "local_robot_radius: 0.3", "local_robot_radius_m"),
    ("safety", "max_sped_mps: 0.3", "max_speed_mps"),
    ("safety", "fail_on_contct: any", "fail_on_contact"),
    ("robustness", "treshold_m: 0.3", "threshold_m"),
]


def called(*arguments):
    return CliRunner().invoke(app, [str(argument) for argument in arguments])


@pytest.fixture
def campaign(small_room, monkeypatch, tmp_path):
    """Writes the template with some of its places filled, and returns its path."""
    monkeypatch.setenv("VASTFLOW_STORE", str(tmp_path / "store"))

    def written(nav2="", **filled):
        text = TEMPLATE
        for place in (
            "parameters",
            "performance",
            "path",
            "robot",
            "robustness",
            "top",
            "family",
            "safety",
            "evaluation",
        ):
            value = filled.get(place, "")
            text = text.replace(f"${place}", f"{{{value}}}" if place == "parameters" and value else value)
        if nav2:
            small_room.with_name("nav2.yaml").write_text(NAV2 % nav2)
            filled["execution"] = "nav2_params: nav2.yaml"
        small_room.write_text(text.replace("$execution", filled.get("execution", "")).replace("3.0, }", "3.0}"))
        return small_room

    return written


def test_validate_accepts_template_of_misspelled_keys(campaign):
    result = called("validate", campaign(), "--strict")
    assert (result.exit_code, result.stderr) == (0, "")


@pytest.mark.parametrize(("place", "entry", "meant"), MISSPELLED, ids=[entry for _, entry, _ in MISSPELLED])
def test_validate_suggests_known_key_for_misspelled_one(campaign, place, entry, meant):
    result = called("validate", campaign(**{place: entry}))
    assert (result.exit_code, result.stdout) == (2, "")
    (line,) = result.stderr.splitlines()
    assert "unknown key" in line and line.endswith(f"did you mean {meant!r}?")


def test_validate_suggests_known_key_for_misspelled_name_of_producer(campaign):
    varied = "ParameterVariationList: {name: inflation_raduis, values: [0.3, 0.4]}"
    file = campaign()
    file.write_text(file.read_text().replace("      - Path", f"      - {varied}\n      - Path"))
    assert "did you mean 'inflation_radius'?" in called("validate", file).stderr


@pytest.mark.parametrize("command", ["validate", "run"])
def test_strict_refuses_unknown_key_that_resembles_none(campaign, command):
    file = campaign(parameters="colour: red")
    loose = called("validate", file)
    assert loose.exit_code == 0 and "warning: " in loose.stdout and "unknown key 'colour' is ignored" in loose.stdout
    strict = called(command, file, "--strict")
    assert strict.exit_code == 2 and "unknown key 'colour'" in strict.stderr


def test_validate_does_not_take_other_controllers_parameter_for_misspelling(campaign):
    result = called("validate", campaign(parameters="controller: dwb}, {FollowPath.vx_max: 0.3"))
    assert (result.exit_code, result.stderr) == (0, "")


def test_run_without_configurations_exits_with_2_and_counts_rejections(campaign, tmp_path):
    file = campaign(path="num_paths: 4")
    file.write_text(file.read_text().replace("path_length: 3.0", "path_length: [400.0, 500.0]"))
    for command in (("run", file, "--results", tmp_path / "results"), ("run", file, "--dry-run")):
        result = called(*command)
        assert result.exit_code == 2
        assert (
            "nothing to run: PathVariationRandom rejects 8 of family 'room': 4 × this map has no path" in result.stderr
        )
    assert not list((tmp_path / "results").glob("*"))


def test_run_without_configurations_counts_constraints_beside_rejections(campaign):
    file = campaign(path="num_paths: 2", family="constraints: [{short: path_length < 1}]")
    file.write_text(file.read_text().replace("path_length: 3.0", "path_length: [3.0, 500.0]"))
    result = called("run", file, "--dry-run")
    assert result.exit_code == 2 and "PathVariationRandom rejects 2 of family 'room'" in result.stderr
    assert "constraints exclude 2 of family 'room': 2 × short" in result.stderr


def test_validate_proves_path_length_infeasible(campaign):
    file = campaign(path="num_paths: 4")
    file.write_text(file.read_text().replace("path_length: 3.0", "path_length: [3.0, 500.0]"))
    some = called("validate", file)
    assert some.exit_code == 0 and "warning" in some.stdout
    assert "rejects 4 of family 'room': this map has no path of 500 m" in some.stdout
    file.write_text(file.read_text().replace("[3.0, 500.0]", "500.0"))
    none = called("validate", file)
    assert (none.exit_code, none.stdout) == (2, "") and "this map has no path of 500 m" in none.stderr


def test_validate_refuses_strategy_whose_library_is_missing(tmp_path, monkeypatch):
    real = importlib.util.find_spec
    monkeypatch.setattr(importlib.util, "find_spec", lambda name: None if name == "optuna" else real(name))
    (tmp_path / "wait.osc").write_text("import osc.helpers\nscenario patient:\n    a: int\n    do wait elapsed(1s)\n")
    (tmp_path / "search.vast").write_text(
        "version: 1\nexecution: {scenario_file: wait.osc}\n"
        "search: {strategy: optuna, search_space: {a: {type: int, low: 1, high: 2}}, budget: {batches: 1}}\n"
    )
    result = called("validate", tmp_path / "search.vast")
    assert (result.exit_code, result.stdout) == (2, "")
    assert "the library optuna is not installed; pip install 'vastflow[search]'" in result.stderr


def test_lidar_with_own_angles_looks_ahead_from_center():
    angles = {"robot.lidar.angle_min": -1.5, "robot.lidar.angle_max": 1.5}
    assert lidar_of(parameters_of(angles)).mount_xyt == (0.0, 0.0, 0.0)
    assert lidar_of(parameters_of({**angles, "robot.lidar.x": 0.1})).mount_xyt == (0.1, 0.0, 0.0)
    assert lidar_of(parameters_of({"robot.lidar.beams": 90})).mount_xyt[0] == -0.04
    sources = {fact.quantity: fact.source for fact in robot_facts(parameters_of({**angles, "robot.lidar.x": 0.1}))}
    assert sources["lidar mounted at x"] == "given" and sources["lidar turned by"] == "assumed"


def test_dry_run_lists_assumed_mount_and_radii_of_oracles(campaign):
    file = campaign(robot=f"polygon: {SQUARE}, lidar: {{angle_min: -1.5, angle_max: 1.5}}")
    result = called("run", file, "--dry-run", "--json")
    (robot,) = json.loads(result.stdout)["robots"]
    said = "\n".join(robot["robot"])
    assert (
        "assumed, as angles of its own are given: lidar mounted at x 0 m, lidar mounted at y 0 m, lidar turned by 0 rad"
        in said
    )
    assert "performance takes 0.3 m (inscribed), safety 0.5 m (circumscribed)" in said
    assert "robot.lidar.yaw" in robot_keys()


@pytest.mark.parametrize(
    ("system", "inscribed_m", "circumscribed_m"),
    [
        ({}, 0.22, 0.17),
        ({"robot_radius": 0.35}, 0.35, 0.35),
        ({"robot.radius": 0.4}, 0.4, 0.4),
        ({"robot.polygon": SQUARE}, 0.3, 0.5),
        ({"local_costmap.footprint": SQUARE}, 0.3, 0.5),
    ],
    ids=["default", "costmap", "disc", "polygon", "footprint"],
)
def test_oracles_take_size_of_robot(system, inscribed_m, circumscribed_m):
    task = {"start_pose": {"x": 0.0, "y": 0.0}, "goal_pose": {"x": 1.0, "y": 0.0}}
    found = situation_of(Scenario("builtin:navigate_to_pose", 60.0, {}, task, system))
    assert (found.inscribed_radius_m, found.circumscribed_radius_m) == pytest.approx((inscribed_m, circumscribed_m))


def test_validate_says_that_polygon_replaces_robot_radius(campaign):
    said = called("validate", campaign(nav2=f'footprint: "{SQUARE}", robot_radius: 0.3')).stdout
    assert (
        "warning: local_costmap.local_costmap.robot_radius: found 0.3, which has no effect; the polygon footprint replaces it"
        in said
    )
    said = called(
        "validate", campaign(nav2=f'footprint: "{SQUARE}"', parameters="local_costmap.robot_radius: 0.3")
    ).stdout
    assert "'local_costmap.robot_radius' has no effect; the polygon footprint replaces it" in said
