"""The option `--as-v1` of the commands that read a campaign file."""

import json

import pytest
import yaml
from typer.testing import CliRunner

from vastflow.flows.__main__ import app

CLUTTER = """
  - name: clutter
    parameters:
      - map_file: room.yaml
    variations:
      - PathVariationRandom: {path_length: 2.0, robot_diameter: 0.35, goal_poses: "@goal_pose"}
      - ObstacleVariation:
          obstacle_configs: [{amount: 1, max_distance: 3.0, args: "width:=9.0, length:=0.02"}]
"""
"""A board of 9 m finds no room in a room of 4 m, unless it may stand in its walls."""


def called(*arguments):
    return CliRunner().invoke(app, [str(argument) for argument in arguments])


@pytest.fixture
def file(small_room, tmp_path, monkeypatch):
    monkeypatch.setenv("VASTFLOW_STORE", str(tmp_path / "store"))
    text = small_room.read_text()
    head, execution = text.split("execution:", 1)
    small_room.write_text(f"{head.rstrip()}\n{CLUTTER}execution:{execution}")
    return small_room


def test_validate_says_that_the_two_placements_differ(file):
    said, as_v1 = called("validate", file), called("validate", file, "--as-v1")
    assert (said.exit_code, as_v1.exit_code) == (0, 0)
    assert "version 1 of RoboVAST places them otherwise, as does --as-v1" in said.stdout
    assert "without --as-v1 they keep clear" in as_v1.stdout


def test_plan_counts_what_such_a_run_has(file, tmp_path):
    plans = [
        json.loads(called("plan", file, "--results", tmp_path, "--json", *option).stdout)
        for option in ([], ["--as-v1"])
    ]
    counted = [each["coverage"] for each in plans]
    assert [(each["unrealisable"], each["realised"]) for each in counted] == [(1, 2), (0, 3)]
    assert [each["configurations"] for each in plans] == [2, 3]


def test_deployment_has_it_among_its_parameters_where_it_is_asked(file):
    for option, given in (([], None), (["--as-v1"], True)):
        result = called("deploy", file, "--pool", "p", "--dry-run", *option)
        deployment, _ = yaml.safe_load(result.stdout.split("---")[0])["deployments"]
        assert deployment["parameters"]["request"].get("as_v1") is given
