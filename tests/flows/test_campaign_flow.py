"""The campaign flow with a real Prefect: what is executed after what, counted. One campaign is shared by all tests."""

import asyncio
import json
import re
import shutil
import sqlite3
from types import SimpleNamespace

import pytest
from room import edited, laid_out

from vastflow.flows import run_campaign
from vastflow.tasks.store.folder_files import FolderFiles
from vastflow.tasks.store.store import StoreError

pytestmark = pytest.mark.timeout(900)

CONFIGURATIONS, RUNS = 4, 2
NOTHING = {"runs": 0, "evaluate": 0, "observe": 0, "judge": 0}


@pytest.fixture(scope="module")
def place(flow_folder):
    laid_out(flow_folder, "tiny", [0.6, 0.9])
    return flow_folder


@pytest.fixture(scope="module")
def first_with_artifacts(place):
    result = run_campaign(place / "tiny.vast", results=place / "results", store=place / "store", workers=2)
    return result, {stage: sorted((place / "store" / stage).rglob("manifest")) for stage in ("execute", "observe")}


@pytest.fixture(scope="module")
def first(first_with_artifacts):
    return first_with_artifacts[0]


@pytest.fixture(scope="module")
def artifacts(first_with_artifacts):
    """Stage to the folders of the artifacts that the first run made."""
    return {stage: [file.parent for file in files] for stage, files in first_with_artifacts[1].items()}


@pytest.fixture
def again(place, first, tmp_path, monkeypatch):
    """Runs an edited copy of the campaign over the same store: edits are (file, old, new)."""
    folder = tmp_path / "edited"
    shutil.copytree(place, folder, ignore=shutil.ignore_patterns("prefect", "results", "store"))

    def run(*edits, **options):
        edited(folder, *edits)
        return run_campaign(folder / "tiny.vast", results=tmp_path / "results", store=place / "store", **options)

    return run


@pytest.fixture
def counted(place, first):
    """Yield counters of runs and artifacts added to the store since the test began."""
    before = count(place / "store")
    return lambda: {stage: number - before[stage] for stage, number in count(place / "store").items()}


def count(store):
    logs = [json.loads(log.read_text()) for log in store.glob("execute/*/*/*/runlog.json")]
    stages = {stage: len(list(store.glob(f"{stage}/*/*/manifest"))) for stage in ("evaluate", "observe", "judge")}
    return {"runs": sum(len(log["runs"]) for log in logs), **stages}


def recordings(result):
    return {file.name: file.read_bytes() for file in (result.directory / "recordings").iterdir()}


def rows(place, statement):
    with sqlite3.connect(place / "prefect" / "prefect.db") as database:
        return database.execute(statement).fetchall()


def test_first_run_executes_everything_in_completed_flow_run(place, first):
    summary = first.summary
    assert (summary.configurations, summary.runs, summary.executed, summary.reused) == (4, 8, 8, 0)
    assert summary.passed + summary.failed == 8
    assert first.faults == ()
    (found,) = rows(place, "select name, state_name from flow_run order by start_time limit 1")
    assert found == ("tiny, 4 configurations × 2 runs", "Completed")


def test_task_runs_have_readable_names_and_follow_producers(place, first):
    flow_run = "(select id from flow_run order by start_time limit 1)"
    found = rows(place, f"select id, name, state_name, task_inputs from task_run where flow_run_id = {flow_run}")
    expected = {f"{stage} {k} of room" for stage in ("execute", "observe", "judge") for k in range(1, 5)}
    last = "instantiate room by ParameterVariationList"
    expected |= {"instantiate room by Ahead", last}
    assert sorted((name, state) for _, name, state, _ in found) == sorted((name, "Completed") for name in expected)
    names = {identity: name for identity, name, _, _ in found}
    follows = {
        name: {names[each["id"]] for each in before}
        for _, name, _, inputs in found
        if (before := json.loads(inputs).get("wait_for"))
    }
    assert follows == {last: {"instantiate room by Ahead"}, **{f"execute {k} of room": {last} for k in range(1, 5)}}


def messages(place, flow_run):
    """Name of each task run to the message of its last state."""
    of = f"from task_run t join task_run_state s on t.state_id = s.id where t.flow_run_id = {flow_run}"
    return dict(rows(place, f"select t.name, s.message {of}"))


def test_task_runs_say_configurations_counts_and_keys(place, first, artifacts):
    found = messages(place, "(select id from flow_run order by start_time limit 1)")
    keys = {"/".join(folder.parts[-4:-1]) for folder in artifacts["execute"]}
    for stage in ("execute", "observe", "judge"):
        assert re.match(r"0 of [12] in the store before; room-1-1, 2 runs; execute/", found[f"{stage} 1 of room"])
        assert {found[f"{stage} {k} of room"].rpartition("; ")[2] for k in range(1, 5)} == keys
    said = found["instantiate room by ParameterVariationList"]
    assert said.startswith("0 of 1 in the store before; room by ParameterVariationList, 1 evaluation; evaluate/")


def why_of(result):
    rows = json.loads((result.directory / "metadata.json").read_text())["why"]
    return {row["stage"]: (row["reused"], row["computed"], row["why"]) for row in rows}


def test_directory_and_report_keep_why_something_was_computed(first, again):
    told = "never computed before, as far as is known"
    follows = "follows from execute"
    assert why_of(first) == {
        "instantiate": (0, 2, told),
        "execute": (0, 8, told),
        "observe": (0, 8, follows),
        "judge": (0, 8, follows),
    }
    before = again()
    assert why_of(before) == {stage: (8, 0, "") for stage in ("execute", "observe", "judge")}
    stricter = again(("tiny.vast", "least_m: 0.1", "least_m: 0.15"))
    reason = "parameters of oracle driven.py:Driven changed: least_m from 0.1 to 0.15"
    assert why_of(stricter)["judge"] == (0, 8, reason)
    assert why_of(stricter)["execute"] == (8, 0, "")
    assert f"<td>{reason}</td>" in (stricter.directory / "report.html").read_text()


def test_second_run_executes_nothing_starts_no_prefect_and_writes_the_same_bytes(first, again, counted, no_prefect):
    phases = []
    found = again(observer=SimpleNamespace(update=lambda progress: phases.append(progress.phase)))
    assert (found.summary.executed, found.summary.reused) == (0, 8)
    assert counted() == NOTHING
    assert phases[-1] == "reporting" and "starting Prefect" not in phases
    assert recordings(found) == recordings(first)
    assert again(only=["room-1-1"]).summary.executed == 0  # the directory is new


def read_only(self, *_):
    raise StoreError("store: can't write to 'store' (Read-only file system)") from None


def test_full_store_that_can_only_be_read_is_enough_unless_something_is_missing(first, again, no_prefect, monkeypatch):
    for method in ("prepare", "write", "delete"):
        monkeypatch.setattr(FolderFiles, method, read_only)
    found = again()
    assert (found.summary.executed, found.summary.reused, found.faults) == (0, 8, ())
    assert recordings(found) == recordings(first)
    with pytest.raises(StoreError, match="Read-only file system"):
        again(("tiny.vast", "values: [0.0, 0.01]", "values: [0.0, 0.05]"))


def test_changed_noise_level_executes_its_configurations_only(place, again, counted):
    found = again(("tiny.vast", "values: [0.0, 0.01]", "values: [0.0, 0.02]"))
    assert (found.summary.executed, found.summary.reused) == (2 * RUNS, 2 * RUNS)
    assert counted() == {"runs": 2 * RUNS, "evaluate": 1, "observe": 2 * RUNS, "judge": 2 * RUNS}
    last = "(select id from flow_run order by start_time desc limit 1)"
    states = rows(place, f"select name, state_name from task_run where flow_run_id = {last}")
    expected = {(f"{stage} {k} of room", "Completed") for stage in ("execute", "observe", "judge") for k in (2, 4)}
    expected |= {("instantiate room by Ahead", "Cached"), ("instantiate room by ParameterVariationList", "Completed")}
    assert set(states) == expected


def test_oracle_parameter_judges_again_without_executing_inside_event_loop(place, again, counted):
    async def cell():  # a notebook's cell runs inside an event loop
        return again(("tiny.vast", "least_m: 0.1", "least_m: 0.2"))

    found = asyncio.run(cell())
    assert found.summary.executed == 0
    added = counted()
    assert (added["runs"], added["observe"]) == (0, 0)
    assert added["judge"] >= CONFIGURATIONS
    last = "(select id from flow_run order by start_time desc limit 1)"
    states = rows(place, f"select name, state_name from task_run where flow_run_id = {last}")
    expected = [("execute", "Cached"), ("judge", "Completed"), ("observe", "Cached")]
    assert sorted(states) == [(f"{stage} 1–4 of room", state) for stage, state in expected]


def test_damaged_recording_is_recorded_again_and_keeps_trace_and_verdicts(artifacts, again, counted):
    recording = artifacts["execute"][0] / "recordings.parquet"
    content = bytearray(recording.read_bytes())
    content[len(content) // 2] ^= 1
    recording.write_bytes(content)
    found = again()
    assert 0 < found.summary.executed <= RUNS
    assert found.faults == ()
    assert {**counted(), "runs": 0} == NOTHING
    assert recording.read_bytes() != bytes(content)
    assert "is damaged and will be computed again" in (found.directory / "logs" / "campaign.log").read_text()


def test_oracle_that_raises_is_a_fault_and_judged_again_after_repair(again, counted):
    broken = "trace.run.distance_m if trace.run.run_index else 1 / 0"
    found = again(("driven.py", "trace.run.distance_m", broken))
    assert found.summary.not_judged > 0
    assert {(fault.stage, fault.error) for fault in found.faults} == {("judge", "ZeroDivisionError: division by zero")}
    assert found.summary.executed == 0
    judged = counted()["judge"]
    repaired = again(("driven.py", "else 1 / 0", "else 1.0"))
    assert (repaired.summary.not_judged, repaired.faults) == (0, ())
    assert counted()["judge"] == judged + CONFIGURATIONS * RUNS
