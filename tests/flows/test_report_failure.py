"""`vastflow report-failure` and `repeat-failure`: a failed run travels and gives the same recording, and the rest is refused."""

import os
import shutil
import subprocess
import sys
import zipfile
from dataclasses import replace
from pathlib import Path

import minimize as planted
import platformdirs
import pytest
import yaml
from command_line import called, refused
from room import SMALL_ROOM, drawn_room
from table import each_row
from whole_directory import ConfigurationResult, write_results

from vastflow.flows import run_campaign
from vastflow.flows.failure import failed_run, report
from vastflow.flows.failure.report import BAG, FILM, README
from vastflow.flows.failure.small_map import with_small_map
from vastflow.oracles.figures.film import FilmError
from vastflow.oracles.judgment.verdict import Verdict
from vastflow.oracles.replay.recorded import recorded_run
from vastflow.sim.model.archive import write_behaviors
from vastflow.sim.model.blocks import read_recordings, write_recordings
from vastflow.sim.model.nodes import Nodes
from vastflow.sim.model.recording import Recording
from vastflow.sim.model.scenario import ProcessSetup
from vastflow.sim.run import run
from vastflow.sim.world.map_file import load_map
from vastflow.tasks.keys.keys import EXECUTE_SOURCE, Keys, numeric_class
from vastflow.tasks.keys.source import installed_tree

pytestmark = pytest.mark.timeout(300)

CAMPAIGNS = Path(__file__).parents[2] / "campaigns"
CAMPAIGN = SMALL_ROOM.replace("x: 3.0", "x: 4.5") + "  seed: 5\n  timeout: 3\n"
BOX = """
      - static_objects:
          - {entity_name: box, model: box, spawn_pose: {x: 3.0, y: 2.0}, xacro_arguments: "width:=0.5, length:=0.5"}
"""
JUDGMENTS = ("fail", "pass", "fail", "not judged")


def directory_of(folder, text):
    """Write the campaign directory of a campaign in a room of 6 m, whose runs 0 and 2 failed."""
    drawn_room(folder)
    (folder / "room.vast").write_text(text)

    def found(configuration):
        recordings = [run(configuration.scenario, k, 5) for k in range(len(JUDGMENTS))]
        verdicts = [Verdict("success", k, judgment) for k, judgment in enumerate(JUDGMENTS)]
        behaviors = write_behaviors({each.run.run_index: each.behaviors for each in recordings})
        return ConfigurationResult([write_recordings(recordings)], [], verdicts, behaviors=[behaviors])

    keys = Keys(numeric_class(), installed_tree().digest(*EXECUTE_SOURCE), "o" * 64, "j" * 64, 5, [])
    results = folder / "results"
    return write_results(folder / "room.vast", results, found, runs=len(JUDGMENTS), keys=keys).directory


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    assert SMALL_ROOM.count("map_file: room.yaml\n") == 1
    text = CAMPAIGN.replace("map_file: room.yaml\n", f"map_file: room.yaml{BOX}")
    return directory_of(tmp_path_factory.mktemp("campaign"), text)


def reported(results, run_name, out):
    done = called("report-failure", results, run_name, out, "--no-minimize")
    assert done.exit_code == 0, done.output
    return done


def test_report_repeats_to_same_recording_elsewhere(made, tmp_path):
    said = reported(made, "room-1/2", tmp_path / "failure.zip").output
    assert "room-1, run 2: repeated from the report, equal to the recording byte for byte" in said
    assert (tmp_path / "failure.zip").stat().st_size <= 1_000_000
    with zipfile.ZipFile(tmp_path / "failure.zip") as archive:
        archive.extractall(tmp_path / "elsewhere")
    folder = tmp_path / "elsewhere"
    told = (folder / README).read_text()
    assert (
        "# room-1, run 2 of" in told
        and "2 of 3 runs (67 %, 95 % interval 9 to 99 %)" in told
        and "vastflow repeat-failure ." in told
    )
    assert "by `repeat-failure` with `--trust` alone" in told
    assert str(made.parent) not in "".join(file.read_text() for file in folder.rglob("*.vast"))
    assert (folder / FILM).stat().st_size and (folder / BAG / f"{BAG}.mcap").stat().st_size
    repeated = called("repeat-failure", folder)
    assert (repeated.exit_code, repeated.stdout.partition(":")[0]) == (0, "equal"), repeated.output


def test_report_has_same_bytes_twice(made, tmp_path):
    for name in ("one.zip", "two.zip"):
        reported(made, "room-1/0", tmp_path / name)
    assert (tmp_path / "one.zip").read_bytes() == (tmp_path / "two.zip").read_bytes()


def test_repeat_distinguishes_other_recording_from_damage(made, tmp_path):
    reported(made, "room-1/0", tmp_path / "failure")
    file = tmp_path / "failure" / "campaign.vast"
    file.write_text(file.read_text().replace("seed: 5", "seed: 6"))
    other = called("repeat-failure", tmp_path / "failure")
    assert other.exit_code == 1 and other.stdout.startswith("NOT THE RECORDED RUN: ")
    (tmp_path / "failure" / "recording.parquet").write_bytes(b"PAR1")
    assert "expected the folder of a reported failure" in refused("repeat-failure", tmp_path / "failure")


def test_repeat_executes_no_code_without_trust(made, tmp_path):
    reported(made, "room-1/0", tmp_path / "failure")
    (tmp_path / "failure" / "own.py").write_text("raise SystemExit('executed')\n")
    file = tmp_path / "failure" / "campaign.vast"
    data = yaml.safe_load(file.read_text())
    file.write_text(yaml.safe_dump({**data, "evaluation": {"oracles": ["own.py:Own"]}}))
    assert "code of others that you have not permitted. Permit it by --trust" in refused(
        "repeat-failure", tmp_path / "failure"
    )


@each_row(
    ("asked", "said"),
    [
        ("nowhere/0", "nknown configuration 'nowhere'"),
        ("room-1/7", "no run 7 of room-1. It has 0, 1, 2, 3"),
        ("room-1", "expected CONFIGURATION/RUN, such as room-1/0, got 'room-1'"),
        ("room-1/1", "expected a run that failed, got one that passed. Runs 0, 2 of it failed."),
        ("room-1/3", "expected a run that failed, got one that was not judged. Runs 0, 2 of it failed."),
    ],
)
def test_report_refuses_runs_without_failure(made, tmp_path, asked, said):
    assert said in refused("report-failure", made, asked, tmp_path / "out")
    assert not (tmp_path / "out").exists()


def test_report_leaves_largest_parts_out_first(made, tmp_path, monkeypatch):
    assert report.MOST_BYTES == 1_000_000
    whole = reported(made, "room-1/0", tmp_path / "whole").output
    assert "left out" not in whole

    def size_of(said):
        return int(said.rpartition(", ")[2].split(" ")[0].replace(",", ""))

    size = size_of(whole)
    monkeypatch.setattr(report, "MOST_BYTES", size - 1)
    said = reported(made, "room-1/0", tmp_path / "less").output
    assert "left out: the costmaps of the bag" in said and (tmp_path / "less" / FILM).exists()
    assert "the costmaps of the bag" in (tmp_path / "less" / README).read_text()
    monkeypatch.setattr(report, "bag_of", lambda *_: {"rosbag2.mcap": os.urandom(size)})
    said = reported(made, "room-1/0", tmp_path / "filmed").output
    assert "left out: the bag\n" in said and "the film" not in said and (tmp_path / "filmed" / FILM).exists()
    monkeypatch.setattr(report, "MOST_BYTES", size_of(said) - 1)
    said = reported(made, "room-1/0", tmp_path / "least").output
    assert "left out: the bag\nleft out: the film" in said


def test_report_without_encoder_does_not_blame_size(made, tmp_path, monkeypatch):
    def fail(*_):
        raise FilmError("no ffmpeg")

    monkeypatch.setattr(report, "write_film", fail)
    assert "left out" not in reported(made, "room-1/0", tmp_path / "failure").output
    told = (tmp_path / "failure" / README).read_text()
    assert "film" not in told and "1 MB" not in told


def test_report_names_nav2_file_that_no_key_can_express(tmp_path):
    (tmp_path / "forklift.yaml").write_bytes((CAMPAIGNS / "robots" / "forklift.yaml").read_bytes())
    text = CAMPAIGN.replace("y: 1.0", "y: 3.0").replace("x: 1.0", "x: 2.0")
    results = directory_of(tmp_path, text + "  nav2_params: forklift.yaml\n")
    reported(results, "room-1/0", tmp_path / "failure")
    told = (tmp_path / "failure" / README).read_text()
    assert "- `forklift.yaml`: the Nav2 parameter file, which `campaign.vast` names" in told
    assert not (tmp_path / "failure" / "nav2_parameters.yaml").exists()
    assert called("repeat-failure", tmp_path / "failure").stdout.startswith("equal: ")


def test_report_has_controller_that_the_nav2_file_chooses(tmp_path):
    (tmp_path / "rpp.yaml").write_bytes((CAMPAIGNS / "nav2" / "rpp.yaml").read_bytes())
    results = directory_of(tmp_path, CAMPAIGN + "  nav2_params: rpp.yaml\n")
    reported(results, "room-1/0", tmp_path / "failure")
    parameters = yaml.safe_load((tmp_path / "failure" / "nav2_parameters.yaml").read_text())
    assert parameters == {"controller": "rpp", "laserscan_gaussian_noise_std_deviation": 0.0}


def test_cut_map_has_same_cells_where_it_is(tmp_path):
    drawn_room(tmp_path)
    files = {f"map/{each}": (tmp_path / each).read_bytes() for each in ("room.yaml", "room.pgm")}
    whole = load_map(tmp_path / "room.yaml")
    for name, bounds in (("whole", None), ("cut", (0.52, 0.0, 3.0, 2.0))):
        for place, content in with_small_map(files, bounds).items():
            (tmp_path / name / place).parent.mkdir(parents=True, exist_ok=True)
            (tmp_path / name / place).write_bytes(content)
    assert load_map(tmp_path / "whole" / "map" / "room.yaml").digest == whole.digest
    cut = load_map(tmp_path / "cut" / "map" / "room.yaml")
    assert cut.cells.size < whole.cells.size
    row, column = whole.cell_of(*cut.center_of(0, 0))
    rows, columns = cut.shape
    assert (whole.cells[row : row + rows, column : column + columns] == cut.cells).all()


def test_report_refuses_run_that_nodes_drove(made, tmp_path, monkeypatch):
    def driven(*run):
        found = recorded_run(*run)
        return replace(found, scenario=replace(found.scenario, programs=ProcessSetup(nodes=Nodes())))

    monkeypatch.setattr(failed_run, "recorded_run", driven)
    said = refused("report-failure", made, "room-1/0", tmp_path / "out")
    assert "room-1/0: expected a run of the built-in stack, got one that nodes drove, which need not repeat." in said


def test_report_refuses_run_without_robot(made, tmp_path):
    shutil.copytree(made, tmp_path / "results")
    file = tmp_path / "results" / "recordings" / "room-1.parquet"
    file.write_bytes(write_recordings([Recording(each.run, {}) for each in read_recordings(file)]))
    said = refused("report-failure", tmp_path / "results", "room-1/0", tmp_path / "out")
    assert "room-1/0: expected a run of a robot, got one of programs alone" in said


def test_report_of_strangers_code_needs_consent(made, tmp_path):
    shutil.copytree(made, tmp_path / "results")
    (tmp_path / "results" / "inputs" / "own.py").write_text("raise SystemExit('executed')\n")
    said = refused("report-failure", tmp_path / "results", "room-1/0", tmp_path / "out")
    assert "would execute code that you neither made nor permitted: inputs/own.py" in said


@pytest.mark.slow
@pytest.mark.timeout(900)
def test_minimized_report_repeats_in_new_process_of_another_home(tmp_path):
    """A failure with boxes in a long room, of which the robot sees a part."""
    boxes = [planted.box("door", 3.0, 2.5, 1.0), planted.box("a", 1.5, 0.6)]
    values = {"start_pose": planted.START, "goal_pose": planted.GOAL, "static_objects": boxes, planted.NOISE: 0.02}
    file = planted.written(tmp_path, [planted.Plant("blocked", values, frozenset(["obstacle door"]))])
    cells = planted.two_rooms(400)
    cells[39:61, 59:61] = 254  # a door of 1.1 m
    cells[:, 160:162] = 0  # a wall, behind which nobody sees
    planted.map_of(cells, tmp_path / "rooms.yaml")
    file.write_text(file.read_text().replace(f"timeout: {planted.TIMEOUT_S}", "timeout: 20"))
    store = tmp_path / "store"
    directory = run_campaign(file, results=tmp_path / "results", store=store).directory
    done = called("report-failure", directory, "blocked/1", tmp_path / "failure.zip", "--store", store)
    assert done.exit_code == 0, done.output
    folder, home = tmp_path / "elsewhere", tmp_path / "home"
    with zipfile.ZipFile(tmp_path / "failure.zip") as archive:
        archive.extractall(folder)
    told = (folder / README).read_text()
    assert "Its failure needs" in told and "Its map is cut to what the robot saw" in told
    maps = [load_map(folder / place / "map" / "map.yaml") for place in ("", "minimized")]
    assert maps[0].cells.size > maps[1].cells.size
    cache = platformdirs.user_cache_dir()
    environment = {**os.environ, "HOME": str(home), "XDG_CACHE_HOME": cache}  # of compiled kernels
    command = Path(sys.executable).with_name("vastflow")
    for arguments in (["repeat-failure", "."], ["run", "campaign.vast", "--store", "store"]):
        said = subprocess.run(
            [command, *arguments], cwd=folder, env=environment, text=True, capture_output=True, check=False
        )
        assert said.returncode in (0, 1) and "Traceback" not in said.stderr, said.stderr
        if arguments[0] == "repeat-failure":
            assert (said.returncode, said.stdout.partition(":")[0]) == (0, "equal")
    (again,) = folder.glob("results/*/recordings/*.parquet")
    (recorded,) = read_recordings(folder / "recording.parquet")
    assert read_recordings(again)[1].columns.keys() == recorded.columns.keys()
    assert write_recordings(read_recordings(again)[1:]) == (folder / "recording.parquet").read_bytes()
