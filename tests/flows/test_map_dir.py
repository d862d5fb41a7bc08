"""The options `--map-dir` and `--sample` of the commands that read a campaign file."""

import json
import shutil

import pytest
import yaml
from typer.testing import CliRunner

from vastflow.flows.__main__ import app


def called(*arguments):
    return CliRunner().invoke(app, [str(argument) for argument in arguments])


@pytest.fixture
def apart(small_room, tmp_path, monkeypatch):
    """A campaign file whose map lies in another folder."""
    monkeypatch.setenv("VASTFLOW_STORE", str(tmp_path / "store"))
    maps = tmp_path / "maps" / "halls"
    maps.mkdir(parents=True)
    for name in ("room.yaml", "room.pgm"):
        shutil.move(small_room.with_name(name), maps / name)
    small_room.write_text(small_room.read_text().replace("room.yaml", "halls/room.yaml"))
    return small_room, maps.parent


def test_file_with_maps_elsewhere_needs_the_option(apart):
    file, maps = apart
    assert called("validate", file, "--map-dir", maps).exit_code == 0
    without = called("validate", file)
    assert (without.exit_code, "--map-dir" in without.stderr) == (2, True)


@pytest.mark.parametrize("command", ["run", "validate", "plan", "deploy"])
def test_folder_that_is_not_there_is_refused(command, apart):
    file, maps = apart
    pool = ["--pool", "p"] if command == "deploy" else []
    result = called(command, file, "--map-dir", maps / "none", *pool)
    assert (result.exit_code, result.stdout) == (2, "")
    assert f"--map-dir: expected a folder of maps, got '{maps / 'none'}'" in result.stderr


def test_plan_finds_the_maps_and_says_of_how_many_the_sample_is(apart, tmp_path):
    file, maps = apart
    options = ["--map-dir", maps, "--sample", 1, "--results", tmp_path]
    said = json.loads(called("plan", file, *options, "--json").stdout)
    assert (said["coverage"]["realised"], said["configurations"], said["sampled_from"]) == (2, 1, 2)
    assert said["stages"]["execute"] == {"reused": 0, "computed": 2}
    assert "a sample of 1 of 2 distinct configurations" in called("plan", file, *options).stdout


def test_deployment_has_the_folder_of_maps_and_the_sample_among_its_parameters(apart):
    file, maps = apart
    result = called("deploy", file, "--pool", "p", "--map-dir", maps, "--sample", 3, "--dry-run")
    deployment, _ = yaml.safe_load(result.stdout.split("---")[0])["deployments"]
    assert (deployment["parameters"]["request"]["map_dir"], deployment["parameters"]["request"]["sample"]) == (
        str(maps),
        3,
    )
