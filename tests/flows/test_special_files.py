"""Pipes and devices in place of files, refused at once by every command that reads files."""

import os

import pytest
from typer.testing import CliRunner

from vastflow.flows.__main__ import app

POSES = "{start_pose: {x: 1, y: 1, yaw: 0}}, {goal_pose: {x: 2, y: 1, yaw: 0}}"
NAMED = {
    "map": f"configuration: [{{name: a, parameters: [{{map_file: pipe}}, {POSES}]}}]",
    "picture": f"configuration: [{{name: a, parameters: [{{map_file: of_pipe.yaml}}, {POSES}]}}]",
    "endless picture": f"configuration: [{{name: a, parameters: [{{map_file: of_zero.yaml}}, {POSES}]}}]",
    "plan": f"configuration: [{{name: a, parameters: [{POSES}], variations: [{{FloorplanGeneration: {{floorplans: [pipe]}}}}]}}]",
    "producer": f"configuration: [{{name: a, parameters: [{POSES}], variations: [{{'pipe.py:A': {{}}}}]}}]",
    "oracle": f"configuration: [{{name: a, parameters: [{POSES}]}}]\nevaluation: {{oracles: ['pipe.py:A']}}",
    "notebook": f"configuration: [{{name: a, parameters: [{POSES}]}}]\nevaluation: {{oracles: [pipe.ipynb]}}",
    "scenario": f"configuration: [{{name: a, parameters: [{POSES}]}}]\nexecution: {{scenario_file: pipe.osc}}",
    "parameters": f"configuration: [{{name: a, parameters: [{POSES}]}}]\nexecution: {{nav2_params: pipe}}",
}


@pytest.fixture
def folder(tmp_path, monkeypatch):
    for name in ("pipe", "pipe.osc", "pipe.py", "pipe.ipynb"):
        os.mkfifo(tmp_path / name)
    for name, image in (("of_pipe", "pipe"), ("of_zero", "/dev/zero")):
        (tmp_path / f"{name}.yaml").write_text(f"{{image: {image}, resolution: 0.05, origin: [0, 0, 0]}}")
    monkeypatch.chdir(tmp_path)
    return tmp_path


def refused(*arguments):
    result = CliRunner().invoke(app, arguments)
    assert (result.exit_code, result.stdout) == (2, "")
    return result.stderr


@pytest.mark.parametrize("what", NAMED)
def test_campaign_that_names_a_pipe_is_refused(folder, what):
    (folder / "c.vast").write_text(NAMED[what])
    assert "c.vast:" in refused("validate", "c.vast")


@pytest.mark.parametrize(
    "arguments",
    [
        ("validate", "pipe"),
        ("scenario", "check", "pipe.osc"),
        ("floorplan", "geometry", "pipe"),
        ("floorplan", "variations", "pipe", "--out", "drawn"),
        ("params", "pipe"),
    ],
    ids=" ".join,
)
def test_command_that_is_given_a_pipe_refuses_it(folder, arguments):
    assert "can't be read: it is a pipe" in refused(*arguments)
