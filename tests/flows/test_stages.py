"""The stages of the Python API with a real Prefect, on one campaign that the tests share in order."""

import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest
from bench_pipeline import SCENARIO

from vastflow.flows import execute, instantiate, judge, observe, run_campaign
from vastflow.oracles.statistics.intervals import Counts
from vastflow.sim.model.faults import FileError, UserError
from vastflow.tasks.store.store import Lost

pytestmark = pytest.mark.timeout(900)

ROOT = Path(__file__).parents[2]
EXAMPLES = ROOT / "docs" / "use-the-python-api.md"

CAMPAIGN = """\
version: 1
metadata: {name: small}
configuration:
  - name: left
    variations:
      - ParameterVariationList: {name: first, values: [1, 2]}
      - ParameterVariationList: {name: second, values: [1, 1]}
  - name: right
    variations:
      - ParameterVariationList: {name: first, values: [3]}
      - ParameterVariationList: {name: second, values: [4]}
execution: {scenario_file: nothing.osc, runs: 2, timeout: 30}
evaluation:
  oracles:
    - own.py:Even
"""
ORACLE = """
from vastflow.oracles.judgment.oracle import Oracle, Parameters


class EvenParameters(Parameters):
    remainder: int = 0
    broken_at: int = -1


class Even(Oracle[EvenParameters]):
    Parameters = EvenParameters
    metrics = {"index": "1"}

    def judge(self, trace, situation):
        index = trace.run.run_index
        if index == self.parameters.broken_at:
            raise ValueError("this one")
        if index % 2 == self.parameters.remainder:
            return self.passed(trace, index=index)
        return self.failed(trace, "odd", index=index)
"""


@pytest.fixture(scope="module")
def place(flow_folder):
    for name, text in (("nothing.osc", SCENARIO), ("small.vast", CAMPAIGN), ("own.py", ORACLE)):
        (flow_folder / name).write_text(text)
    return flow_folder


@pytest.fixture(scope="module")
def configurations(place):
    return instantiate(place / "small.vast", store=place / "store", workers=2)


@pytest.fixture(scope="module")
def recordings(configurations):
    return execute(configurations, workers=2)


@pytest.fixture(scope="module")
def traces(recordings):
    return observe(recordings, workers=2)


@pytest.fixture(scope="module")
def verdicts(traces):
    return judge(traces, workers=2)


def count(place, stage):
    return len(list((place / "store" / stage).rglob("manifest")))


def test_instantiate_names_configurations_and_executes_nothing(place, configurations):
    assert configurations.names == ("left-1-1", "left-1-2", "left-2-1", "left-2-2", "right-1-1")
    assert configurations["left-2-1"].factors["first"] == 2
    assert configurations["left-1-2"].duplicate_of == "left-1-1"
    assert configurations.table().column("name").to_pylist() == list(configurations.names)
    assert count(place, "execute") == 0
    assert repr(configurations) == "<small: 5 configurations, 0 instances rejected, 0 excluded>"
    with pytest.raises(UserError, match=r"Unknown configuration 'left-1-3'\. Did you mean 'left-1-"):
        configurations["left-1-3"]


def test_execute_records_distinct_configurations_and_reads_them_by_name(place, recordings):
    assert repr(recordings) == "<small: 3 configurations × 2 runs, 6 recorded>"
    assert [recording.run.run_index for recording in recordings.of("right-1-1")] == [0, 1]
    assert [r.digest for r in recordings.of("left-1-2")] == [r.digest for r in recordings.of("left-1-1")]
    assert count(place, "observe") == 0
    rows = recordings.table().select(["configuration", "family", "run_index", "outcome"]).to_pylist()
    names = ("left-1-1", "left-2-1", "right-1-1")
    expected = [(name, name.partition("-")[0], run, "succeeded") for name in names for run in (0, 1)]
    assert [tuple(row.values()) for row in rows] == expected


def test_observe_and_judge_give_traces_and_verdicts_of_file_oracles(traces, verdicts):
    assert [trace.run.run_index for trace in traces.of("left-2-2")] == [0, 1]
    assert traces.table("left-2-2").num_rows == 0  # nothing has signals without a robot
    assert verdicts.oracles == ("success", "own.py:Even")
    assert [(v.oracle, v.run_index, v.judgment) for v in verdicts.of("right-1-1")] == [
        ("success", 0, "pass"),
        ("own.py:Even", 0, "pass"),
        ("success", 1, "pass"),
        ("own.py:Even", 1, "fail"),
    ]
    assert verdicts.counts()["left-1-1"] == Counts(passed=1, failed=1)
    assert verdicts.counts("success")["left-1-1"] == Counts(passed=2)
    assert verdicts.table().num_rows == 12
    index = [row["value"] for row in verdicts.metrics().to_pylist() if row["metric"] == "index"]
    assert index == [0, 1] * 3
    with pytest.raises(ValueError, match=r"expected an oracle that judged, success, own\.py:Even, got 'safety'"):
        verdicts.counts("safety")


def test_values_are_tables_and_plots_in_notebooks(configurations, recordings, traces, verdicts):
    for value in (configurations, recordings, traces, verdicts):
        html = value._repr_html_()
        assert html.startswith(f"<p>&lt;{repr(value)[1:-1]}&gt;</p><table")
        assert "<td>left-1-1</td>" in html and "<th>first</th>" in html
    assert recordings.plot("left-1-1")._repr_png_().startswith(b"\x89PNG")
    with pytest.raises(UserError, match="Unknown signal 'sped_mps'"):
        traces.plot("left-1-1", "sped_mps")


def test_stages_and_campaign_take_stored_results_without_prefect(place, verdicts, no_prefect):
    again = judge(observe(execute(instantiate(place / "small.vast", store=place / "store"))))
    assert again.blocks == verdicts.blocks
    result = run_campaign(place / "small.vast", store=place / "store", results=place / "results")
    assert (result.summary.executed, result.summary.reused) == (0, 6)


def test_execute_computes_only_added_runs(place, configurations, verdicts):
    before = count(place, "execute")
    more = execute(configurations, runs=3, only="right", workers=2)
    assert (more.names, len(more.of("right-1-1"))) == (("right-1-1",), 3)
    assert count(place, "execute") == before + 1
    with pytest.raises(UserError, match="Unknown configuration 'left-1-1'"):
        more.of("left-1-1")


def test_judge_by_other_parameters_executes_nothing_and_returns_faults(place, traces, verdicts):
    before = {stage: count(place, stage) for stage in ("execute", "observe", "judge")}
    verdicts = judge(traces, oracles=[{"own.py:Even": {"remainder": 1, "broken_at": 0}}], workers=2)
    assert [stage for stage, number in before.items() if count(place, stage) != number] == ["judge"]
    assert verdicts.counts("own.py:Even")["right-1-1"] == Counts(passed=1, not_judged=1)
    assert [(fault.run_index, fault.stage, fault.error) for fault in verdicts.faults] == [
        (0, "judge", "ValueError: this one")
    ] * 3
    said = [verdict for verdict in verdicts.of("right-1-1") if verdict.run_index == 0]
    assert [verdict.judgment for verdict in said] == ["not judged"] * 2
    assert said[0].reason == "fault in judge: ValueError: this one"
    assert repr(verdicts).endswith("judged by success, own.py:Even, 3 faults>")


def test_judge_refuses_unknown_parameter_of_oracle_with_its_place(traces):
    with pytest.raises(FileError, match=r"small\.vast:1:1: oracles\[1\]\.rest: Unknown key 'rest'"):
        judge(traces, oracles=["success", {"own.py:Even": {"rest": 1}}])


def test_stages_report_deleted_artifacts_as_lost(place, configurations, tmp_path):
    shutil.copytree(place / "store", tmp_path / "store")
    (tmp_path / "own.py").write_text(ORACLE)
    for name in ("small.vast", "nothing.osc"):
        shutil.copy(place / name, tmp_path)
    recordings = execute(instantiate(tmp_path / "small.vast", store=tmp_path / "store"))
    shutil.rmtree(tmp_path / "store" / "execute")
    shutil.rmtree(tmp_path / "store" / "observe")
    with pytest.raises(Lost, match=r"recordings of left-1-1 are not in the store .*\. Call execute again"):
        observe(recordings)
    with pytest.raises(Lost, match="execute/"):
        recordings.of("left-1-1")


@pytest.mark.slow
def test_examples_of_page_run_in_plain_script(tmp_path, prefect_home):
    examples = re.findall(r"^```python\n(.*?)^```$", EXAMPLES.read_text(), re.MULTILINE | re.DOTALL)
    assert len(examples) >= 5
    shutil.copytree(ROOT / "campaigns" / "quickstart", tmp_path / "campaigns" / "quickstart")
    (tmp_path / "examples.py").write_text("\n".join(examples))
    home = {"PREFECT_HOME": str(prefect_home(tmp_path / "prefect"))}
    environment = {**os.environ, **home, "VASTFLOW_STORE": str(tmp_path / "store")}
    places = {"cwd": tmp_path, "env": environment}
    done = subprocess.run([sys.executable, "examples.py"], check=False, capture_output=True, text=True, **places)
    assert (done.returncode, done.stderr) == (0, "")
    assert "<quickstart: 12 configurations × 2 runs, judged by success, performance, safety>" in done.stdout
    assert "of 24 runs passed" in done.stdout
