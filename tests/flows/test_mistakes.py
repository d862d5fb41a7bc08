"""Mistakes in a campaign file end validate and run with exit code 2, and what is assumed is listed."""

import importlib.util
import json
import re
from collections import defaultdict
from string import Template

import pytest
from command_line import called, refused
from table import each_row

from vastflow.oracles.observation.situation import situation_of
from vastflow.sim.model.scenario import Scenario

SQUARE = "[[0.4, 0.3], [0.4, -0.3], [-0.4, -0.3], [-0.4, 0.3]]"

TEMPLATE = """\
version: 1
$top
configuration:
  - name: room
    parameters: [map_file: room.yaml, $parameters]
    robot: {$robot}
    variations:
      $producers
      - PathVariationRandom: {path_length: $lengths, $path}
    $family
execution: {runs: 1, $execution}
evaluation: {oracles: [performance: {$performance}, safety: {$safety}, robustness: {$robustness}], $evaluation}
"""

MISSPELLED = {
    "top": "metdata=metadata serch=search",
    "family": "varations=variations constrants=constraints",
    "execution": "timout=timeout scenario_fil=scenario_file max_run=max_runs",
    "evaluation": "visualisation=visualization",
    "path": "path_lenght_tolerance=path_length_tolerance num_path=num_paths min_distanc=min_distance "
    "robot_diametre=robot_diameter goal_pose=goal_poses",
    "parameters": "contoller=controller lidar.beams=robot.lidar.beams inflation_raduis=inflation_radius "
    "FollowPath.vx_mx=FollowPath.vx_max FolowPath.vx_max=FollowPath.vx_max "
    "global_costmap.robot_raduis=global_costmap.robot_radius",
    "robot": "mas=mass max_yaw_rat=max_yaw_rate",
    "nav2": "robot_raduis=robot_radius",
    "performance": "local_robot_radius=local_robot_radius_m",
    "safety": "max_sped_mps=max_speed_mps fail_on_contct=fail_on_contact",
    "robustness": "treshold_m=threshold_m",
}
"""Place of a campaign to wrong keys and those that were meant."""
WRONG_KEYS = [(place, *pair.split("=")) for place, pairs in MISSPELLED.items() for pair in pairs.split()]


@pytest.fixture
def campaign(small_room, monkeypatch, tmp_path):
    monkeypatch.setenv("VASTFLOW_STORE", str(tmp_path / "store"))

    def written(nav2="", lengths="3.0", **filled):
        small_room.with_name("nav2.yaml").write_text(
            f"local_costmap: {{local_costmap: {{ros__parameters: {{{nav2}}}}}}}"
        )
        if nav2:
            filled["execution"] = "nav2_params: nav2.yaml"
        small_room.write_text(Template(TEMPLATE).substitute(defaultdict(str, filled, lengths=lengths)))
        return small_room

    return written


def test_validate_accepts_template_and_parameter_of_other_controller(campaign):
    for filled, options in (({}, ("--strict",)), ({"parameters": "controller: dwb, FollowPath.vx_max: 0.3"}, ())):
        result = called("validate", campaign(**filled), *options)
        assert (result.exit_code, result.stderr) == (0, "")


@each_row(("place", "wrong", "meant"), WRONG_KEYS)
def test_validate_suggests_known_key_for_misspelled_one(campaign, place, wrong, meant):
    line = refused("validate", campaign(**{place: f"{wrong}: 1"}))
    assert "Unknown key" in line and line.endswith(f"Did you mean {meant!r}?")


def test_validate_suggests_known_key_for_misspelled_name_of_producer(campaign):
    varied = "- ParameterVariationList: {name: inflation_raduis, values: [0.3, 0.4]}"
    assert "Did you mean 'inflation_radius'?" in called("validate", campaign(producers=varied)).stderr


def test_validate_names_each_mistake_beside_values_and_producers_that_are_wrong(campaign):
    mistakes = ["inflation_radius: -1", "robot_raduis: 0.3", "laserscan_random_drop_percentage: 1.5"]
    for path in ("", "num_paths: none"):
        said = called("validate", campaign(parameters=", ".join(mistakes), path=path)).stderr
        expected = [*(each.partition(":")[0] for each in mistakes), *(["num_paths"] if path else [])]
        assert [name for name in expected if f"{name}: " not in said and f"{name}'" not in said] == []
        assert "Unknown key 'robot_raduis'. Did you mean 'robot_radius'?" in said


def test_validate_shows_line_with_caret_below_mistake(campaign):
    file = campaign(lengths="'long\u202e way'")
    fault, line, caret = called("validate", file).stderr.splitlines()
    row, column = map(int, re.search(r":(\d+):(\d+): ", fault).groups())
    text = file.read_text().splitlines()[row - 1]
    assert line == f"  {row} | {text.replace(chr(0x202E), ' ')}"
    assert caret.index("^") - line.index("|") - 2 == column - 1 == text.index("'long")


@each_row("text", ["version: 1\nconfiguration:\n\t- name: x\n", "version: 1\nconfiguration:\n  - name: x\n\t  y: 1\n"])
def test_validate_calls_a_tab_a_tab(tmp_path, text):
    file = tmp_path / "tab.vast"
    file.write_text(text)
    assert refused("validate", file).endswith("expected spaces, as YAML allows no tabs for indentation, got a tab")


def test_strict_refuses_unknown_key_that_resembles_none(campaign):
    file = campaign(parameters="colour: red")
    loose = called("validate", file)
    assert loose.exit_code == 0 and "warning: " in loose.stdout and "unknown key 'colour' is ignored" in loose.stdout
    for command in ("validate", "run"):
        assert "unknown key 'colour'" in refused(command, file, "--strict")


def test_run_without_configurations_counts_rejections_and_exclusions(campaign, tmp_path):
    file = campaign(path="num_paths: 4", lengths="[400.0, 500.0]")
    for command in (("run", file, "--results", tmp_path / "results"), ("plan", file)):
        said = called(*command).stderr
        assert (
            "There is nothing to run. PathVariationRandom rejects 8 of family 'room': 4 × this map has no path" in said
        )
    assert not list((tmp_path / "results").glob("*"))
    file = campaign(path="num_paths: 2", lengths="[3.0, 500.0]", family="constraints: [short: path_length < 1]")
    result = called("plan", file)
    assert result.exit_code == 2 and "PathVariationRandom rejects 2 of family 'room'" in result.stderr
    assert "Constraints exclude 2 of family 'room': 2 × short" in result.stderr


def test_validate_proves_path_length_infeasible(campaign):
    some = called("validate", campaign(path="num_paths: 4", lengths="[3.0, 500.0]"))
    assert some.exit_code == 0 and "warning" in some.stdout
    assert "4 configurations of family 'room' are rejected. This map has no path of 500 m" in some.stdout
    none = called("validate", campaign(lengths="500.0"))
    assert (none.exit_code, none.stdout) == (2, "") and "his map has no path of 500 m" in none.stderr


def test_validate_refuses_strategy_whose_library_is_missing(tmp_path, monkeypatch):
    real = importlib.util.find_spec
    monkeypatch.setattr(importlib.util, "find_spec", lambda name: None if name == "optuna" else real(name))
    (tmp_path / "wait.osc").write_text("import osc.helpers\nscenario patient:\n    a: int\n    do wait elapsed(1s)\n")
    (tmp_path / "search.vast").write_text(
        "version: 1\nexecution: {scenario_file: wait.osc}\n"
        "search: {strategy: optuna, search_space: {a: {type: int, low: 1, high: 2}}, budget: {batches: 1}}\n"
    )
    said = refused("validate", tmp_path / "search.vast")
    assert "The library optuna is not installed. Call pip install -e '.[search]' in the checkout" in said


def test_plan_lists_assumed_mount_and_radii_of_oracles(campaign):
    file = campaign(robot=f"polygon: {SQUARE}, lidar: {{angle_min: -1.5, angle_max: 1.5}}")
    result = called("plan", file, "--json")
    (robot,) = json.loads(result.stdout)["robots"]
    said = "\n".join(robot["robot"])
    assert (
        "assumed, as angles of its own are given: lidar mounted at x 0 m, lidar mounted at y 0 m, lidar turned by 0 rad"
        in said
    )
    assert "performance takes 0.3 m (inscribed), safety 0.5 m (circumscribed)" in said


JAZZY = "parameters of Nav2 Jazzy's default file"


@each_row(
    ("filled", "summary"),
    [
        ({}, f"{JAZZY}; footprint, drive, mass, limits, and lidar of a TurtleBot 4 are assumed"),
        (
            {"robot": "mass: 9, lidar: {rate: 10}"},
            f"mass and lidar as described; {JAZZY}; footprint, drive, limits, and the rest of the lidar of a TurtleBot 4 are assumed",
        ),
        (
            {"nav2": "robot_radius: 0.3, update_frequency: 4.0"},
            "footprint, limits, and 2 parameters from nav2.yaml; drive, mass, the rest of the limits, and lidar of a TurtleBot 4 are assumed",
        ),
        (
            {"nav2": "robot_radius: 0.3", "parameters": "robot_radius: 0.4"},
            "footprint, limits, and 1 parameter from nav2.yaml and the campaign; drive, mass, the rest of the limits, and lidar of a TurtleBot 4 are assumed",
        ),
        (
            {"producers": "- ParameterVariationList: {name: robot_radius, values: [0.2, 0.3]}"},
            f"{JAZZY}; footprint, drive, mass, limits, and lidar of a TurtleBot 4 are assumed; varied: robot_radius",
        ),
    ],
)
def test_plan_says_whose_robot_it_is(campaign, filled, summary):
    (robot,) = json.loads(called("plan", campaign(**filled), "--json").stdout)["robots"]
    assert robot["summary"] == summary


@each_row(
    ("system", "inscribed_m", "circumscribed_m"),
    [
        ({}, 0.22, 0.17),
        ({"robot_radius": 0.35}, 0.35, 0.35),
        ({"robot.radius": 0.4}, 0.4, 0.4),
        ({"robot.polygon": SQUARE}, 0.3, 0.5),
        ({"local_costmap.footprint": SQUARE}, 0.3, 0.5),
    ],
)
def test_oracles_take_size_of_robot(system, inscribed_m, circumscribed_m):
    task = {"start_pose": {"x": 0.0, "y": 0.0}, "goal_pose": {"x": 1.0, "y": 0.0}}
    found = situation_of(Scenario("builtin:navigate_to_pose", 60.0, {}, task, system))
    assert (found.inscribed_radius_m, found.circumscribed_radius_m) == pytest.approx((inscribed_m, circumscribed_m))
