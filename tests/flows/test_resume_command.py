"""The command `resume`: a campaign again from its own directory, whole or half written."""

import json
import os
import shutil
import subprocess
import sys
import time
from datetime import datetime
from pathlib import Path
from types import SimpleNamespace

import psutil
import pytest
from table import each_row
from typer.testing import CliRunner
from whole_directory import ConfigurationResult, write_results

from vastflow.flows import api
from vastflow.flows.__main__ import app
from vastflow.flows.request.asked import Asked, asked_of
from vastflow.flows.request.campaign_file import read_campaign
from vastflow.flows.request.campaign_keys import campaign_keys, recorded_keys
from vastflow.flows.results.directory import ABANDONED_S, WRITER, left_behind, new_directory, sweep, writer_of
from vastflow.flows.results.inputs import inputs_of, replica
from vastflow.flows.results.provenance import ingredients_row
from vastflow.flows.results.summary import Summary, Work
from vastflow.oracles.evidence.rates import Counts
from vastflow.oracles.results.unusable import UnusableDirectory
from vastflow.producers.instantiation.instantiate import instantiate
from vastflow.tasks.keys.source import installed_tree

CREATED = datetime(2026, 11, 21, 6, 5, 4)
SUMMARY = Summary(2, 0, 0, 4, 0, 4, 4, 0, 0, 0.0, 3.0, 2.0, "results/x", {"success": Counts(4, 0, 0)})


def called(*arguments):
    return CliRunner().invoke(app, [str(argument) for argument in arguments])


@pytest.fixture(scope="module")
def tree():
    return installed_tree()


FLOORPLANS = Path(__file__).parents[2] / "campaigns" / "floorplans"
PLANS = """\
metadata: {name: plans}
configuration:
  - name: both
    start_check: none
    parameters:
      - start_pose: {x: 0.0, y: 0.0, yaw: 0.0}
      - goal_pose: {x: 1.0, y: 0.0, yaw: 0.0}
    variations:
      - OneOfVariation:
          variations:
            - FloorplanVariation: {variation_files: [../floorplans/corridors.variation]}
            - FloorplanGeneration: {floorplans: [../floorplans/nested_rooms.fpm]}
"""


@pytest.fixture
def directory(small_room, tmp_path, tree):
    """A campaign directory without recordings, whose map lies outside of the campaign file's folder."""
    maps = tmp_path / "maps"
    maps.mkdir()
    for name in ("room.yaml", "room.pgm"):
        shutil.move(small_room.with_name(name), maps / name)
    small_room.write_text(small_room.read_text().replace("room.yaml", "../maps/room.yaml"))
    return written(small_room, tmp_path / "results", tree)


def written(path, root, tree, only=(), sample=None, map_dir=None, as_v1=False):
    campaign, oracles = read_campaign(path, map_dir, as_v1=as_v1)
    inputs, keys = inputs_of(campaign, oracles), campaign_keys(tree, campaign.seed, oracles)
    asked = Asked(path.name, 3, tuple(only), inputs.places, sample, as_v1)
    return write_results(
        root,
        campaign,
        inputs,
        instantiate(campaign),
        lambda configuration: ConfigurationResult(),
        runs=3,
        oracles=["success"],
        keys=keys,
        record={"asked": asked.as_json(), **ingredients_row(tree, campaign.families, oracles)},
        created=CREATED,
        work=lambda: Work(0, 0, 0.0, 0.0, 0.0),
        report=lambda directory: None,
    ).directory


@pytest.fixture
def asked_again(monkeypatch):
    """What a campaign was run with, instead of running it."""
    calls = []

    def run_campaign(request, *, observer):
        campaign, _ = read_campaign(Path(request.campaign), request.map_dir and Path(request.map_dir))
        digests = [c.scenario.digest for c in instantiate(campaign).configurations]
        calls.append({"digests": digests, **request.model_dump()})
        raise KeyboardInterrupt

    monkeypatch.setattr(api, "run_campaign", run_campaign)
    return calls


def resumed(*arguments):
    return CliRunner().invoke(app, ["run", *map(str, arguments)], catch_exceptions=True)


def test_campaign_runs_again_from_its_own_inputs_with_the_runs_that_were_asked(
    directory, small_room, tmp_path, asked_again
):
    digests = [c.scenario.digest for c in instantiate(read_campaign(small_room)[0]).configurations]
    shutil.rmtree(small_room.parent)
    shutil.rmtree(tmp_path / "maps")
    result = resumed(directory, "--store", tmp_path / "store", "--workers", 2)
    assert f"small_room of 2026-11-21 06:05:04 from the inputs in {directory}, 3 runs of each" in result.stderr
    (call,) = asked_again
    assert call["digests"] == digests
    assert (call["runs"], call["results"], call["only"], call["workers"]) == (3, str(directory.parent), (), 2)


def test_plan_of_a_directory_is_made_from_its_own_inputs(directory, small_room, tmp_path):
    shutil.rmtree(small_room.parent)
    result = called("plan", directory, "--store", tmp_path / "store", "--json")
    said = json.loads(result.stdout)
    assert (said["file"], said["compared_with"]) == (str(directory), str(directory))
    assert (said["runs"], said["stages"]["execute"]) == (3, {"reused": 0, "computed": 6})


def test_selection_that_was_asked_is_kept(small_room, tmp_path, tree, asked_again):
    result = resumed(written(small_room, tmp_path / "results", tree, only=["room-1"]))
    assert "3 runs of each configuration, only room-1" in result.stderr
    assert asked_again[0]["only"] == ("room-1",)


def test_sample_that_was_asked_is_kept(small_room, tmp_path, tree, asked_again):
    result = resumed(written(small_room, tmp_path / "results", tree, sample=7))
    assert "3 runs of each configuration, a sample of 7" in result.stderr
    assert asked_again[0]["sample"] == 7


@pytest.mark.parametrize("name", ["halls/room.yaml", "../halls/room.yaml"])
def test_maps_of_another_folder_are_kept_as_if_they_lay_beside_the_file(name, small_room, tmp_path, tree, asked_again):
    maps = tmp_path / "somewhere" / "maps"
    folder = (maps / name).resolve().parent
    folder.mkdir(parents=True)
    for moved in ("room.yaml", "room.pgm"):
        shutil.move(small_room.with_name(moved), folder / moved)
    small_room.write_text(small_room.read_text().replace("room.yaml", name))
    maps.mkdir(exist_ok=True)
    directory = written(small_room, tmp_path / "results", tree, map_dir=maps)
    digests = [c.scenario.digest for c in instantiate(read_campaign(small_room, maps)[0]).configurations]
    shutil.rmtree(tmp_path / "somewhere")
    resumed(directory)
    assert asked_again[0]["digests"] == digests


def test_map_named_from_the_root_of_another_machine_is_among_the_inputs(small_room, tmp_path, tree, asked_again):
    maps = tmp_path / "maps"
    maps.mkdir()
    for moved in ("room.yaml", "room.pgm"):
        shutil.move(small_room.with_name(moved), maps / moved)
    small_room.write_text(small_room.read_text().replace("room.yaml", "/opt/elsewhere/maps/room.yaml"))
    directory = written(small_room, tmp_path / "results", tree, map_dir=maps)
    digests = [c.scenario.digest for c in instantiate(read_campaign(small_room, maps)[0]).configurations]
    shutil.rmtree(maps)
    resumed(directory)
    assert asked_again[0]["digests"] == digests


def test_floor_plans_and_their_variations_are_among_the_inputs(tmp_path, tree, asked_again):
    folder = tmp_path / "campaign"
    folder.mkdir()
    shutil.copytree(FLOORPLANS, tmp_path / "floorplans")
    (folder / "plans.vast").write_text(PLANS)
    directory = written(folder / "plans.vast", tmp_path / "results", tree)
    shutil.rmtree(tmp_path / "floorplans")
    shutil.rmtree(folder)
    assert "damaged" not in resumed(directory).stderr
    assert len(asked_again[0]["digests"]) == 2


@pytest.mark.parametrize("as_v1", [False, True])
def test_obstacles_are_placed_by_the_rule_by_which_they_were(small_room, tmp_path, tree, asked_again, as_v1):
    directory = written(small_room, tmp_path / "results", tree, as_v1=as_v1)
    said = resumed(directory).stderr
    assert asked_again[0]["as_v1"] is as_v1
    assert ("obstacles as version 1 of RoboVAST places them" in said) is as_v1


def test_copy_of_the_inputs_is_gone_afterwards(directory):
    with replica(directory, asked_of(json.loads((directory / "metadata.json").read_text()))) as laid_out:
        folder = laid_out.file.parent
        assert laid_out.file.name == "room.vast" and (folder / "../maps/room.yaml").is_file()
    assert not folder.exists()


def test_file_named_from_the_root_that_is_another_by_now_is_refused(small_room, tmp_path, tree):
    outside = tmp_path / "room.yaml"
    shutil.move(small_room.with_name("room.yaml"), outside)
    shutil.move(small_room.with_name("room.pgm"), tmp_path)
    small_room.write_text(small_room.read_text().replace("room.yaml", str(outside)))
    directory = written(small_room, tmp_path / "results", tree)
    asked = asked_of(json.loads((directory / "metadata.json").read_text()))
    with replica(directory, asked) as laid_out:
        assert laid_out.file.is_file()
    outside.write_text(outside.read_text().replace("0.05", "0.1"))
    with (
        pytest.raises(UnusableDirectory, match=r"room\.yaml is another file now than in its inputs; put back"),
        replica(directory, asked),
    ):
        pass


def test_inputs_that_somebody_deleted_are_said(directory):
    shutil.rmtree(directory / "inputs")
    result = resumed(directory)
    assert result.exit_code == 2
    assert f"{directory}: its inputs can't be read any more: {directory}/campaign.vast:" in result.stderr


def test_keys_of_a_campaign_follow_from_its_directory(directory, small_room, tree):
    campaign, oracles = read_campaign(small_room)
    metadata = json.loads((directory / "metadata.json").read_text())
    keys = campaign_keys(tree, campaign.seed, oracles)
    assert recorded_keys(metadata) == keys
    assert recorded_keys(metadata).verdicts("s", "r", "t") == keys.verdicts("s", "r", "t")


def test_campaign_that_never_ended_has_no_directory_and_the_message_says_what_does_go_on(tmp_path):
    result = resumed(tmp_path / "results" / "nothing")
    assert result.exit_code == 2
    assert "no such folder; `vastflow run` with the campaign file" in result.stderr


@each_row("content", ["{", "{}", "[]", '{"name": "x", "created": "y", "counts": {}}'])
def test_damaged_directory_exits_with_2(tmp_path, content):
    (tmp_path / "metadata.json").write_text(content)
    result = resumed(tmp_path)
    assert result.exit_code == 2 and "damaged campaign directory" in result.stderr


def test_folder_that_is_no_campaign_directory_exits_with_2(tmp_path):
    result = resumed(tmp_path)
    assert result.exit_code == 2 and "has no metadata.json" in result.stderr


@pytest.fixture
def half(directory):
    """What a process that was killed left of a campaign directory."""
    partial = directory.with_name(f".{directory.name}.partial")
    directory.rename(partial)
    (partial / WRITER).write_text(json.dumps({"host": os.uname().nodename, "pid": gone_pid(), "began_s": 1.0}))
    return partial


def gone_pid():
    ended = subprocess.Popen([sys.executable, "-c", ""])
    ended.wait()
    return ended.pid


def test_directory_that_was_left_half_written_is_found_by_either_name(half, directory, asked_again):
    for name in (half, directory):
        result = resumed(name)
        assert f"{half} was left incomplete by a killed process" in result.stderr
    assert [call["runs"] for call in asked_again] == [3, 3]


def test_directory_that_is_being_written_is_left_alone(half, directory):
    me = psutil.Process()
    writer = {"host": os.uname().nodename, "pid": me.pid, "began_s": me.create_time()}
    (half / WRITER).write_text(json.dumps(writer))
    result = resumed(directory)
    assert result.exit_code == 2 and f"process {me.pid} is writing it" in result.stderr


def test_half_written_directory_without_inputs_is_said(half):
    (half / "metadata.json").unlink()
    result = resumed(half)
    assert result.exit_code == 2 and "incomplete campaign directory; `vastflow run`" in result.stderr


def aged(folder, age_s):
    then = time.time() - age_s
    for path in [*folder.rglob("*"), folder]:
        os.utime(path, (then, then))


def test_what_was_left_a_day_ago_is_swept_with_the_next_directory(half, tmp_path):
    aged(half, ABANDONED_S - 60)
    sweep(half.parent)
    assert half.is_dir()
    aged(half, ABANDONED_S + 60)
    with new_directory(half.parent, "c", CREATED):
        assert not half.exists()


def test_what_is_being_written_is_never_swept(tmp_path):
    with new_directory(tmp_path, "c", CREATED) as directory:
        aged(directory.partial, 2 * ABANDONED_S)
        assert writer_of(directory.partial) == os.getpid()
        sweep(tmp_path)
        assert left_behind(directory.final) == directory.partial
    assert [path.name for path in directory.final.iterdir()] == []


def test_later_process_of_the_same_number_is_not_the_writer(tmp_path):
    (tmp_path / WRITER).write_text(json.dumps({"host": os.uname().nodename, "pid": os.getpid(), "began_s": 1.0}))
    assert writer_of(tmp_path) is None
    (tmp_path / WRITER).write_text(json.dumps({"host": "other", "pid": os.getpid(), "began_s": 1.0}))
    assert writer_of(tmp_path) is None
    (tmp_path / WRITER).write_text("{")
    assert writer_of(tmp_path) is None


def test_interrupted_run_of_a_directory_says_how_to_go_on(directory, monkeypatch):
    def run_campaign(path, **options):
        os.kill(os.getpid(), 2)
        raise AssertionError("the interrupt should have come before this")

    monkeypatch.setattr(api, "run_campaign", run_campaign)
    monkeypatch.setattr(sys, "argv", ["/usr/bin/vastflow", "run", "results/x"])
    result = resumed(directory)
    assert result.exit_code == 130
    assert "interrupted; `vastflow run results/x` again computes only what is missing" in result.stderr


def test_summary_is_printed_as_json(directory, monkeypatch):
    found = SimpleNamespace(summary=SUMMARY, notes=(), faults=())
    monkeypatch.setattr(api, "run_campaign", lambda path, **options: found)
    result = resumed(directory, "--json")
    assert (result.exit_code, json.loads(result.stdout)["runs"]) == (0, 4)
