"""The campaign flow with a real Prefect: what is executed after what, counted. One campaign is shared by all tests."""

import asyncio
import json
import os
import shutil
import signal
import sqlite3
import subprocess
import sys

import psutil
import pytest

from vastflow.flows import run_campaign
from vastflow.flows.flow_runs import flow_call
from vastflow.flows.run import prepared
from vastflow.sim.model.faults import FileError
from vastflow.tasks.keys.source import installed_tree

pytestmark = pytest.mark.timeout(900)

CAMPAIGN = """
version: 1
metadata: {name: tiny}
configuration:
  - name: room
    parameters:
      - map_file: room.yaml
    variations:
      - own.py:Task:
          distances_m: [0.6, 0.9]
      - ParameterVariationList:
          name: laserscan_gaussian_noise_std_deviation
          values: [0.0, 0.01]
execution: {runs: 2, timeout: 30}
evaluation:
  oracles:
    - safety: {}
    - own_oracle.py:Distance: {least_m: 0.1}
"""
CONFIGURATIONS, RUNS = 4, 2

PRODUCER = """
from vastflow.producers.model.configuration import Fragment
from vastflow.producers.model.producer import Parameters, Producer


class TaskParameters(Parameters):
    distances_m: tuple[float, ...]


class Task(Producer[TaskParameters]):
    Parameters = TaskParameters
    reads = ()
    writes = {"start_pose": "task", "goal_pose": "task"}

    def produce(self, inputs, draws):
        for distance_m in self.parameters.distances_m:
            goal_x_m = 1.0 + distance_m
            yield Fragment({"start_pose": pose(1.0), "goal_pose": pose(goal_x_m)})


def pose(x_m):
    return {"position": {"x": x_m, "y": 1.5}, "orientation": {"yaw": 0.0}}
"""

ORACLE = """
from vastflow.oracles.judgement.oracle import Oracle, Parameters


class DistanceParameters(Parameters):
    least_m: float


class Distance(Oracle[DistanceParameters]):
    Parameters = DistanceParameters
    metrics = {"distance": "m"}

    def judge(self, trace, situation):
        distance_m = trace.run.distance_m
        return self.passed(trace, distance=distance_m)
"""


@pytest.fixture(scope="module")
def place(tmp_path_factory, one_server):
    """A folder with the campaign, its map and plug-ins; Prefect's home and the store are beside it."""
    folder = tmp_path_factory.mktemp("campaign")
    side = 60
    cells = bytes(0 if x in (0, side - 1) or y in (0, side - 1) else 254 for y in range(side) for x in range(side))
    (folder / "room.pgm").write_bytes(b"P5 %d %d 255\n" % (side, side) + cells)
    (folder / "room.yaml").write_text("{image: room.pgm, resolution: 0.05, origin: [0, 0, 0]}")
    (folder / "tiny.vast").write_text(CAMPAIGN)
    (folder / "own.py").write_text(PRODUCER)
    (folder / "own_oracle.py").write_text(ORACLE)
    with one_server(folder / "prefect"), pytest.MonkeyPatch.context() as patch:
        tree = installed_tree()  # reads each file once: an edit of the checkout while this runs is not what is tested
        patch.setattr(prepared, "installed_tree", lambda: tree)
        yield folder


@pytest.fixture(scope="module")
def first_with_artifacts(place):
    result = run_campaign(place / "tiny.vast", results=place / "results", store=place / "store", workers=2)
    return result, {stage: sorted((place / "store" / stage).rglob("manifest")) for stage in ("execute", "observe")}


@pytest.fixture(scope="module")
def first(first_with_artifacts):
    """The first run of the campaign, which executes everything."""
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
        for file, old, new in edits:
            text = (folder / file).read_text()
            assert text.count(old) == 1
            (folder / file).write_text(text.replace(old, new))
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


class Phases:
    def __init__(self):
        self.seen = []

    def update(self, progress):
        if progress.phase not in self.seen:
            self.seen.append(progress.phase)


@pytest.fixture
def no_prefect(monkeypatch):
    def refuse(*_):
        raise AssertionError("Prefect was started")

    monkeypatch.setattr(flow_call, "ApiServer", refuse)


def test_first_run_executes_everything(first):
    summary = first.summary
    assert (summary.configurations, summary.runs, summary.executed, summary.reused) == (4, 8, 8, 0)
    assert summary.passed + summary.failed == 8
    assert first.faults == ()


def test_task_runs_are_recorded_in_a_final_state_under_a_readable_name(place, first):
    expected = {f"{stage} {k} of room" for stage in ("execute", "observe", "judge") for k in range(1, 5)}
    expected |= {"instantiate room by Task", "instantiate room by ParameterVariationList"}
    flow_run = "(select id from flow_run order by start_time limit 1)"
    found = rows(place, f"select name, state_name from task_run where flow_run_id = {flow_run}")
    assert sorted(found) == sorted((name, "Completed") for name in expected)


def test_graph_leads_from_each_producer_to_the_next_and_to_the_runs(place, first):
    flow_run = "(select id from flow_run order by start_time limit 1)"
    found = rows(place, f"select id, name, task_inputs from task_run where flow_run_id = {flow_run}")
    names = {identity: name for identity, name, _ in found}
    follows = {
        name: {names[each["id"]] for each in before}
        for _, name, inputs in found
        if (before := json.loads(inputs).get("wait_for"))
    }
    last = "instantiate room by ParameterVariationList"
    assert follows == {last: {"instantiate room by Task"}, **{f"execute {k} of room": {last} for k in range(1, 5)}}


def test_task_run_whose_shard_was_in_the_store_is_shown_as_cached(place, again):
    again(("tiny.vast", "values: [0.0, 0.01]", "values: [0.0, 0.03]"))
    last = "(select id from flow_run order by start_time desc limit 1)"
    found = rows(place, f"select name, state_name from task_run where flow_run_id = {last}")
    expected = {(f"{stage} {k} of room", "Completed") for stage in ("execute", "observe", "judge") for k in (2, 4)}
    expected |= {("instantiate room by Task", "Cached"), ("instantiate room by ParameterVariationList", "Completed")}
    assert set(found) == expected


def test_flow_run_has_the_campaigns_name_and_size_and_is_completed(place, first):
    name, state = rows(place, "select name, state_name from flow_run order by start_time limit 1")[0]
    assert (name, state) == ("tiny, 4 configurations × 2 runs", "Completed")


def test_second_run_executes_nothing_and_starts_no_prefect(again, counted, no_prefect):
    phases = Phases()
    found = again(observer=phases)
    assert (found.summary.executed, found.summary.reused) == (0, 8)
    assert counted() == {"runs": 0, "evaluate": 0, "observe": 0, "judge": 0}
    assert phases.seen[-1] == "reporting"
    assert "starting Prefect" not in phases.seen


def test_same_bytes_come_from_the_store(first, again):
    second = again()
    for recording in sorted((first.directory / "recordings").iterdir()):
        assert (second.directory / "recordings" / recording.name).read_bytes() == recording.read_bytes()


@pytest.mark.slow
def test_worker_alone_records_the_same_bytes_as_two(place, first, tmp_path):
    alone = run_campaign(place / "tiny.vast", results=tmp_path / "results", store=tmp_path / "store", workers=1)
    assert alone.summary.executed == CONFIGURATIONS * RUNS
    assert recordings(alone) == recordings(first)


def test_three_more_runs_execute_exactly_those(again, counted):
    found = again(runs=RUNS + 3)
    assert (found.summary.executed, found.summary.reused) == (3 * CONFIGURATIONS, RUNS * CONFIGURATIONS)
    assert counted()["runs"] == 3 * CONFIGURATIONS


def test_another_noise_level_executes_the_configurations_that_have_it(again, counted):
    found = again(("tiny.vast", "values: [0.0, 0.01]", "values: [0.0, 0.02]"))
    assert (found.summary.executed, found.summary.reused) == (2 * RUNS, 2 * RUNS)
    assert counted() == {"runs": 2 * RUNS, "evaluate": 1, "observe": 2 * RUNS, "judge": 2 * RUNS}


def test_oracles_parameter_judges_everything_and_executes_nothing_also_from_a_notebook(again, counted):
    async def cell():  # a notebook's cell runs inside an event loop
        return again(("tiny.vast", "least_m: 0.1", "least_m: 0.2"))

    found = asyncio.run(cell())
    assert found.summary.executed == 0
    added = counted()
    assert (added["runs"], added["observe"]) == (0, 0)
    assert added["judge"] >= CONFIGURATIONS


def test_comment_in_a_plug_in_costs_nothing(again, no_prefect, counted):
    again(("own.py", "goal_x_m = 1.0 + distance_m", "goal_x_m = 1.0 + distance_m  # ahead"))
    assert counted() == {"runs": 0, "evaluate": 0, "observe": 0, "judge": 0}


def test_edited_producer_executes_what_it_produces_anew(again, counted):
    code = ("own.py", "goal_x_m = 1.0 + distance_m", "goal_x_m = 1.0 + (distance_m if distance_m < 0.7 else 1.0)")
    found = again(code)
    assert (found.summary.executed, found.summary.reused) == (2 * RUNS, 2 * RUNS)
    assert counted()["evaluate"] == 1


def test_damaged_recording_is_recorded_again_and_its_trace_and_verdicts_stay(artifacts, again, counted):
    recording = artifacts["execute"][0] / "recordings.parquet"
    content = bytearray(recording.read_bytes())
    content[len(content) // 2] ^= 1
    recording.write_bytes(content)
    found = again()
    assert 0 < found.summary.executed <= RUNS
    assert found.faults == ()
    assert {stage: number for stage, number in counted().items() if stage != "runs"} == {
        "evaluate": 0,
        "observe": 0,
        "judge": 0,
    }
    assert recording.read_bytes() != bytes(content)
    assert "is damaged and will be computed again" in (found.directory / "logs" / "campaign.log").read_text()


def test_lost_trace_is_observed_again_and_nothing_else(artifacts, again, counted):
    shutil.rmtree(artifacts["observe"][0])
    assert counted()["observe"] == -1
    found = again()
    assert found.summary.executed == 0
    assert counted() == {"runs": 0, "evaluate": 0, "observe": 0, "judge": 0}


def test_oracle_that_raises_breaks_no_campaign_and_its_verdicts_are_not_kept(again, counted):
    broken = "distance_m = trace.run.distance_m if trace.run.run_index else 1 / 0"
    found = again(("own_oracle.py", "distance_m = trace.run.distance_m", broken))
    assert found.summary.not_judged > 0
    assert {(fault.stage, fault.error) for fault in found.faults} == {("judge", "ZeroDivisionError: division by zero")}
    assert found.summary.executed == 0
    judged = counted()["judge"]
    repaired = again(("own_oracle.py", "else 1 / 0", "else 1.0"))
    assert (repaired.summary.not_judged, repaired.faults) == (0, ())
    assert counted()["judge"] == judged + CONFIGURATIONS * RUNS


SCRIPT = """
import signal
from vastflow.flows import run_campaign

signal.signal(signal.SIGINT, signal.default_int_handler)  # a background job of a shell ignores it

class Show:
    def update(self, progress):
        print(progress.executed, flush=True)

run_campaign("tiny.vast", runs=60, results="results", store={store!r}, workers=2, observer=Show())
"""


@pytest.mark.slow
def test_interrupted_campaign_ends_early_and_goes_on_where_it_was(place, first, tmp_path, again, counted, prefect_home):
    script = SCRIPT.format(store=str(place / "store"))
    campaign = subprocess.Popen(
        [sys.executable, "-c", script],
        cwd=place,
        env={**os.environ, "PREFECT_HOME": str(prefect_home(tmp_path / "prefect"))},
        stdout=subprocess.PIPE,
        stderr=subprocess.DEVNULL,
        text=True,
        start_new_session=True,
    )
    try:
        while int(campaign.stdout.readline()) < 10:
            pass
        children = psutil.Process(campaign.pid).children(recursive=True)
        os.killpg(campaign.pid, signal.SIGINT)
        campaign.communicate(timeout=240)
    finally:
        campaign.kill()
    _, alive = psutil.wait_procs(children, timeout=60)
    assert alive == []
    assert not list((place / "results").glob(".*"))
    there = counted()["runs"]
    found = again(runs=60)
    assert 0 < there < found.summary.reused
    assert found.summary.executed > 0
    assert counted()["runs"] == there + found.summary.executed
    assert found.summary.executed + found.summary.reused == 60 * CONFIGURATIONS


def test_campaign_runs_only_a_named_configuration(again):
    found = again(only="room-2-1", runs=RUNS)
    assert (found.summary.configurations, found.summary.runs) == (1, RUNS)


def test_unknown_name_is_a_users_mistake(again):
    with pytest.raises(FileError, match=r"no family or configuration 'rom'; did you mean 'room'\?"):
        again(only=["rom"])


NAME = "  - name: room\n"


def test_constraint_excludes_configurations_and_counts_them(again, no_prefect):
    found = again(("tiny.vast", NAME, NAME + "    constraints: {far: straight_distance > 0.7}\n"))
    assert (found.summary.configurations, found.summary.excluded_by) == (2, {"room": {"far": 1}})
    assert json.loads((found.directory / "coverage.json").read_text())["excluded_by"] == {"far": 1}


def test_constraints_that_leave_nothing_once_producers_have_run_are_a_users_mistake(again):
    edits = [
        ("tiny.vast", NAME, NAME + "    constraints: {far: straight_distance > 9}\n"),
        ("tiny.vast", "[0.0, 0.01]", "[0.0, 0.03]"),
    ]
    with pytest.raises(FileError, match="the constraints leave nothing of family 'room': far excludes 2"):
        again(*edits)


def test_ended_campaign_leaves_no_task_run_open(place, first):
    ended = "select id from flow_run where state_name = 'Completed'"
    final = "('COMPLETED', 'FAILED', 'CRASHED', 'CANCELLED')"
    assert rows(place, f"select name from task_run where flow_run_id in ({ended}) and state_type not in {final}") == []
