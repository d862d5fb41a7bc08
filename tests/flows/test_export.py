"""The export of a campaign directory: a folder for each run, and what each verdict becomes in it."""

import csv
import io
import json
import re
from datetime import datetime
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pyarrow.parquet as pq
import pytest
import yaml
from command_line import called
from table import each_row
from whole_directory import ConfigurationResult, write_results

from vastflow.flows.cli import export as export_command
from vastflow.flows.export import export as layout
from vastflow.flows.export.export import Exported, export
from vastflow.flows.export.junit import Case, Flaw, Suite
from vastflow.flows.export.run import recording_csv
from vastflow.flows.request.campaign_file import read_campaign
from vastflow.flows.results.found import FAULT, complete
from vastflow.flows.results.inputs import inputs_of
from vastflow.flows.results.summary import Work
from vastflow.oracles.judgement.verdict import Metric, Verdict
from vastflow.oracles.results.unusable import UnusableDirectory
from vastflow.producers.instantiation.instantiate import instantiate
from vastflow.sim.model.archive import table, write_behaviors, write_outputs
from vastflow.sim.model.blocks import write_recordings
from vastflow.sim.model.faults import UserError
from vastflow.sim.model.recording import Outputs, Recording, Run
from vastflow.sim.model.runlog import LogText, RunLog, Use, run_log_row
from vastflow.sim.run import BEHAVIORS
from vastflow.sim.world.map_file import load_map
from vastflow.tasks.engine.engine import RunFault
from vastflow.tasks.keys.keys import Keys

KEYS = Keys("x86_64; glibc 2.36; avx2 fma; ", "e" * 64, "o" * 64, "j" * 64, 0, [])
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
    return table(BEHAVIORS, rows)


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
    campaign, own = read_campaign(file)
    return write_results(
        root,
        campaign,
        inputs_of(campaign, own),
        instantiate(campaign),
        lambda configuration: found,
        runs=2,
        oracles=oracles,
        keys=KEYS,
        created=datetime(2026, 11, 21),
        work=lambda: Work(4, 0, 30.0, 2.0, 1.5),
        report=lambda directory: None,
    ).directory


@pytest.fixture
def results(small_room, tmp_path):
    return campaign_directory(small_room, tmp_path / "results", whole())


@pytest.fixture
def exported(results, tmp_path):
    export(results, tmp_path / "out")
    return tmp_path / "out"


def test_export_makes_folder_of_each_run(exported):
    folder = exported / "room-1"
    assert sorted(path.relative_to(folder).as_posix() for path in folder.rglob("*") if path.is_file()) == [
        "0/behaviors.csv",
        "0/behaviors.jsonl",
        "0/logs/0-python3.log",
        "0/logs/1-the-map-server.log",
        "0/logs/host.json",
        "0/logs/notes.log",
        "0/logs/scenario.log",
        "0/outputs/notes/read.me",
        "0/outputs/positions.csv",
        "0/outputs/scan.pcd",
        "0/recording.csv",
        "0/resources.csv",
        "0/test.xml",
        "1/behaviors.csv",
        "1/behaviors.jsonl",
        "1/logs/host.json",
        "1/recording.csv",
        "1/resources.csv",
        "1/test.xml",
        "scenario.config",
    ]
    assert sorted(path.name for path in exported.iterdir()) == ["_config", "room-1", "room-2", "test.xml"]


def test_export_writes_recordings_in_si_units_with_recorded_decimals(exported):
    assert (exported / "room-1/0/recording.csv").read_text() == (
        "t_s,x_m,covariance_xx_m2\n0,0.001,0\n0.1,-2.5,0.000005\n0.3,0.007,0.000001\n"
    )
    recorded = np.arange(-70_000, 70_000, 7, dtype=np.int32)
    rows = [*csv.reader(io.StringIO(recording_csv({"x_mm": recorded}).decode()))][1:]
    assert [round(float(x_m) * 1000) for (x_m,) in rows] == recorded.tolist()
    assert max(len(x_m) for (x_m,) in rows) <= len("-70.000")


def test_export_writes_behaviors_as_csv_and_as_lines(exported):
    assert (exported / "room-1/1/behaviors.csv").read_text() == (
        "timestamp,behavior_name,behavior_id,status,status_name,class_name,parent_id,child_index,message,line,column\n"
        "0.0,patrol,0,1,INVALID,Sequence,-1,0,,3,10\n"
        "0.0,nav_to_pose,1,1,INVALID,Navigate,0,0,,5,9\n"
        "7.5,patrol,0,4,FAILURE,Sequence,-1,0,,3,10\n"
        "7.5,nav_to_pose,1,4,FAILURE,Navigate,0,0,no valid trajectory,5,9\n"
    )
    header, root, child, *_ = map(json.loads, (exported / "room-1/1/behaviors.jsonl").read_text().splitlines())
    assert header["scenario"] == "navigate_to_pose"
    assert (header["tick_period"], header["clock"]) == (0.1, "simulated")
    assert (root["parent_id"], child["parent_id"]) == (None, 0)
    assert (child["osc_file"], child["osc_line"], child["osc_column"]) == ("navigate_to_pose.osc", 5, 9)


def test_export_writes_resources_of_programs_or_one_row_of_worker(exported):
    header = "t_s,cpu_s,rss_bytes,processes\n"
    assert (exported / "room-1/0/resources.csv").read_text() == header + "0.0,0.0,1024,1\n1.0,0.75,2048,3\n"
    assert (exported / "room-1/1/resources.csv").read_text() == header + "0.125,0.1,8192,1\n"


def test_export_writes_lines_of_scenario_and_output_of_each_program(exported):
    logs = exported / "room-1/0/logs"
    assert (logs / "scenario.log").read_text() == "0.1 s: begun\n"
    assert (logs / "0-python3.log").read_text() == "$ /usr/bin/python3 go.py\nhello\n"
    assert (logs / "1-the-map-server.log").read_text() == "$ m\nx\n[cut here]\n"
    assert (logs / "notes.log").read_text().startswith("big.bin (99 bytes)")
    assert json.loads((logs / "host.json").read_text())["host"]["name"] == "bench"


def test_export_copies_outputs_and_writes_tables_as_csv(exported):
    outputs = exported / "room-1/0/outputs"
    assert (outputs / "notes/read.me").read_bytes() == b"\x00\xff"
    assert [*csv.reader((outputs / "positions.csv").open())] == [
        ["t", "n", "who"],
        ["0.5", "1", "a"],
        ["", "2", 'b "c"'],
    ]


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


def test_export_writes_values_and_files_that_they_name(exported, small_room):
    values = yaml.safe_load((exported / "room-2/scenario.config").read_text())
    assert list(values) == ["navigate_to_pose"]
    given = values["navigate_to_pose"]
    assert given["goal_pose"]["position"] == {"x": 3.0, "y": 1.0}
    assert given["laserscan_gaussian_noise_std_deviation"] == 0.02
    found = load_map(exported / "room-2" / given["map_file"])
    assert found.digest == load_map(small_room.with_name("room.yaml")).digest
    for name, source in (("campaign.vast", small_room), ("room.yaml", small_room.with_name("room.yaml"))):
        assert (exported / "_config" / name).read_bytes() == source.read_bytes()


def test_report_of_passed_run_has_its_times_and_measures(exported):
    suite = ElementTree.parse(exported / "room-1/0/test.xml").getroot()
    (case,) = suite
    stated = {p.get("name"): p.get("value") for p in case.iter("property")}
    assert (suite.get("failures"), suite.get("errors"), suite.get("skipped")) == ("0", "0", "0")
    assert (case.get("classname"), case.get("name"), case.get("time")) == ("small_room.room-1", "room-1/0", "2.250000")
    assert stated["start_time"] == "1700000000.500000"
    assert (stated["simulated_time_s"], stated["wall_time_s"], stated["cpu_time_s"]) == ("7.5", "2.25", "1.5")
    assert (stated["host"], stated["outcome"], stated["success"]) == ("bench", "succeeded", "pass")
    assert (stated["success: time (s)"], stated["success: goals"]) == ("7.5", "2")
    assert "success: gap (m)" not in stated


def test_report_of_failed_run_names_oracles_and_final_tree(exported):
    (case,) = ElementTree.parse(exported / "room-1/1/test.xml").getroot()
    failure = case.find("failure")
    assert failure.get("message") == "success: mission aborted; safety: 0.1 m from a box"
    assert failure.text.splitlines() == [
        "success: fail: mission aborted",
        "safety: fail: 0.1 m from a box",
        "performance: not judged: no path",
        "",
        "FAILURE patrol (navigate_to_pose.osc:3:10)",
        "FAILURE   nav_to_pose (navigate_to_pose.osc:5:9): no valid trajectory",
    ]


def test_report_of_campaign_has_suite_of_each_configuration_and_few_properties(exported):
    root = ElementTree.parse(exported / "test.xml").getroot()
    assert (root.get("name"), root.get("tests"), root.get("failures")) == ("small_room", "4", "2")
    assert [(suite.get("name"), len(suite)) for suite in root] == [("room-1", 2), ("room-2", 2)]
    names = {p.get("name") for p in root.iter("property")}
    assert names == {"start_time", "simulated_time_s", "wall_time_s", "outcome"}


@each_row(
    ("verdicts", "faults", "tag", "message"),
    [
        (
            (),
            ["MemoryError: 3 GB"],
            "error",
            "success: fault in execute: MemoryError: 3 GB; safety: fault in execute: MemoryError: 3 GB",
        ),
        (
            (Verdict("success", 0, "pass"), Verdict("safety", 0, "not judged", "there is no box")),
            *((), "skipped", "not judged by safety: there is no box"),
        ),
        ((Verdict("success", 0, "fail", "late"),), (), "failure", "success: late"),
    ],
)
def test_report_tells_failures_faults_and_missing_verdicts_apart(small_room, tmp_path, verdicts, faults, tag, message):
    broken = [RunFault("room-1", 0, "execute", error) for error in faults]
    found = ConfigurationResult(verdicts=verdicts, faults=broken)
    export(campaign_directory(small_room, tmp_path / "results", found, ("success", "safety")), tmp_path / "out")
    suite = ElementTree.parse(tmp_path / "out/room-1/0/test.xml").getroot()
    counts = {kind: suite.get(kind) for kind in ("errors", "failures", "skipped")}
    assert [kind for kind, count in counts.items() if count != "0"] == [{"skipped": "skipped"}.get(tag, f"{tag}s")]
    assert suite.find(f"testcase/{tag}").get("message") == message
    if faults:
        assert [path.name for path in (tmp_path / "out/room-1/0").iterdir()] == ["test.xml"]


def test_reason_of_missing_verdict_begins_as_export_expects():
    faults = [RunFault("room", 0, "judge", "KeyError: 'x'")]
    reasons = [verdict.reason for verdict in complete(ConfigurationResult(faults=faults), 2, ["success"])]
    assert len(reasons) == 2 and all(reason.startswith(FAULT) for reason in reasons)


def test_export_names_original_of_duplicate_and_has_no_runs_of_it(small_room, tmp_path):
    small_room.write_text(small_room.read_text().replace("[0.0, 0.02]", "[0.0, 0.0]"))
    done = export(campaign_directory(small_room, tmp_path / "results", whole()), tmp_path / "out")
    assert sorted(path.name for path in (tmp_path / "out/room-2").iterdir()) == ["duplicate_of", "scenario.config"]
    assert (tmp_path / "out/room-2/duplicate_of").read_text() == "room-1\n"
    assert (done.duplicates, [suite.name for suite in done.suites]) == (1, ["room-1"])


def test_export_takes_patterns_of_families_and_configurations(results, tmp_path):
    for k, (patterns, names) in enumerate(
        [
            (["room"], ["room-1", "room-2"]),
            (["*-2"], ["room-2"]),
            (["room-1"], ["room-1"]),
            (["*1", "*2"], ["room-1", "room-2"]),
        ]
    ):
        folder = tmp_path / f"out{k}"
        assert [suite.name for suite in export(results, folder, patterns).suites] == names
        assert sorted(path.name for path in folder.glob("room*")) == names
    for pattern, hint in (("rom-1", "did you mean 'room-1'"), ("kitchen*", "it has room, room-1, room-2")):
        with pytest.raises(
            UnusableDirectory, match=re.escape(f"no family or configuration matches {pattern!r}; {hint}")
        ):
            export(results, tmp_path / "none", ["room-1", pattern])
    assert not (tmp_path / "none").exists()


def test_export_names_scenario_as_in_its_file(small_room, tmp_path):
    text = "import osc.helpers\n\nscenario patrol:\n    do serial:\n        wait elapsed(1s)\n"
    small_room.with_name("rounds.osc").write_text(text)
    edited = small_room.read_text().replace("execution:\n", "execution:\n  scenario_file: rounds.osc\n")
    for line in (
        "map_file: room.yaml",
        "start_pose: {x: 1.0, y: 1.0, yaw: 0.0}",
        "goal_pose: {x: 3.0, y: 1.0, yaw: 0.0}",
    ):
        edited = edited.replace(f"      - {line}\n", "")
    small_room.write_text(edited.replace("    parameters:\n", ""))
    export(campaign_directory(small_room, tmp_path / "results", whole()), tmp_path / "out")
    assert list(yaml.safe_load((tmp_path / "out/room-1/scenario.config").read_text())) == ["patrol"]
    header, root, *_ = map(json.loads, (tmp_path / "out/room-1/0/behaviors.jsonl").read_text().splitlines())
    assert (header["scenario"], root["osc_file"]) == ("patrol", "rounds.osc")
    assert (tmp_path / "out/_config/rounds.osc").read_text() == text


def test_export_fills_empty_folder_that_stays_the_same(results, tmp_path):
    (tmp_path / "there/out").mkdir(parents=True)
    before = (tmp_path / "there/out").stat().st_ino
    export(results, tmp_path / "there/out")
    assert (tmp_path / "there/out").stat().st_ino == before
    assert sorted(path.name for path in (tmp_path / "there/out").iterdir()) == [
        "_config",
        "room-1",
        "room-2",
        "test.xml",
    ]
    assert [path.name for path in (tmp_path / "there").iterdir()] == ["out"]


@pytest.mark.parametrize("existing", [True, False])
def test_export_that_ends_early_leaves_nothing(results, tmp_path, existing):
    def interrupt(done, of):
        raise KeyboardInterrupt

    folder = tmp_path / "there/out"
    (folder if existing else folder.parent).mkdir(parents=True)
    with pytest.raises(KeyboardInterrupt):
        export(results, folder, progress=interrupt)
    assert [path.name for path in (tmp_path / "there").rglob("*")] == ["out"][:existing]


@pytest.mark.parametrize("existing", [True, False])
def test_export_does_not_overwrite_what_appears_meanwhile(results, tmp_path, existing):
    if existing:
        (tmp_path / "out").mkdir()

    def write(done, of):
        (tmp_path / "out").mkdir(exist_ok=True)
        (tmp_path / "out/test.xml").write_text("mine")

    with pytest.raises(UserError, match="expected a new or an empty folder, got one with files"):
        export(results, tmp_path / "out", progress=write)
    assert [(path.name, path.read_text()) for path in (tmp_path / "out").iterdir()] == [("test.xml", "mine")]


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


def exporting(monkeypatch, *flaws, duplicates=0):
    """Put one configuration of runs with these flaws in the export's place."""
    asked = []

    def export(results, folder, only, progress):
        progress(7, 30)
        asked.append((results, folder, tuple(only)))
        return Exported(folder, duplicates, [Suite("room", [Case("r", "c", 1.0, flaw=flaw) for flaw in flaws])])

    monkeypatch.setattr(layout, "export", export)
    return asked


def test_export_command_counts_outcomes_of_runs(tmp_path, monkeypatch):
    (tmp_path / "metadata.json").write_text("{}")
    asked = exporting(monkeypatch, None, None, Flaw("failure", "f"))
    done = called("export", tmp_path, "out", "--only", "room*", "--only", "hall")
    assert (done.exit_code, done.stderr) == (0, "")
    assert done.stdout == "1 configuration; 3 runs: 2 passed, 1 failed\nexported: out\n"
    assert asked == [(tmp_path, Path("out"), ("room*", "hall"))]
    monkeypatch.setattr(export_command, "PERIOD_S", 0.0)
    exporting(monkeypatch, None, *(Flaw(kind, "e") for kind in ("error", "skipped", "skipped")), duplicates=2)
    done = called("export", tmp_path, "out")
    assert (done.exit_code, done.stderr) == (0, "7 of 30 configurations exported\n")
    assert done.stdout.splitlines()[0] == (
        "3 configurations, 2 equal to another; 4 runs: 1 passed, 0 failed, 1 broken, 2 not judged"
    )


def test_export_command_refuses_folder_that_cannot_be_made(tmp_path, monkeypatch):
    def export(results, folder, only, progress):
        raise PermissionError(13, "Permission denied")

    (tmp_path / "metadata.json").write_text("{}")
    monkeypatch.setattr(layout, "export", export)
    done = called("export", tmp_path, "out")
    assert (done.exit_code, done.stderr) == (2, "out: can't be written (Permission denied); name another folder\n")
