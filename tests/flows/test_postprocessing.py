"""Postprocessing: a campaign file's steps over a copy of its results, and the fault of a step that fails."""

import json
import sys
from datetime import datetime
from pathlib import Path

import numpy as np
import pytest
from whole_directory import ConfigurationResult, write_results

from vastflow.flows.export.run import poses_csv
from vastflow.flows.request.campaign_file import read_campaign
from vastflow.flows.run.postprocess import run_steps
from vastflow.oracles.judgment.verdict import Verdict
from vastflow.producers.campaign_file.postprocessing import steps_of
from vastflow.sim.model.archive import write_outputs
from vastflow.sim.model.blocks import write_recordings
from vastflow.sim.model.recording import Outputs, Recording, Run

PLUG_IN = """\
from pathlib import Path

from robovast.common.campaign_data import read_test_result
from robovast.results_processing.postprocessing_plugins import BasePostprocessingPlugin

from helper import length


class Lengths(BasePostprocessingPlugin):
    def __call__(self, results_dir, config_dir, suffix=".len", **kwargs):
        files = sorted(Path(results_dir).rglob("drive.log"))
        for file in files:
            passed = read_test_result(file.parent)["success"]
            (file.parent / f"length{suffix}").write_text(f"{length(file)} {passed}")
            file.write_text("spoiled")
        assert (Path(config_dir) / "campaign.vast").is_file()
        (Path(config_dir) / "room.yaml").write_text("spoiled")
        return True, f"measured {len(files)} runs"


class Raises:
    def __call__(self, results_dir, config_dir):
        raise RuntimeError("out of ideas")


class Refuses:
    def __call__(self, results_dir, config_dir):
        return False, "nothing to do"


class Leaves:
    def __call__(self, results_dir, config_dir):
        print("about to leave")
        import os
        os._exit(0)


class Forgets:
    def __call__(self, results_dir, config_dir):
        ...
"""
HELPER = "def length(file):\n    return len(file.read_text())\n"
SCRIPT = '#!/bin/sh\necho "$1" > "$2/note.txt"\ncat "$2"/*/*/length.txt > lengths.txt 2>/dev/null\nexit $1\n'


class Campaign:
    """A campaign file with steps, and the directory that it left."""

    def __init__(self, file: Path, root: Path) -> None:
        self.file, self.root = file, root
        self.count = 0

    def after(self, steps):
        """The steps' rows and the results, of a directory in which two configurations with two runs each were judged."""
        self.count += 1
        text = self.file.read_text().partition("results_processing")[0]
        self.file.write_text(text + f"results_processing:\n  postprocessing: {json.dumps(steps)}\n")
        campaign, _ = read_campaign(self.file)
        outputs = {run: Outputs({}, {"drive.log": b"12345" * (run + 1)}) for run in range(2)}
        rows = [Recording(Run(run, "7", "succeeded", 0, "", 7.5, 5.0, 0, 0), {}) for run in range(2)]
        verdicts = [Verdict("success", 0, "pass"), Verdict("success", 1, "fail", "late")]
        found = ConfigurationResult([write_recordings(rows)], verdicts=verdicts, outputs=[write_outputs(outputs)])
        created = datetime(2026, 11, 21, 10, 0, self.count)
        written = write_results(self.file, self.root, found, created=created)
        before = contents(written.directory, "metadata.json")
        steps = steps_of(campaign.spec.results_processing.postprocessing)
        results = run_steps(written, steps, self.file.parent)
        after = contents(written.directory, "metadata.json")
        assert {name: content for name, content in after.items() if not name.startswith("postprocessing/")} == before
        return json.loads((written.directory / "postprocessing/steps.json").read_text())["steps"], results


def contents(folder, *but):
    files = [path for path in folder.rglob("*") if path.is_file() and path.name not in but]
    return {path.relative_to(folder).as_posix(): path.read_bytes() for path in files}


@pytest.fixture
def campaign(small_room, tmp_path):
    (small_room.parent / "measure").mkdir()
    (small_room.parent / "measure" / "plug.py").write_text(PLUG_IN)
    (small_room.parent / "measure" / "helper.py").write_text(HELPER)
    (small_room.parent / "note.sh").write_text(SCRIPT)
    return Campaign(small_room, tmp_path / "results")


def test_plug_in_works_on_a_copy_and_writes_below_one_folder(campaign):
    beside = contents(campaign.file.parent, campaign.file.name)
    note = {"command": {"script": "note.sh", "args": [0]}}
    (step, last), results = campaign.after([{"measure/plug.py:Lengths": {"suffix": ".txt"}}, note])
    assert (step["outcome"], step["message"], results.faults) == ("done", "measured 4 runs", ())
    made = results.directory / "postprocessing"
    assert (made / "room-1/0/length.txt").read_text() == "5 True"
    assert (made / "room-2/1/length.txt").read_text() == "10 False"
    assert (last["outcome"], (made / "note.txt").read_text()) == ("done", "0\n")
    assert (made / "lengths.txt").read_text() == "5 True10 False" * 2  # as the step before left them
    assert contents(campaign.file.parent, campaign.file.name) == beside
    assert "robovast" not in sys.modules


@pytest.mark.parametrize(
    ("step", "message"),
    [
        ("measure/plug.py:Raises", "RuntimeError: out of ideas"),
        ("measure/plug.py:Refuses", "nothing to do"),
        ("measure/plug.py:Leaves", "its process ended with code 0 without an answer: about to leave"),
        ("measure/plug.py:Forgets", "TypeError: expected (done, message), such as (True, 'wrote 3 files'), got None"),
        ({"measure/plug.py:Raises": {"speed": 1}}, "TypeError: Raises.__call__() got an unexpected keyword"),
        ("measure/gone.py:Raises", "there is no file 'measure/gone.py'"),
        ("measure/plug.py:Gone", "no class 'Gone' in measure/plug.py"),
        ("rosbag_to_csv", "Unknown step 'rosbag_to_csv'. Did you mean 'rosbags_to_csv'?"),
        ({"command": {"script": "gone.sh"}}, "there is no script 'gone.sh'"),
        ({"command": {"script": "note.sh", "args": [7]}}, "ended with code 7"),
        ("command", "'script' is missing. Name the file"),
    ],
)
def test_failed_step_is_a_fault_and_others_run(campaign, step, message):
    rows, results = campaign.after([step, {"command": {"script": "note.sh", "args": [0]}}])
    assert [row["outcome"] for row in rows] == ["failed", "done"]
    assert rows[0]["message"].startswith(message)
    (fault,) = results.faults
    assert (fault.configuration, fault.stage) == ("", "postprocessing")
    assert json.loads((results.directory / "metadata.json").read_text())["faults"][0]["error"].endswith(
        rows[0]["message"]
    )
    assert (results.directory / "recordings/room-1.parquet").is_file()


def test_redundant_steps_are_skipped_with_note(campaign):
    rows, results = campaign.after(["rosbags_to_csv", {"rosbags_tf_to_csv": {"frames": ["base_link"]}}, "compress"])
    assert [row["outcome"] for row in rows] == ["recorded", "recorded", "not executed"]
    assert "poses.csv" in rows[1]["message"] and results.faults == ()


def test_poses_are_in_robovast_s_columns_estimated_and_true():
    names = ("t_ms", "x_mm", "y_mm", "yaw_mrad", "estimated_x_mm", "estimated_y_mm", "estimated_yaw_mrad")
    columns = {name: np.array([k, 1000 + k]) for k, name in enumerate(names)}
    header, *rows = poses_csv(columns).decode().splitlines()
    assert header == (
        "frame,timestamp,position.x,position.y,position.z,orientation.roll,orientation.pitch,orientation.yaw"
    )
    assert rows[:2] == [
        "base_link,0.0,0.004,0.005,0.0,0.0,0.0,0.006",
        "turtlebot4_base_link_gt,0.0,0.001,0.002,0.0,0.0,0.0,0.003",
    ]
    assert [row.split(",")[1] for row in rows] == ["0.0", "0.0", "1.0", "1.0"]
