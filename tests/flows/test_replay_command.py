"""`vastflow replay`: equality with the recording, pictures at the times asked for, and everything that can be wrong."""

import json
import os
import re
import shutil
import signal
from dataclasses import replace
from datetime import datetime
from pathlib import Path

import numpy as np
import pyarrow.parquet as pq
import pytest
from PIL import Image
from table import each_row
from typer.main import get_command
from typer.testing import CliRunner
from whole_directory import write_results

from vastflow.flows.__main__ import app
from vastflow.flows.cli import replay as replay_command
from vastflow.flows.request.campaign_file import read_campaign
from vastflow.flows.results.found import ConfigurationResult
from vastflow.flows.results.inputs import inputs_of
from vastflow.flows.results.provenance import origin_differences, versions
from vastflow.flows.results.summary import Work
from vastflow.oracles.judgement.verdict import Verdict
from vastflow.oracles.replay.recorded import recorded_run
from vastflow.oracles.results.unusable import UnusableDirectory
from vastflow.producers.instantiation.instantiate import instantiate
from vastflow.sim.kernels.streams import run_entropy
from vastflow.sim.model.archive import write_behaviors
from vastflow.sim.model.blocks import read_recordings, write_recordings
from vastflow.sim.model.digest import FileContent
from vastflow.sim.model.recording import Recording, Run
from vastflow.sim.nav2.parameter_files.chosen import parameters_of
from vastflow.sim.run import run
from vastflow.tasks.keys.keys import EXECUTE_SOURCE, Keys, numeric_class
from vastflow.tasks.keys.source import installed_tree

RUNS = 2
SEED = 5
CAMPAIGN = """\
version: 1
metadata:
  name: replayed
configuration:
  - name: room
    parameters:
      - map_file: room.yaml
      - start_pose: {x: 1.0, y: 1.0, yaw: 0.0}
      - goal_pose: {x: 4.5, y: 1.0, yaw: 0.0}
    variations:
      - ParameterVariationList:
          name: laserscan_gaussian_noise_std_deviation
          values: [0.0, 0.02, 0.0]
execution:
  runs: 2
  seed: 5
  timeout: 3
"""


def executed(scenario):
    return [run(scenario, k, SEED) for k in range(RUNS)]


def campaign_directory(folder, text, recordings_of):
    """What `vastflow run` would write for a campaign in a room of 6 m."""
    cells = np.full((120, 120), 254, dtype=np.uint8)
    cells[[0, -1], :] = cells[:, [0, -1]] = 0
    Image.fromarray(cells).save(folder / "room.pgm")
    (folder / "room.yaml").write_text("{image: room.pgm, resolution: 0.05, origin: [0.0, 0.0, 0.0]}\n")
    (folder / "room.vast").write_text(text)
    campaign, oracles = read_campaign(folder / "room.vast")

    def found(configuration):
        recordings = recordings_of(configuration.scenario)
        verdicts = [Verdict("success", k, "fail") for k in range(RUNS)]
        behaviors = write_behaviors({each.run.run_index: each.behaviors for each in recordings})
        return ConfigurationResult([write_recordings(recordings)], [], verdicts, behaviors=[behaviors])

    results = write_results(
        folder / "results",
        campaign,
        inputs_of(campaign, oracles),
        instantiate(campaign),
        found,
        runs=RUNS,
        oracles=["success"],
        keys=Keys(numeric_class(), installed_tree().digest(*EXECUTE_SOURCE), "o" * 64, "j" * 64, SEED, []),
        created=datetime(2026, 11, 21),
        work=lambda: Work(4, 0, 12.0, 1.0, 1.0),
        report=lambda directory: None,
    )
    return results.directory


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    """Two configurations and a duplicate of one, runs of three seconds; nothing else is left of the campaign."""
    folder = tmp_path_factory.mktemp("campaign")
    directory = campaign_directory(folder, CAMPAIGN, executed)
    (folder / "room.pgm").unlink()
    return directory


@pytest.fixture
def results(made, tmp_path):
    """A copy of it to spoil."""
    shutil.copytree(made, tmp_path / "results")
    return tmp_path / "results"


def called(*arguments):
    return CliRunner().invoke(app, ["replay", *(str(argument) for argument in arguments)])


def tampered(results, change):
    """Let `change` edit a run's columns in the recording of `room-2`."""
    file = results / "recordings" / "room-2.parquet"
    recordings = read_recordings(file.read_bytes())
    columns = {name: column.copy() for name, column in recordings[1].columns.items()}
    change(columns)
    recordings[1] = Recording(recordings[1].run, columns)
    file.write_bytes(write_recordings(recordings))


def metadata_of(directory):
    return json.loads((directory / "metadata.json").read_text())


def simulator_of(directory):
    return metadata_of(directory)["source"]["execute"]


def rewritten(results, **content):
    """Let `metadata.json` say something else."""
    (results / "metadata.json").write_text(json.dumps({**metadata_of(results), **content}))


def add_a_millimeter(columns):
    columns["x_mm"][12] += 1


def test_run_is_repeated_bit_for_bit_from_the_campaign_directory_alone(results):
    done = called(results, "room-2", 1)
    assert done.exit_code == 0, done.stderr
    assert "room-2, run 1: executed again, equal to the recording bit for bit" in done.stdout
    assert (results / "replays/room-2-1/strip.png").read_bytes().startswith(b"\x89PNG")


def test_with_json_standard_output_says_what_was_found_and_where_the_pictures_are(results, tmp_path):
    done = called(results, "room-2", 1, "--at", "0.5", "--at", "2.0", "--out", tmp_path / "pictures", "--json")
    said = json.loads(done.stdout)
    assert (done.exit_code, said["equal"], said["difference"], said["video"]) == (0, True, None, None)
    assert [frame["t_s"] for frame in said["frames"]] == [0.5, 2.0]
    pictures = [(tmp_path / "pictures/frames" / f"000{t}s.png").read_bytes() for t in ("0.50", "2.00")]
    assert [frame["file"] for frame in said["frames"]] == [
        str(tmp_path / "pictures/frames/0000.50s.png"),
        str(tmp_path / "pictures/frames/0002.00s.png"),
    ]
    assert pictures[0] != pictures[1]
    assert said["strip"] == str(tmp_path / "pictures/strip.png")


def test_tampered_recording_is_reported_with_its_row_and_column_and_pictures_are_made(results):
    tampered(results, add_a_millimeter)
    done = called(results, "room-2", 1, "--at", "1.0", "--json")
    said = json.loads(done.stdout)
    assert (done.exit_code, said["equal"]) == (1, False)
    assert said["difference"].startswith("row 12 (1.20 s), x_mm: recorded ")
    assert "room-2, run 1: NOT THE RECORDED RUN: row 12 (1.20 s), x_mm" in done.stderr
    assert "recorded by vastflow" in done.stderr
    assert "source and numeric class are those of the recording" in done.stderr
    assert (results / "replays/room-2-1/strip.png").exists()


def test_other_runs_of_a_tampered_file_are_still_what_was_recorded(results):
    tampered(results, add_a_millimeter)
    assert called(results, "room-2", 0, "--at", "1.0").exit_code == 0


def test_film_has_a_picture_for_each_step(results):
    done = called(results, "room-1", 0, "--at", "1", "--video", "--every", "0.5", "--from", "1", "--to", "2", "--json")
    with Image.open(json.loads(done.stdout)["video"]) as film:
        assert film.n_frames == 3


def test_pictures_at_regular_times_make_a_strip(results):
    done = called(results, "room-1", 0, "--every", "1", "--json")
    assert [frame["t_s"] for frame in json.loads(done.stdout)["frames"]] == [0.0, 1.0, 2.0, 2.95]


def test_time_between_two_ticks_is_rounded_and_said(results):
    done = called(results, "room-1", 0, "--at", "1.238", "--json")
    assert json.loads(done.stdout)["frames"][0]["t_s"] == 1.25
    assert done.stderr == "--at 1.238: the nearest tick of 50 ms is 1.25 s\n"


def test_duplicate_shows_the_runs_of_its_original(results):
    done = called(results, "room-3", 0, "--at", "1")
    assert done.exit_code == 0
    assert done.stdout.startswith("room-3 has the content of room-1, whose runs were recorded\n")


@each_row(
    ("arguments", "words"),
    [
        (["room-2", "1", "--at", "3.5"], "--at 3.5: outside the run, which goes from 0 to 3.00 s"),
        (["room-2", "1", "--at", "-1"], "--at -1: outside the run"),
        (["room-2", "1", "--from", "2", "--to", "1"], "--from 2 --to 1: ends before it begins"),
        (["room-2", "1", "--every", "0"], "--every 0: a time greater than 0 s"),
        (["room-2", "1", "--every", "0.04"], "60 pictures"),
        (["rom-2", "1"], "no configuration 'rom-2'; did you mean 'room-2'?"),
        (["hall", "1"], "no configuration 'hall'; it has room-1, room-2, room-3"),
        (["room-2", "7"], "no run 7 of room-2; it has 0, 1"),
    ],
)
def test_what_the_campaign_does_not_have_is_said_in_one_line(made, tmp_path, arguments, words):
    done = called(made, *arguments, "--out", tmp_path / "pictures")
    assert (done.exit_code, done.stdout) == (2, "")
    (line,) = done.stderr.splitlines()
    assert words in line
    assert not (tmp_path / "pictures").exists()


@each_row("arguments", [["room-2", "-1"], ["room-2", "one"], ["room-2"], ["room-2", "1", "--at", "soon"]])
def test_bad_arguments_exit_with_2(made, arguments):
    done = called(made, *arguments)
    assert done.exit_code == 2 and "Traceback" not in done.stderr


def test_folder_that_is_no_campaign_directory_is_refused(tmp_path):
    done = called(tmp_path, "room-1", 0)
    assert done.exit_code == 2 and "has no metadata.json" in done.stderr


def no_map(results):
    shutil.rmtree(results / "environments")
    shutil.rmtree(results / "inputs")


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
    file = results / "recordings" / "room-2.parquet"
    one, other = read_recordings(file.read_bytes())
    spoilt = Recording(replace(other.run, seed="5:abc:1"), other.columns)
    file.write_bytes(write_recordings([one, spoilt]))


def cut_off(results):
    file = results / "recordings" / "room-2.parquet"
    file.write_bytes(file.read_bytes()[:-100])


def no_tables(results):
    (results / "configurations.parquet").unlink()


def no_metadata_text(results):
    (results / "metadata.json").write_text("{")


def no_versions(results):
    (results / "metadata.json").write_text('{"name": "replayed", "created": "", "vastflow": "0", "host": {}}')


@pytest.mark.parametrize(
    ("spoil", "words"),
    [
        (no_map, "no file has the digest"),
        (another_map, "no file has the digest"),
        (another_scenario, "damaged campaign directory: the scenario of room-2 has digest"),
        (another_seed, "damaged campaign directory: the seed 5:abc:1"),
        (cut_off, "damaged campaign directory"),
        (no_tables, "damaged campaign directory"),
        (no_metadata_text, "damaged campaign directory"),
        (no_versions, "damaged campaign directory: metadata.json has no versions"),
    ],
    ids=lambda value: getattr(value, "__name__", ""),
)
def test_damaged_directory_is_refused_in_one_line(results, spoil, words):
    spoil(results)
    done = called(results, "room-2", 1)
    assert (done.exit_code, done.stdout) == (2, "")
    (line,) = done.stderr.splitlines()
    assert words in line and "Traceback" not in done.stderr


def test_configuration_without_a_recording_is_named(results):
    (results / "recordings" / "room-2.parquet").unlink()
    with pytest.raises(UnusableDirectory, match="no run of room-2 was recorded"):
        recorded_run(results, "room-2", 0)


def test_map_that_lies_only_among_the_inputs_is_found_there(results):
    shutil.rmtree(results / "environments")
    found = recorded_run(results, "room-2", 0).scenario.environment["map_file"]
    assert isinstance(found, FileContent) and found.path.startswith(str(results / "inputs"))


def test_parameter_file_of_a_campaign_is_found_among_its_inputs(tmp_path):
    def recordings_of(scenario):
        entropy = run_entropy(SEED, scenario.situation_digest, 0)
        row = Run(0, ":".join(f"{part:x}" for part in entropy), "succeeded", 0, "", 1.0, 0.0, 0, 0)
        return [Recording(row, {"t_ms": np.zeros(1, dtype=np.int32)})]

    (tmp_path / "mine.yaml").write_text("amcl:\n  ros__parameters:\n    max_particles: 900\n")
    text = CAMPAIGN.replace("  timeout: 3", "  timeout: 3\n  nav2_params: mine.yaml")
    directory = campaign_directory(tmp_path, text, recordings_of)
    (tmp_path / "mine.yaml").unlink()
    found = recorded_run(directory, "room-2", 0)
    assert parameters_of(found.scenario.system).amcl.max_particles == 900
    assert found.scenario.system["nav2_params"].path == str(directory / "inputs" / "mine.yaml")


def test_folder_that_cannot_be_written_is_said(made, tmp_path):
    (tmp_path / "taken").write_text("")
    done = called(made, "room-2", 0, "--out", tmp_path / "taken")
    assert done.exit_code == 2 and "--out" in done.stderr


def test_interrupt_exits_with_130(made, tmp_path, monkeypatch):
    def interrupted(recorded, asked):
        os.kill(os.getpid(), signal.SIGINT)
        raise AssertionError("the interrupt should have come before this")

    monkeypatch.setattr(replay_command, "_executed", interrupted)
    done = called(made, "room-2", 0, "--out", tmp_path)
    assert (done.exit_code, done.stderr) == (130, "interrupted\n")


def test_versions_say_who_recorded_and_what_differs(made):
    metadata = metadata_of(made)
    older = {**metadata, "vastflow": "0.0.1", "versions": {**metadata["versions"], "numba": "0.1"}}
    assert versions(older, same_origin=False).startswith("recorded by vastflow 0.0.1, executed by vastflow ")
    assert "numba 0.1, here " in versions(older, same_origin=False)


def test_without_a_named_origin_code_and_processor_are_what_is_left(made):
    metadata = {key: value for key, value in metadata_of(made).items() if key not in ("source", "numeric_class")}
    assert origin_differences(metadata, "any", "s" * 64) == []
    assert "the simulator's code or the processor is another" in versions(metadata, same_origin=True)


def test_where_nothing_differs_nothing_is_said_before_the_replay(results):
    done = called(results, "room-2", 1, "--at", "1.0", "--json")
    assert (done.stderr, json.loads(done.stdout)["differs"]) == ("", [])


def test_result_of_other_code_is_said_so_before_it_is_replayed_and_may_be_equal_all_the_same(results):
    rewritten(results, source={"execute": "abcdef012345" + "0" * 52, "observe": "o", "judge": "j"})
    done = called(results, "room-2", 1, "--at", "1.0")
    assert done.exit_code == 0
    assert "room-2, run 1: recorded with other source of the simulator (abcdef012345, here " in done.stderr
    assert "equal to the recording bit for bit" in done.stdout


def test_result_of_another_numeric_class_says_what_of_it_differs(results):
    rewritten(results, numeric_class="riscv64; glibc 2.36; ; ")
    tampered(results, add_a_millimeter)
    done = called(results, "room-2", 1, "--at", "1.0", "--json")
    before, _, after = done.stderr.partition("NOT THE RECORDED RUN: row 12")
    assert done.exit_code == 1
    assert "recorded on another numeric class: architecture from 'riscv64' to " in before
    assert "recorded by vastflow" in after and "those of the recording" not in after
    (differs,) = json.loads(done.stdout)["differs"]
    assert differs.startswith("recorded on another numeric class")


def test_other_source_names_the_libraries_that_are_other_too(made):
    metadata = {**metadata_of(made), "versions": {"numba": "0.1"}}
    (words,) = origin_differences(metadata, metadata["numeric_class"], "s" * 64)
    assert "(" in words and "here ssssssssssss); numba 0.1, here " in words


def test_numeric_class_of_another_form_is_shown_whole(made):
    (words,) = origin_differences(
        {**metadata_of(made), "numeric_class": "arm"}, "x86_64; glibc; fma; ; 3.12", simulator_of(made)
    )
    assert words == "recorded on another numeric class: 'arm', here 'x86_64; glibc; fma; ; 3.12'"


def test_page_about_replays_describes_every_option():
    page = (Path(__file__).parents[2] / "docs" / "replay-a-run.md").read_text()
    described = set(
        re.findall(r"--[a-z]+", "".join(line.split("|")[1] for line in page.splitlines() if "| `--" in line))
    )
    options = {name for option in get_command(app).commands["replay"].params for name in option.opts if "--" in name}
    assert described == options - {"--help"}
