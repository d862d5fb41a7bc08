"""The keys of version 1 of the format and their rules."""

import json
import re
from pathlib import Path
from typing import Any

import pytest
import yaml
from pydantic import ValidationError
from table import each_row

from vastflow.producers.campaign_file.document import faults_of, read_document
from vastflow.producers.campaign_file.sections import Stop
from vastflow.producers.campaign_file.spec import CampaignSpec, campaign_schema, unexecuted

EVERY_KEY = """
version: 1
metadata: {name: study, dataset_iri: https://example.org/, agents: [{name: a, type: b}]}
general: {anything: 1}
configuration:
- name: rooms-1
  parameters: [{map_file: maps/rooms.yaml}, {start_pose: {x: 1, y: 2}}]
  variations: [{ParameterVariationList: {name: a, values: [1]}}, {'own.py:Class': }]
  dimensions: {map_file: environment}
  design: cartesian
  constraints: [{ordered: a < b}]
constraints: {small: b < 9}
execution:
  image: ghcr.io/example/robot:1
  runs: 20
  seed: 7
  scenario_file: scenario.osc
  nav2_params: nav2.yaml
  timeout: 300
  simulation: own.module:Simulation
  resources: {cpu: [{here: 4}, {there: 8}], memory: [{here: 4Gi}]}
  secondary_containers: [nav, {sim: , resources: {cpu: 2, memory: 2Gi, gpu: 1}}, {name: third}, {x: {resources: {cpu: 3}}}]
  env: [{LANGUAGE: en}, {COUNT: 2}]
  run_files: ['files/**', '*.xml']
  runs_per_job: 4
  pre_command: /pre.sh
  post_command: /post.sh
  run_as_user: 0
  local: {parameter_overrides: [{headless: false}]}
  kubernetes: {jobs: {node_labels: {pool: jobs}}, control: {node_labels: {pool: control}}}
results_processing:
  postprocessing: [rosbags_bt_to_csv, {rosbags_tf_to_csv: {frames: [base_link]}}]
  metadata_processing: [own]
  publication: [{zip: {destination: out}}]
evaluation:
  oracles: [safety, {performance: {threshold: 0.22}}]
  visualization: [{Overview: {run: run.ipynb, config: c.ipynb, batch: b.ipynb, campaign: all.ipynb}}]
"""


def spec_of(text: str) -> CampaignSpec:
    return CampaignSpec.model_validate(yaml.safe_load(text))


def complaints(folder: Path, text: str) -> list[str]:
    """Every fault of a file, without its name."""
    file = folder / "c.vast"
    file.write_text(text)
    document = read_document(file)
    with pytest.raises(ValidationError) as caught:
        CampaignSpec.model_validate(document.data)
    return [str(fault).removeprefix(f"{file}:") for fault in faults_of(document, (), CampaignSpec, caught.value)]


def test_keys_of_a_campaign_are_known() -> None:
    spec = spec_of(EVERY_KEY)
    assert spec.execution.runs == 20
    assert len(spec.execution.secondary_containers) == 4
    assert spec.evaluation.oracles == [{"safety": {}}, {"performance": {"threshold": 0.22}}]


@each_row("section", ["metadata", "general", "execution", "results_processing", "evaluation"])
def test_empty_section_equals_missing_section(section: str) -> None:
    assert spec_of(f"configuration: [{{name: a}}]\n{section}:\n").execution.runs == 1


def test_faults_of_keys_have_place_and_message(golden, tmp_path: Path) -> None:
    golden("campaign_files", "keys", lambda text: complaints(tmp_path, text))


def test_ineffective_keys_are_found() -> None:
    found = {".".join(map(str, location)) for location, _ in unexecuted(spec_of(EVERY_KEY))}
    assert found == {
        *(f"execution.{key}" for key in ("image", "simulation", "resources", "secondary_containers", "runs_per_job")),
        *("execution.run_as_user", "execution.kubernetes"),
        *(f"results_processing.{key}" for key in ("metadata_processing", "publication")),
        "general",
    }


@pytest.fixture(scope="module")
def schema() -> dict[str, Any]:
    return campaign_schema()


def test_schema_offers_the_parameters_of_known_producers(schema) -> None:
    offered = schema["$defs"]["FamilySpec"]["properties"]["variations"]["items"]["properties"]
    assert {"PathVariationRandom", "ObstacleVariation", "FloorplanGeneration"} <= set(offered)
    parameters = schema["$defs"][offered["PathVariationRandom"]["anyOf"][0]["$ref"].rsplit("/", 1)[-1]]
    assert "path_length" in parameters["properties"]


def test_schema_has_only_referenced_definitions(schema) -> None:
    assert set(re.findall(r'"#/\$defs/([^"]+)"', json.dumps(schema))) == set(schema["$defs"])


def test_properties_of_the_schema_are_described(schema) -> None:
    models = {"": schema, **schema["$defs"]}
    found = {(model, key): said for model, each in models.items() for key, said in each.get("properties", {}).items()}
    assert [place for place, said in found.items() if not said.get("description")] == []
    assert len(found) > 180


def test_schema_describes_keys_in_words_and_marks_those_without_effect(schema) -> None:
    execution = schema["$defs"]["ExecutionSpec"]["properties"]
    assert execution["runs"]["description"].startswith("Repetitions of each configuration: a number, or `{min, max,")
    assert execution["image"]["$comment"] == "not executed by this version"


def test_stop_refuses_classes_of_one_rate():
    with pytest.raises(ValueError, match=r"'systematic' is 0\.5 and 'reliable' 0\.5"):
        Stop(systematic=0.5, reliable=0.5)
