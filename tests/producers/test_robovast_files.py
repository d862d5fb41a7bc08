"""Campaign files of RoboVAST 2 as files of version 1, and the words on them."""

import pytest
import yaml
from typer.testing import CliRunner

from vastflow.flows.cli.__main__ import app
from vastflow.producers.campaign import load_campaign
from vastflow.producers.campaign_file.robovast import Converter
from vastflow.sim.model.faults import FileError

FILE = """
version: 4
metadata: {name: hall}
plugins: [robovast-nav]
configuration:
  - name: hall
    use: [base]
    parameters:
      scenario: {start_pose: {x: 1.0, y: 1.0, yaw: 0.0}, goal_pose: {x: 8.0, y: 1.0, yaw: 0.0}}
      sim: {map_file: hall.yaml, lighting: dim}
      sut: {nav2.controller_server.FollowPath.vx_max: 0.4, other: 1}
    variations:
      - ParameterVariationList: {sut: nav2.robot_radius, values: [0.2, 0.25]}
      - ParameterVariationList: {scenario: [a, b], values: [[0.0, 1.0]]}
      - PathVariationRandom: {scenario: {start: start_pose, goal: goal_poses}, path_length: 5.0}
      - ObstacleVariation: {sim: static_objects, reads: {map: map_file}, seed: 1}
      - ParameterVariationList: {sim: components.pedestrian.dwell, values: [0.0, 2.0]}
execution:
  runs: 2
  timeout: 240
  runs_per_job: 2
  shm_size: 512Mi
  containers:
    sut: {ros_packages: [], resources: {cpu: 1.25}, config_files: {nav2: files/nav2.yaml, bridge: b.yaml}}
    scenario: {image: a/b, resources: {cpu: 4, memory_limit: 8Gi}}
results_processing: {postprocessing: [], health_checks: [nav2]}
visualization: {}
"""


@pytest.mark.parametrize("version", [2, 3, 4])
def test_schema_of_robovast_2_is_an_error_that_names_the_converter(tmp_path, version):
    (file := tmp_path / "a.vast").write_text(FILE.replace("version: 4", f"version: {version}"))
    with pytest.raises(
        FileError, match=rf"2:10: version: {version} is a schema of RoboVAST 2\. .*--from-robovast"
    ) as caught:
        load_campaign(file)
    assert len(caught.value.faults) == 1


def test_converter_writes_what_version_1_can_say_and_names_the_rest():
    converter = Converter()
    found = converter.campaign(yaml.safe_load(FILE))
    (family,) = found["configuration"]
    assert [key for entry in family["parameters"] for key in entry] == [
        *("start_pose", "goal_pose", "map_file", "controller_server.FollowPath.vx_max"),
    ]
    assert family["variations"] == [
        {"ParameterVariationList": {"name": "robot_radius", "values": [0.2, 0.25]}},
        {"ParameterVariationList": {"name": ["a", "b"], "values": [[0.0, 1.0]]}},
        {"PathVariationRandom": {"start_pose": "start_pose", "goal_poses": "goal_poses", "path_length": 5.0}},
        {"ObstacleVariation": {"name": "static_objects", "seed": 1}},
    ]
    execution = found["execution"]
    assert (execution["timeout"], execution["image"], execution["resources"]) == (120.0, "a/b", {"cpu": 4})
    assert execution["nav2_params"] == "files/nav2.yaml"
    assert execution["secondary_containers"] == [{"name": "sut", "resources": {"cpu": 2}}]
    assert sorted(converter.left) == [
        "configuration[0].parameters.sim.lighting",
        "configuration[0].parameters.sut.other",
        "configuration[0].use",
        "configuration[0].variations[3].ObstacleVariation.reads",
        "configuration[0].variations[4].ParameterVariationList.sim.components.pedestrian.dwell",
        "execution.containers.scenario.resources.memory_limit",
        "execution.containers.sut.config_files.bridge",
        "execution.containers.sut.ros_packages",
        "execution.shm_size",
        "plugins",
        "results_processing.health_checks",
        "visualization",
    ]


def test_converter_keeps_parameters_of_config_files_of_other_sources():
    converter = Converter()
    text = FILE.replace("sut: nav2.robot_radius", "sut: bridge.a.rate").replace("other: 1}", "bridge.port: 1}")
    found = converter.campaign(yaml.safe_load(text))
    (family,) = found["configuration"]
    assert {"sut.bridge.port": 1} in family["parameters"]
    assert family["variations"][0] == {"ParameterVariationList": {"name": "sut.bridge.a.rate", "values": [0.2, 0.25]}}
    assert found["execution"]["config_files"] == {"bridge": "b.yaml"}
    assert not [left for left in converter.left if "bridge" in left or "sut.other" in left]


def test_converter_keeps_steps_and_parameters_that_have_no_slots():
    steps = [
        {"ParameterVariationList": {"name": "robot_radius", "values": [0.2, 0.3]}},
        {"ParameterVariationDistributionUniform": {"name": ["a", "b"], "num_variations": 2, "min": 0, "max": 1}},
        {"PathVariationRandom": {"path_length": 5.0}},
    ]
    family = {"name": "hall", "parameters": [{"map_file": "hall.yaml"}], "variations": steps}
    converter = Converter()
    assert converter.campaign({"version": 3, "configuration": [family]})["configuration"] == [family]
    assert converter.left == []


@pytest.mark.parametrize(
    ("text", "left"),
    [
        ("configuration: [{parameters: {map_file: hall.yaml}}]", "configuration[0].parameters.map_file"),
        ("configuration: [{parameters: {sut: 3}}]", "configuration[0].parameters.sut"),
        (
            "configuration: [{variations: [{ParameterVariationList: {sim: 3, values: [1]}}]}]",
            "configuration[0].variations[0].ParameterVariationList.sim.3",
        ),
        ("execution: {containers: [a]}", "execution.containers"),
        ("execution: {containers: {sut: a}}", "execution.containers.sut"),
        ("execution: {containers: {sut: {resources: [1]}}}", "execution.containers.sut.resources"),
        ("execution: {containers: {sut: {config_files: a}}}", "execution.containers.sut.config_files"),
        ("execution: {timeout: 10, runs_per_job: 0, shm_size: 1}", "execution.shm_size"),
    ],
)
def test_converter_names_what_has_another_form(text, left):
    converter = Converter()
    converter.campaign(yaml.safe_load(f"version: 3\n{text}"))
    assert converter.left == [left]


@pytest.mark.parametrize(("version", "place"), [("version: 1", "1:10"), ("version: 5", "1:10"), ("runs: 3", "1:1")])
def test_converter_refuses_other_versions(tmp_path, version, place):
    (file := tmp_path / "a.vast").write_text(f"{version}\nconfiguration: []\n")
    refused = CliRunner().invoke(app, ["validate", "--from-robovast", str(file)])
    assert refused.exit_code == 2
    assert f"{place}: version: expected a schema of RoboVAST 2 (2, 3, or 4), got " in refused.stderr
    assert not refused.stdout


def test_converted_file_is_a_campaign(tmp_path):
    """Without what only a file of RoboVAST's own has beside it."""
    (tmp_path / "a.vast").write_text(
        "version: 4\nconfiguration: [{name: a, parameters: {scenario: {goal_pose: {x: 1.0, y: 1.0, yaw: 0.0}}}}]"
    )
    shown = CliRunner().invoke(app, ["validate", "--from-robovast", str(tmp_path / "a.vast")])
    (tmp_path / "b.vast").write_text(shown.stdout)
    with pytest.raises(FileError) as caught:
        load_campaign(tmp_path / "b.vast")
    assert all("map_file" in str(fault) for fault in caught.value.faults)
