"""Defaults of Nav2's code that count otherwise than in an earlier campaign are named by replay and comparison."""

from table import each_row

from vastflow.flows.results.provenance import (
    DEFAULTS_KEY,
    STAGES,
    campaign_changes,
    default_changes,
    origin_differences,
)
from vastflow.producers.campaign import system_file_of
from vastflow.producers.campaign_file.document import read_document
from vastflow.sim.nav2.parameter_files.parameter_file import nav2_file

SHIM = "nav2_rotation_shim_controller::RotationShimController"
RPP = "nav2_regulated_pure_pursuit_controller::RegulatedPurePursuitController"
ANGLE = "controller_server.ros__parameters.FollowPath.angular_disengage_threshold"


def file_text(more=""):
    own = f"FollowPath: {{plugin: '{SHIM}', primary_controller: '{RPP}'{more}}}"
    return f"controller_server: {{ros__parameters: {{controller_plugins: [FollowPath], {own}}}}}"


def test_replay_of_a_directory_without_defaults_names_those_that_changed(tmp_path):
    (tmp_path / "nav2.yaml").write_text(file_text())
    metadata = {"source": {"execute": "e"}, "numeric_class": "n", "versions": {}}
    (words,) = origin_differences(metadata, "n", "e", {"nav2_params": nav2_file(tmp_path / "nav2.yaml")})
    assert f"{ANGLE} is now 0.3925" in words
    assert origin_differences(metadata, "n", "e", {}) == []


@each_row(
    ("then", "now", "words"),
    [
        ({"a": {"value": 0.1, "since": ""}}, {"a": {"value": 0.2, "since": ""}}, ["a from 0.1 to 0.2"]),
        ({"a": {"value": 0.1, "since": "0.2"}}, {"a": {"value": 0.1, "since": "0.2"}}, []),
        ({}, {"a": {"value": 0.1, "since": "0.2"}}, []),  # the earlier file has it
        (None, {"a": {"value": 0.1, "since": "0.2"}}, ["a is now 0.1"]),
        (None, {"a": {"value": 0.1, "since": ""}}, []),
    ],
)
def test_default_changes_are_those_of_values(then, now, words):
    found = default_changes({} if then is None else {DEFAULTS_KEY: then}, {DEFAULTS_KEY: now})
    assert [each.rpartition(": ")[2] for each in found] == words


@each_row(
    ("text", "words"),
    [
        ("execution: {nav2_params: nav2.yaml}", ["a is now 0.1"]),
        ("execution: {runs: 2} # nav2_params: nav2.yaml", []),  # no file, no gaps in it
    ],
)
def test_comparison_with_a_campaign_of_before_names_defaults_of_its_file_alone(tmp_path, text, words):
    (tmp_path / "campaign.vast").write_text(text)
    parts = {"files": {}, "libraries": {}}
    same = {"numeric_class": "n", "seed": 0, "oracles": [], "code": dict.fromkeys(STAGES, parts)}
    now = {**same, DEFAULTS_KEY: {"a": {"value": 0.1, "since": "0.2"}}}
    assert [each.rpartition(": ")[2] for each in campaign_changes(same, now, tmp_path)] == words


def test_campaign_with_a_file_has_its_defaults(tmp_path):
    (tmp_path / "nav2.yaml").write_text(file_text())
    (tmp_path / "full.yaml").write_text(file_text(", angular_disengage_threshold: 0.5"))
    rows = []
    for text in ("{nav2_params: nav2.yaml}", "{nav2_params: full.yaml}", ""):
        (tmp_path / "a.vast").write_text(f"execution: {text}")
        rows.append(system_file_of(read_document(tmp_path / "a.vast"), tmp_path).defaults)
    assert rows[0][ANGLE] == {"value": 0.3925, "since": "0.2"}
    assert ANGLE not in rows[1]
    assert rows[2] is None
