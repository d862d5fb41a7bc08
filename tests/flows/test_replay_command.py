"""`vastflow replay`: equality with the recording, pictures at the times asked for, and everything that can be wrong."""

import json
import os
import shutil
from dataclasses import replace

import numpy as np
import pyarrow.parquet as pq
import pytest
from command_line import called, refused
from PIL import Image
from room import SMALL_ROOM, drawn_room
from whole_directory import ConfigurationResult, write_results

from vastflow.oracles.judgment.verdict import Verdict
from vastflow.oracles.replay.recorded import recorded_run
from vastflow.sim.kernels.streams import run_entropy
from vastflow.sim.model.archive import write_behaviors
from vastflow.sim.model.blocks import read_recordings, write_recordings
from vastflow.sim.model.recording import Recording, Run
from vastflow.sim.nav2.parameter_files.chosen import parameters_of
from vastflow.sim.run import run
from vastflow.tasks.keys.keys import EXECUTE_SOURCE, Keys, numeric_class
from vastflow.tasks.keys.source import installed_tree

RUNS = 2
SEED = 5
RECORDING = "recordings/room-2.parquet"
CAMPAIGN = SMALL_ROOM.replace("0.02]", "0.02, 0.0]").replace("x: 3.0", "x: 4.5") + "  seed: 5\n  timeout: 3\n"


def executed(scenario):
    return [run(scenario, k, SEED) for k in range(RUNS)]


def campaign_directory(folder, text, recordings_of):
    """Write the campaign directory of a campaign in a room of 6 m."""
    drawn_room(folder)
    (folder / "room.vast").write_text(text)

    def found(configuration):
        recordings = recordings_of(configuration.scenario)
        verdicts = [Verdict("success", k, "fail") for k in range(RUNS)]
        behaviors = write_behaviors({each.run.run_index: each.behaviors for each in recordings})
        return ConfigurationResult([write_recordings(recordings)], [], verdicts, behaviors=[behaviors])

    keys = Keys(numeric_class(), installed_tree().digest(*EXECUTE_SOURCE), "o" * 64, "j" * 64, SEED, [])
    return write_results(folder / "room.vast", folder / "results", found, runs=RUNS, keys=keys).directory


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    """Two configurations and a duplicate of one, runs of three seconds; nothing else is left of the campaign."""
    folder = tmp_path_factory.mktemp("campaign")
    directory = campaign_directory(folder, CAMPAIGN, executed)
    (folder / "room.pgm").unlink()
    return directory


@pytest.fixture
def results(made, tmp_path):
    shutil.copytree(made, tmp_path / "results")
    return tmp_path / "results"


def replayed(*arguments):
    return called("replay", *arguments)


def replayed_json(*arguments):
    done = replayed(*arguments, "--json")
    return done, json.loads(done.stdout)


def tampered(results):
    """Add a millimeter to a row of the second run of `room-2`."""
    one, other = read_recordings((results / RECORDING).read_bytes())
    columns = {name: column.copy() for name, column in other.columns.items()}
    columns["x_mm"][12] += 1
    (results / RECORDING).write_bytes(write_recordings([one, Recording(other.run, columns)]))


def test_replay_repeats_run_bit_for_bit_from_campaign_directory_alone(results, tmp_path):
    done = replayed(results, "room-2", 1)
    assert (done.exit_code, done.stderr) == (0, "")
    assert "room-2, run 1: executed again, equal to the recording bit for bit" in done.stdout
    assert (results / "replays/room-2-1/strip.png").read_bytes().startswith(b"\x89PNG")
    folder = tmp_path / "pictures"
    done, said = replayed_json(results, "room-2", 1, "--at", "0.5", "--at", "2.0", "--out", folder)
    assert (done.exit_code, said["equal"], said["difference"], said["film"]) == (0, True, None, None)
    files = [folder / "frames" / f"{t_s}s.png" for t_s in ("0000.50", "0002.00")]
    assert said["frames"] == [{"t_s": t_s, "file": str(file)} for t_s, file in zip((0.5, 2.0), files, strict=True)]
    assert files[0].read_bytes() != files[1].read_bytes()
    assert (said["strip"], said["differs"]) == (str(folder / "strip.png"), [])


def test_replay_reports_row_and_column_of_tampered_recording_and_draws_it(results):
    tampered(results)
    done, said = replayed_json(results, "room-2", 1, "--at", "1.0")
    assert (done.exit_code, said["equal"]) == (1, False)
    assert said["difference"].startswith("row 12 (1.20 s), x_mm: recorded ")
    assert "room-2, run 1: NOT THE RECORDED RUN: row 12 (1.20 s), x_mm" in done.stderr
    assert "recorded by vastflow" in done.stderr
    assert "source and numeric class are those of the recording" in done.stderr
    assert (results / "replays/room-2-1/strip.png").exists()
    assert replayed(results, "room-2", 0, "--at", "1.0").exit_code == 0


def test_replay_draws_at_times_asked_for(results):
    film = ("--film", results / "film.gif", "--every", "0.5", "--from", "1", "--to", "2")
    _, said = replayed_json(results, "room-1", 0, "--at", "1", *film)
    with Image.open(said["film"]) as drawn:
        assert drawn.n_frames == 3 + 7  # the last one stays
    _, said = replayed_json(results, "room-1", 0, "--every", "1")
    assert [frame["t_s"] for frame in said["frames"]] == [0.0, 1.0, 2.0, 2.95]
    done, said = replayed_json(results, "room-1", 0, "--at", "1.238")
    assert said["frames"][0]["t_s"] == 1.25
    assert done.stderr == "--at 1.238: the nearest tick of 50 ms is 1.25 s\n"
    done = replayed(results, "room-3", 0, "--at", "1")
    assert done.exit_code == 0
    assert done.stdout.startswith("room-3 has the content of room-1, whose runs were recorded\n")


def test_replay_film_is_of_the_kind_of_its_file(results, tmp_path):
    for name, begins in (("run.mp4", b"ftyp"), ("below/run.GIF", b"GIF8")):
        done, said = replayed_json(results, "room-1", 0, "--at", "1", "--every", "1", "--film", tmp_path / name)
        assert said["film"] == str(tmp_path / name)
        assert begins in (tmp_path / name).read_bytes()[:12]
        assert done.stderr == "drawing a film of 4 pictures\n"
    assert refused("replay", results, "room-1", 0, "--film", "run.avi").endswith(
        "--film run.avi: expected a file with the suffix .mp4, .gif"
    )


def test_replay_refuses_unknown_run(made, tmp_path, golden):
    def faults_of(arguments):
        return [
            refused("replay", made, *arguments.split(), "--out", tmp_path / "pictures").replace(str(made), "RESULTS")
        ]

    golden("command_line", "replay", faults_of)
    assert not (tmp_path / "pictures").exists()


def another_map(results):
    (picture,) = results.glob("environments/*/map.pgm")
    content = bytearray(picture.read_bytes())
    content[-500] = 0
    picture.write_bytes(content)
    shutil.rmtree(results / "inputs")


def another_scenario(results):
    file = results / "configurations.parquet"
    table = pq.ParquetFile(file).read()
    at = table.column_names.index("scenario")
    edited = [text.replace('"x":4.5', '"x":4.6') for text in table.column("scenario").to_pylist()]
    pq.write_table(table.set_column(at, "scenario", [edited]), file)


def another_seed(results):
    file = results / RECORDING
    one, other = read_recordings(file.read_bytes())
    file.write_bytes(write_recordings([one, Recording(replace(other.run, seed="5:abc:1"), other.columns)]))


NO_VERSIONS = '{"name": "replayed", "created": "", "vastflow": "0", "host": {}}'
DAMAGES = {
    "another map": (another_map, "no file has the digest"),
    "another scenario": (another_scenario, "damaged campaign directory: the scenario of room-2 has digest"),
    "another seed": (another_seed, "damaged campaign directory: the seed 5:abc:1"),
    "cut off": (lambda folder: os.truncate(folder / RECORDING, 1000), "damaged campaign directory"),
    "no versions": (lambda folder: (folder / "metadata.json").write_text(NO_VERSIONS), "metadata.json has no versions"),
    "no recording": (lambda folder: (folder / RECORDING).unlink(), "no run of room-2 was recorded"),
}


@pytest.mark.parametrize(("spoil", "words"), DAMAGES.values(), ids=DAMAGES)
def test_replay_refuses_damaged_directory(results, spoil, words):
    spoil(results)
    assert words in refused("replay", results, "room-2", 1)


def test_recorded_run_finds_map_and_parameter_file_among_inputs(tmp_path):
    def recordings_of(scenario):
        entropy = run_entropy(SEED, scenario.situation_digest, 0)
        row = Run(0, ":".join(f"{part:x}" for part in entropy), "succeeded", 0, "", 1.0, 0.0, 0, 0)
        return [Recording(row, {"t_ms": np.zeros(1, dtype=np.int32)})]

    (tmp_path / "mine.yaml").write_text("amcl:\n  ros__parameters:\n    max_particles: 900\n")
    text = CAMPAIGN.replace("  timeout: 3", "  timeout: 3\n  nav2_params: mine.yaml")
    directory = campaign_directory(tmp_path, text, recordings_of)
    (tmp_path / "mine.yaml").unlink()
    shutil.rmtree(directory / "environments")
    found = recorded_run(directory, "room-2", 0)
    assert parameters_of(found.scenario.system).amcl.max_particles == 900
    files = found.scenario.environment["map_file"].path, found.scenario.system["nav2_params"].path
    assert files == tuple(str(directory / "inputs" / name) for name in ("room.yaml", "mine.yaml"))


def test_replay_names_other_source_and_numeric_class(results):
    source = {"execute": "abcdef012345" + "0" * 52, "observe": "o", "judge": "j"}
    content = json.loads((results / "metadata.json").read_text())
    content |= {"numeric_class": "riscv64", "source": source, "versions": {"numba": "0.1"}}
    (results / "metadata.json").write_text(json.dumps(content))
    said = replayed(results, "room-2", 1, "--at", "1.0")
    assert said.exit_code == 0 and "equal to the recording bit for bit" in said.stdout
    assert "room-2, run 1: recorded with other source of the simulator (abcdef012345, here " in said.stderr
    assert "); numba 0.1, here " in said.stderr
    tampered(results)
    done, said = replayed_json(results, "room-2", 1, "--at", "1.0")
    before, _, after = done.stderr.partition("NOT THE RECORDED RUN: row 12")
    assert done.exit_code == 1
    assert "recorded on another numeric class: 'riscv64" in before
    assert "recorded by vastflow" in after and "those of the recording" not in after
    assert [words.partition(" (")[0].partition(":")[0] for words in said["differs"]] == [
        "recorded with other source of the simulator",
        "recorded on another numeric class",
    ]
