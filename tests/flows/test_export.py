"""The export of a campaign directory: a folder for each run, and what each verdict becomes in it."""

import csv
import io
import json
import re
import sqlite3
from contextlib import closing
from pathlib import Path
from typing import get_type_hints
from xml.etree import ElementTree

import numpy as np
import pyarrow.parquet as pq
import pytest
import yaml
from command_line import called, refused
from hypothesis import example, given
from hypothesis import strategies as st
from table import each_row
from whole_directory import ConfigurationResult, write_results

from vastflow.flows.cli import export as export_command
from vastflow.flows.export.catalog import Vast
from vastflow.flows.export.export import export
from vastflow.flows.export.format import ExportedCampaign
from vastflow.flows.export.junit import Case, Flaw, Suite, campaign_report
from vastflow.flows.export.run import ExportedRun, case_of, files_of
from vastflow.oracles.judgment.verdict import Metric, Verdict
from vastflow.oracles.results.unusable import UnusableDirectory
from vastflow.sim.model.archive import table, write_behaviors, write_outputs
from vastflow.sim.model.blocks import write_recordings
from vastflow.sim.model.faults import UserError
from vastflow.sim.model.recording import LogText, Outputs, Recording, Run, RunLog, Use, run_log_row
from vastflow.sim.scenario.tree.tree import StatusChange
from vastflow.sim.world.map_file import load_map
from vastflow.tasks.engine.engine import RunFault

OUTPUTS = Outputs(
    {"positions": {"t": np.array([0.5, np.nan]), "n": np.array([1, 2]), "who": np.array(["a", 'b "c"'])}},
    {"notes/read.me": b"\x00\xff", "scan.pcd": b"1"},
)
PROGRAM = RunLog(
    1_700_000_000.5,
    2.25,
    1.5,
    4096,
    ("0.1 s: begun",),
    (LogText("", ("/usr/bin/python3", "go.py"), "hello\n", False), LogText("the map/server", ("m",), "x", True)),
    (Use(0.0, 0.0, 1024, 1), Use(1.0001, 0.75, 2048, 3)),
    ("big.bin (99 bytes) is not kept: larger than 16 MiB",),
)
SIMULATED = RunLog(1_700_000_001.0, 0.125, 0.1, 8192)


def behaviors(status="SUCCESS", message=""):
    rows = [
        (0.0, 0, -1, 0, "patrol", "Sequence", "INVALID", "", 3, 10),
        (0.0, 1, 0, 0, "nav_to_pose", "Navigate", "INVALID", "", 5, 9),
        (7.5, 0, -1, 0, "patrol", "Sequence", status, "", 3, 10),
        (7.5, 1, 0, 0, "nav_to_pose", "Navigate", status, message, 5, 9),
    ]
    return table(get_type_hints(StatusChange), rows)


def recording(run_index):
    columns = {
        "t_ms": np.array([0, 100, 300]),
        "x_mm": np.array([1, -2500, 7]),
        "covariance_xx_mm2": np.array([0, 5, 1]),
    }
    row = Run(run_index, "7", "succeeded", 0, "", 7.5, 5.0, 0, 0)
    return Recording(row, {name: column.astype(np.int32) for name, column in columns.items()})


def log_block(logs):
    rows = [{"run_index": run_index, **run_log_row(log)} for run_index, log in logs.items()]
    host = {"name": "bench", "machine": "x86_64", "python": "3.11"}
    return json.dumps({"runs": rows, "host": host, "versions": {"numpy": "2"}, "pid": 7}).encode()


def whole():
    """Two runs: one of programs that passed, one of the robot that failed by two of three oracles."""
    verdicts = [
        Verdict(
            "success", 0, "pass", "", {"time": Metric(7.5, "s"), "goals": Metric(2, "1"), "gap": Metric(None, "m")}
        ),
        Verdict("safety", 0, "pass"),
        Verdict("performance", 0, "pass"),
        Verdict("success", 1, "fail", "mission aborted"),
        Verdict("safety", 1, "fail", "0.1 m from a box"),
        Verdict("performance", 1, "not judged", "no path"),
    ]
    ran = {0: behaviors(), 1: behaviors("FAILURE", "no valid trajectory")}
    return ConfigurationResult(
        recordings=[write_recordings([recording(0), recording(1)])],
        verdicts=verdicts,
        behaviors=[write_behaviors(ran)],
        outputs=[write_outputs({0: OUTPUTS})],
        logs=[log_block({0: PROGRAM, 1: SIMULATED})],
    )


def campaign_directory(file, root, found, oracles=("success", "safety", "performance")):
    return write_results(file, root, found, oracles=oracles).directory


@pytest.fixture
def results(small_room, tmp_path):
    return campaign_directory(small_room, tmp_path / "results", whole())


def test_exported_files_are_as_in_golden_file(results, small_room, tmp_path, monkeypatch, request):
    monkeypatch.setattr(export_command, "PERIOD_S", 0.0)
    exported = tmp_path / "out"
    done = called("export", results, exported, "--only", "room*", "--only", "room-1")
    assert (done.exit_code, done.stderr.splitlines()[-1]) == (0, "1 of 2 configurations exported")
    assert done.stdout == f"2 configurations; 4 runs: 2 passed, 2 failed\nexported: {exported}\n"
    files = sorted(path for path in exported.rglob("*") if path.is_file())
    text = "".join(
        f"=== {path.relative_to(exported).as_posix()}\n"
        + (
            ""
            if path.relative_to(exported).parts[0] == "_config" or path.suffix == ".db"
            else path.read_bytes().replace(b"\0", b"\\0").decode(errors="backslashreplace")
        )
        for path in files
    )
    golden = Path(__file__).with_name("exported.txt")
    if request.config.getoption("update_golden"):
        golden.write_text(text, encoding="utf-8")
    assert text == golden.read_text(encoding="utf-8")
    given = yaml.safe_load((exported / "room-2/scenario.config").read_text())["navigate_to_pose"]
    assert (
        load_map(exported / "room-2" / given["map_file"]).digest == load_map(small_room.with_name("room.yaml")).digest
    )
    own = yaml.safe_load((exported / "room-2/_config/scenario.config").read_text())["navigate_to_pose"]
    assert (exported / "_config" / own["map_file"]).samefile(exported / "room-2" / given["map_file"])
    for name, source in (("campaign.vast", small_room), ("room.yaml", small_room.with_name("room.yaml"))):
        assert (exported / "_config" / name).read_bytes() == source.read_bytes()


def test_recording_csv_has_recorded_decimals():
    recorded = np.arange(-70_000, 70_000, 7, dtype=np.int32)
    run = ExportedRun("c", "room-1", 0, [], None, None, recorded={"x_mm": recorded})
    _, *rows = csv.reader(io.StringIO(dict(files_of(run, case_of(run)))["recording.csv"].decode()))
    assert [round(float(x_m) * 1000) for (x_m,) in rows] == recorded.tolist()
    assert max(len(x_m) for (x_m,) in rows) <= len("-70.000")


def test_poses_csv_tells_the_estimate_from_the_truth():
    names = ("t_ms", "x_mm", "y_mm", "yaw_mrad", "estimated_x_mm", "estimated_y_mm", "estimated_yaw_mrad")
    recorded = dict(zip(names, np.array([[0, 100], [1, 2], [3, 4], [5, 6], [7, 8], [9, 10], [11, 12]]), strict=True))
    run = ExportedRun("c", "room-1", 0, [], None, None, recorded=recorded)
    rows = [*csv.DictReader(io.StringIO(dict(files_of(run, case_of(run)))["poses.csv"].decode()))]
    told = [(each["frame"], *(float(each[name]) for name in POSES)) for each in rows]
    assert told == [
        ("base_link", 0.0, 0.007, 0.009, 0.011),
        ("turtlebot4_base_link_gt", 0.0, 0.001, 0.003, 0.005),
        ("base_link", 0.1, 0.008, 0.010, 0.012),
        ("turtlebot4_base_link_gt", 0.1, 0.002, 0.004, 0.006),
    ]


POSES = ("timestamp", "position.x", "position.y", "orientation.yaw")


def test_export_leaves_table_beside_file_of_its_name_as_parquet(small_room, tmp_path):
    outputs = Outputs(
        {"a": {"n": np.array([1])}, "b.parquet": {"n": np.array([2])}, "b": {"n": np.array([3])}}, {"a.csv": b"?"}
    )
    found = ConfigurationResult(outputs=[write_outputs({1: outputs})])
    directory = campaign_directory(small_room, tmp_path / "results", found)
    export(directory, tmp_path / "out")
    folder = tmp_path / "out/room-1/1/outputs"
    assert sorted(path.name for path in folder.iterdir()) == ["a.csv", "a.parquet", "b.csv", "b.parquet"]
    assert (folder / "a.csv").read_bytes() == b"?"
    assert pq.read_table(folder / "b.parquet").to_pydict() == {"n": [2]}


def test_export_keeps_programs_files_beside_its_own_without_replacing_one(small_room, tmp_path):
    files = {name: b"theirs" for name in ("test.xml", "logs", "sysinfo.yaml/x", "out.csv")}
    found = ConfigurationResult(
        verdicts=[Verdict("success", 0, "pass")],
        outputs=[write_outputs({0: Outputs(files=files)})],
        logs=[log_block({0: SIMULATED})],
    )
    export(campaign_directory(small_room, tmp_path / "results", found), tmp_path / "out")
    folder = tmp_path / "out/room-1/0"
    assert {name: (folder / "outputs" / name).read_bytes() for name in files} == files
    assert (folder / "out.csv").read_bytes() == b"theirs" and (folder / "logs/host.json").is_file()
    assert ElementTree.parse(folder / "test.xml").getroot().tag == "testsuite"


def test_export_names_platform_only_of_a_host_that_the_campaign_knows(results, tmp_path):
    metadata = json.loads((results / "metadata.json").read_text())
    for name, cpus, kind in (("bench", metadata["host"]["cpus"], "local"), ("other", None, "cluster")):
        metadata["host"]["name"] = name
        (results / "metadata.json").write_text(json.dumps(metadata))
        export(results, tmp_path / name)
        told = yaml.safe_load((tmp_path / name / "room-1/0/sysinfo.yaml").read_text())
        assert (told["available_cpus"], told["platform"]["machine"]) == (cpus, "x86_64")
        assert yaml.safe_load((tmp_path / name / "_execution/execution.yaml").read_text())["execution_type"] == kind


def test_campaign_db_has_a_search_s_proposals_in_their_batches(tmp_path):
    told = [
        {"configuration": f"a-{k}", "batch": k // 2, "point": '{"x": 1}', "standing": "judged", "objective": k / 4}
        for k in range(3)
    ]
    metadata = {"search": {"objective": "rate", "ended_by": "evaluations"}, "created": "2026-11-29T07:00:00"}
    (tmp_path / "campaign.db").write_bytes(
        dict(Vast().files(ExportedCampaign("c", metadata=metadata, evaluations=told)))["campaign.db"]
    )
    with closing(sqlite3.connect(tmp_path / "campaign.db")) as database:
        rows = database.execute(
            "SELECT config_name, idx, objective, objectives_json FROM unit JOIN batch ON batch.id = batch_id"
        )
        assert rows.fetchall() == [(f"a-{k}", k // 2, k / 4, json.dumps({"rate": k / 4})) for k in range(3)]
        assert database.execute("SELECT n_samples FROM unit").fetchall() == [(0,), (0,), (0,)]  # none was exported
        assert database.execute("SELECT mode, batches, stop_kind FROM campaign").fetchall() == [
            ("search", 2, "evaluations")
        ]


def test_export_distinguishes_duplicates_faults_and_missing_verdicts(small_room, tmp_path):
    small_room.write_text(small_room.read_text().replace("[0.0, 0.02]", "[0.0, 0.0]"))
    verdicts = [Verdict("success", 0, "pass"), Verdict("safety", 0, "not judged", "there is no box")]
    found = ConfigurationResult(verdicts=verdicts, faults=[RunFault("room-1", 1, "execute", "MemoryError: 3 GB")])
    directory = campaign_directory(small_room, tmp_path / "results", found, ("success", "safety"))
    said = called("export", directory, tmp_path / "out").stdout
    assert "2 configurations, 1 equal to another; 2 runs: 0 passed, 0 failed, 1 broken, 1 not judged" in said
    assert sorted(path.name for path in (tmp_path / "out/room-2").iterdir()) == [
        "_config",
        "duplicate_of",
        "scenario.config",
    ]
    assert (tmp_path / "out/room-2/duplicate_of").read_text() == "room-1\n"
    fault = "fault in execute: MemoryError: 3 GB"
    for run, tag, message in (
        (0, "skipped", "not judged by safety: there is no box"),
        (1, "error", f"success: {fault}; safety: {fault}"),
    ):
        case = ElementTree.parse(tmp_path / f"out/room-1/{run}/test.xml").getroot().find(f"testcase/{tag}")
        assert case.get("message") == message
    assert [path.name for path in (tmp_path / "out/room-1/1").iterdir()] == ["test.xml"]


def test_export_takes_patterns_of_families_and_configurations(results, tmp_path):
    both = ["room-1", "room-2"]
    for k, (patterns, names) in enumerate([(["room"], both), (["*-2"], both[1:]), (["*1", "*2"], both)]):
        folder = tmp_path / f"out{k}"
        assert export(results, folder, patterns).names == names
        assert sorted(path.name for path in folder.glob("room*")) == names
    for pattern, hint in (("rom-1", "Did you mean 'room-1'"), ("kitchen*", "Expected one of room, room-1, room-2")):
        words = re.escape(f"No family or configuration matches {pattern!r}. {hint}")
        with pytest.raises(UnusableDirectory, match=words):
            export(results, tmp_path / "none", ["room-1", pattern])
    assert not (tmp_path / "none").exists()


def test_export_names_scenario_as_in_its_file(small_room, tmp_path):
    text = "import osc.helpers\n\nscenario patrol:\n    do serial:\n        wait elapsed(1s)\n"
    small_room.with_name("rounds.osc").write_text(text)
    families = "configuration: [{name: room-1}]\nexecution: {scenario_file: rounds.osc, runs: 2}\n"
    small_room.write_text(f"version: 1\nmetadata: {{name: small_room}}\n{families}")
    export(campaign_directory(small_room, tmp_path / "results", whole()), tmp_path / "out")
    assert list(yaml.safe_load((tmp_path / "out/room-1/scenario.config").read_text())) == ["patrol"]
    header, root, *_ = map(json.loads, (tmp_path / "out/room-1/0/behaviors.jsonl").read_text().splitlines())
    assert (header["scenario"], root["osc_file"]) == ("patrol", "rounds.osc")
    assert (tmp_path / "out/_config/rounds.osc").read_text() == text


@pytest.mark.parametrize("existing", [True, False])
def test_interrupted_export_leaves_nothing_and_overwrites_nothing(results, tmp_path, existing):
    def interrupt(done, of):
        raise KeyboardInterrupt

    def write(done, of):
        folder.mkdir(exist_ok=True)
        (folder / "test.xml").write_text("mine")

    folder = tmp_path / "there/out"
    (folder if existing else folder.parent).mkdir(parents=True)
    with pytest.raises(KeyboardInterrupt):
        export(results, folder, progress=interrupt)
    assert [path.name for path in (tmp_path / "there").rglob("*")] == ["out"][:existing]
    with pytest.raises(UserError, match="expected a new or an empty folder, got one with files"):
        export(results, folder, progress=write)
    assert [(path.name, path.read_text()) for path in folder.iterdir()] == [("test.xml", "mine")]
    if existing:
        (folder / "test.xml").unlink()
        before = folder.stat().st_ino
        export(results, folder)
        assert folder.stat().st_ino == before  # it may be a mount point
        assert {path.name for path in folder.iterdir()} == {
            *("_config", "_execution", "_transient", "campaign.db", "junit.xml", "room-1", "room-2"),
        }


def test_export_refuses_output_outside_of_folder(small_room, tmp_path):
    found = ConfigurationResult(outputs=[write_outputs({0: Outputs(files={"../../../away": b"x"})})])
    directory = campaign_directory(small_room, tmp_path / "results", found)
    with pytest.raises(
        UnusableDirectory, match=r"damaged campaign directory: expected a path inside the folder, got '.*away'"
    ):
        export(directory, tmp_path / "out")
    assert not (tmp_path / "away").exists() and not (tmp_path / "out").exists()


@each_row("file", ["recordings/room-1.parquet", "behaviors.parquet", "logs/runs.jsonl", "outputs/room-1.zip"])
def test_export_refuses_damaged_file_and_writes_nothing(results, tmp_path, file):
    content = (results / file).read_bytes()
    (results / file).write_bytes(b"[{}]" if file.endswith("jsonl") else b"damaged")
    with pytest.raises(UnusableDirectory, match="damaged campaign directory: "):
        export(results, tmp_path / "out")
    assert not (tmp_path / "out").exists()
    (results / file).write_bytes(content)


def test_export_command_refuses_folder_that_cannot_be_made(results):
    folder = results / "metadata.json" / "out"
    assert (
        refused("export", results, folder) == f"{folder}: It can't be written (Not a directory). Name another folder."
    )


@example("\x1b[31mred\x1b[0m")
@example("\x00")
@example("half \ud800 a pair")
@example("\ufffe")
@given(st.text(st.characters(exclude_categories=())))
def test_junit_report_of_any_text_is_xml(text):
    case = Case(text, text, 0.0, None, {text: text}, Flaw("error", text, text))
    root = ElementTree.fromstring(campaign_report(text, [Suite(text, [case])]))
    assert root.find("testsuite/testcase/error") is not None
    assert ("\ufffd" in root.get("name")) >= (text in ("\x00", "\ufffe"))
