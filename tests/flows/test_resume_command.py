"""The command `run DIRECTORY`: a campaign again from its own directory, complete or half written."""

import json
import os
import shutil
import subprocess
import sys
import time
from pathlib import Path

import psutil
import pytest
from command_line import called, refused
from table import each_row
from whole_directory import CREATED, ConfigurationResult, write_results

from vastflow.flows import api
from vastflow.flows.request.campaign_file import read_campaign
from vastflow.flows.request.run_request import asked_of
from vastflow.flows.results.directory import ABANDONED_S, left_behind, new_directory, sweep
from vastflow.flows.results.inputs import replica
from vastflow.oracles.results.unfinished import WRITER, writer_of
from vastflow.oracles.results.unusable import UnusableDirectory
from vastflow.producers.instantiation.instantiate import instantiate

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


def written(path, root, tree, map_dir=None, **asked):
    found = ConfigurationResult()
    return write_results(path, root, found, runs=3, tree=tree, map_dir=map_dir, asked=asked).directory


@pytest.fixture
def asked_again(monkeypatch):
    calls = []

    def run_campaign(request, *, observer):
        campaign, _ = read_campaign(Path(request.campaign), request.map_dir and Path(request.map_dir))
        digests = [c.scenario.digest for c in instantiate(campaign).configurations]
        calls.append({"digests": digests, **request.model_dump()})
        raise KeyboardInterrupt

    monkeypatch.setattr(api, "run_campaign", run_campaign)
    return calls


def test_run_repeats_campaign_from_its_own_inputs(directory, small_room, tmp_path, asked_again):
    digests = [c.scenario.digest for c in instantiate(read_campaign(small_room)[0]).configurations]
    shutil.rmtree(small_room.parent)
    shutil.rmtree(tmp_path / "maps")
    said = json.loads(called("plan", directory, "--store", tmp_path / "store", "--json").stdout)
    assert (said["file"], said["compared_with"]) == (str(directory), str(directory))
    assert (said["runs"], said["stages"]["execute"]) == (3, {"reused": 0, "computed": 6})
    result = called("run", directory, "--store", tmp_path / "store", "--workers", 2, "--force", "judge")
    assert f"small_room of 2026-11-21 06:05:04 from the inputs in {directory}, 3 runs of each" in result.stderr
    (call,) = asked_again
    assert call["digests"] == digests
    assert (call["runs"], call["results"], call["only"], call["workers"]) == (3, str(directory.parent), (), 2)
    assert call["force"] == "judge"


@each_row(
    ("asked", "words"),
    [
        ({"only": ["room-1"]}, "3 runs of each configuration, only room-1"),
        ({"sample": 7}, "3 runs of each configuration, a sample of 7"),
    ],
)
def test_run_of_directory_keeps_its_selection(small_room, tmp_path, tree, asked_again, asked, words):
    assert words in called("run", written(small_room, tmp_path / "results", tree, **asked)).stderr
    (name, value), *_ = asked.items()
    assert asked_again[-1][name] == (tuple(value) if name == "only" else value)


def test_run_of_directory_refuses_option_that_is_gone(small_room, tmp_path, tree):
    directory = written(small_room, tmp_path / "results", tree, as_v1=True)
    assert "It was run with --as-v1, which is gone. Write placement: as_v1" in refused("run", directory)


@pytest.mark.parametrize(
    ("name", "folder"),
    [("halls/room.yaml", "maps/halls"), ("../halls/room.yaml", "halls"), ("/opt/elsewhere/maps/room.yaml", "maps")],
)
def test_inputs_have_maps_of_other_folders(name, folder, small_room, tmp_path, tree, asked_again):
    maps = tmp_path / "somewhere" / "maps"
    for place in (maps, tmp_path / "somewhere" / folder):
        place.mkdir(parents=True, exist_ok=True)
    for moved in ("room.yaml", "room.pgm"):
        shutil.move(small_room.with_name(moved), tmp_path / "somewhere" / folder / moved)
    small_room.write_text(small_room.read_text().replace("room.yaml", name))
    directory = written(small_room, tmp_path / "results", tree, map_dir=maps)
    digests = [c.scenario.digest for c in instantiate(read_campaign(small_room, maps)[0]).configurations]
    shutil.rmtree(tmp_path / "somewhere")
    called("run", directory)
    assert asked_again[0]["digests"] == digests


def test_inputs_have_floor_plans_and_variations(tmp_path, tree, asked_again):
    folder = tmp_path / "campaign"
    folder.mkdir()
    shutil.copytree(FLOORPLANS, tmp_path / "floorplans")
    (folder / "plans.vast").write_text(PLANS)
    directory = written(folder / "plans.vast", tmp_path / "results", tree)
    shutil.rmtree(tmp_path / "floorplans")
    shutil.rmtree(folder)
    assert "damaged" not in called("run", directory).stderr
    assert len(asked_again[0]["digests"]) == 2


def test_replica_refuses_changed_file_with_absolute_path(small_room, tmp_path, tree):
    outside = tmp_path / "room.yaml"
    shutil.move(small_room.with_name("room.yaml"), outside)
    shutil.move(small_room.with_name("room.pgm"), tmp_path)
    small_room.write_text(small_room.read_text().replace("room.yaml", str(outside)))
    directory = written(small_room, tmp_path / "results", tree)
    asked = asked_of(json.loads((directory / "metadata.json").read_text()))
    with replica(directory, asked) as laid_out:
        folder = laid_out.file.parent
        assert laid_out.file.name == "room.vast" and laid_out.file.is_file()
    assert not folder.exists()
    outside.write_text(outside.read_text().replace("0.05", "0.1"))
    with (
        pytest.raises(UnusableDirectory, match=r"room\.yaml is another file now than in its inputs\. Put back"),
        replica(directory, asked),
    ):
        pass


@pytest.fixture
def half(directory):
    partial = directory.with_name(f".{directory.name}.partial")
    directory.rename(partial)
    (partial / WRITER).write_text(json.dumps({"host": os.uname().nodename, "pid": gone_pid(), "began_s": 1.0}))
    return partial


def gone_pid():
    ended = subprocess.Popen([sys.executable, "-c", ""])
    ended.wait()
    return ended.pid


def test_run_finds_incomplete_directory_by_either_name(half, directory, asked_again):
    for name in (half, directory):
        assert f"{half} was left incomplete by a killed process" in called("run", name).stderr
    assert [call["runs"] for call in asked_again] == [3, 3]
    me = psutil.Process()
    writer = {"host": os.uname().nodename, "pid": me.pid, "began_s": me.create_time()}
    (half / WRITER).write_text(json.dumps(writer))
    assert f"Process {me.pid} is writing it" in refused("run", directory)
    (half / WRITER).unlink()
    (half / "metadata.json").unlink()
    assert "campaign directory is incomplete. Give `vastflow run`" in refused("run", half)


def aged(folder, age_s):
    then = time.time() - age_s
    for path in [*folder.rglob("*"), folder]:
        os.utime(path, (then, then))


def test_sweep_removes_directory_that_was_left_a_day_ago(half, tmp_path):
    aged(half, ABANDONED_S - 60)
    sweep(half.parent)
    assert half.is_dir()
    aged(half, ABANDONED_S + 60)
    with new_directory(half.parent, "c", CREATED):
        assert not half.exists()


def test_sweep_keeps_directory_of_running_writer(tmp_path):
    with new_directory(tmp_path, "c", CREATED) as directory:
        assert_kept(directory.running, directory)
        with directory.writing() as place:
            assert_kept(place, directory)
    assert [path.name for path in directory.final.iterdir()] == []


def assert_kept(place, directory):
    aged(place, 2 * ABANDONED_S)
    assert writer_of(place) == os.getpid()
    sweep(place.parent)
    assert left_behind(directory.final) == place


@each_row(("host", "pid"), [("", os.getpid()), ("other", os.getpid())])
def test_writer_is_process_of_same_start_and_host(tmp_path, host, pid):
    writer = {"host": host or os.uname().nodename, "pid": pid, "began_s": 1.0}
    for text in (json.dumps(writer), "{"):
        (tmp_path / WRITER).write_text(text)
        assert writer_of(tmp_path) is None
