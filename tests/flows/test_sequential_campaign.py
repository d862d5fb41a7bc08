"""Campaigns that stop when classes are decided, with a real Prefect: numbers, order, and files."""

import json
import re
import shutil

import pyarrow.parquet as pq
import pytest
from command_line import called
from planned import planned

from vastflow.flows import execute, instantiate, judge, observe, run_campaign
from vastflow.flows.plan.text import plan_json, plan_text, why_json
from vastflow.flows.results.past import past_of
from vastflow.flows.run import flow_call

pytestmark = [pytest.mark.slow, pytest.mark.timeout(900)]

CAMPAIGN = """
version: 1
metadata: {name: kinds}
configuration:
  - name: kind
    variations:
      - ParameterVariationList: {name: kind, values: KINDS}
execution: {scenario_file: kind.osc, run_files: [kind.sh], runs: RUNS, timeout: 30}
evaluation:
  oracles:
    - own.py:Kind: {}
"""
SCENARIO = """
import osc.helpers

scenario kind:
    timeout(30s)
    kind: string = "passes"
    do serial:
        run_process("sh kind.sh " + kind)
"""
PROGRAM = "printf 'kind\\n%s\\n' \"$1\" > kind.csv\n"
ORACLE = """
from vastflow.oracles.judgment.oracle import Oracle, Parameters


class Kind(Oracle[Parameters]):
    Parameters = Parameters
    metrics = {}

    def judge(self, trace, situation):
        kind, run = str(trace.tables["kind"]["kind"][0]), trace.run.run_index
        if kind == "breaks":
            raise ZeroDivisionError("no verdict")
        if kind == "silent":
            return self.not_judged(trace, "nothing to say")
        good = {"passes": True, "fails": False, "flaky": run % 2 == 0, "open": run % 5 != 4}[kind]
        return self.passed(trace) if good else self.failed(trace, "so it is")
"""
KINDS = ("passes", "fails", "flaky", "open")
ENDS = {"passes": 14, "fails": 14, "flaky": 10, "open": 20}


@pytest.fixture(scope="module")
def place(flow_folder):
    (flow_folder / "campaign").mkdir()
    for name, text in (("kind.osc", SCENARIO), ("kind.sh", PROGRAM), ("own.py", ORACLE)):
        (flow_folder / "campaign" / name).write_text(text)
    return flow_folder


def file_of(place, runs, kinds=KINDS):
    file = place / "campaign" / "kinds.vast"
    file.write_text(CAMPAIGN.replace("KINDS", json.dumps(list(kinds))).replace("RUNS", runs))
    return file


SEQUENTIAL = "{min: 5, max: 20, stop: {}}"


@pytest.fixture(scope="module")
def run(place):
    def run(runs=SEQUENTIAL, store="store", kinds=KINDS, **options):
        file = file_of(place, runs, kinds)
        return run_campaign(file, results=place / "results", store=place / store, **{"workers": 2, **options})

    return run


@pytest.fixture(scope="module")
def first(run):
    return run()


def metadata_of(result):
    return json.loads((result.directory / "metadata.json").read_text())


def runs_of(result, table="runs"):
    """Kind to how many runs a table has of it; every one from 0 on, once."""
    rows = pq.read_table(result.directory / f"{table}.parquet", columns=["configuration", "run_index"]).to_pylist()
    configurations = pq.read_table(result.directory / "configurations.parquet", columns=["name", "factors"]).to_pylist()
    kinds = {row["name"]: json.loads(row["factors"])["kind"] for row in configurations}
    indices = {}
    for row in sorted({(row["configuration"], row["run_index"]) for row in rows}):
        indices.setdefault(kinds[row[0]], []).append(row[1])
    assert all(found == list(range(len(found))) for found in indices.values())
    return {kind: len(found) for kind, found in indices.items()}


def judgments_of(result):
    """Return the verdict of every oracle on every run; recordings of programs may differ in bytes."""
    rows = pq.read_table(result.directory / "verdicts.parquet").to_pylist()
    return [tuple(row[key] for key in ("configuration", "run_index", "oracle", "judgment")) for row in rows]


def content(result):
    """Return a directory's files on its runs, byte for byte."""
    parts = ("recordings/", "traces/", "runs.", "verdicts.", "evidence")
    files = [(file, file.relative_to(result.directory).as_posix()) for file in sorted(result.directory.rglob("*"))]
    return {name: file.read_bytes() for file, name in files if file.is_file() and name.startswith(parts)}


def test_sequential_campaign_ends_where_the_rule_decides(first):
    assert first.faults == ()
    assert runs_of(first) == runs_of(first, "verdicts") == ENDS
    assert (first.summary.runs, first.summary.executed, first.summary.reused) == (58, 58, 0)
    assert first.summary.passed + first.summary.failed == 58
    said = metadata_of(first)
    assert said["sequential"] == {"min": 5, "max": 20, "error": 0.05, "systematic": 0.2, "reliable": 0.8}
    assert (said["asked"]["runs"], said["counts"]["runs"]) == (20, 58)
    past = past_of(first.directory)
    assert ([past.runs_of(name) for name in past.by_name], past.runs) == (list(ENDS.values()), 20)


def test_runs_of_fixed_campaign_are_reused(first, run, monkeypatch):
    fixed = run("20", store="fixed")
    assert (fixed.summary.runs, fixed.summary.executed) == (80, 80)
    assert "sequential" not in metadata_of(fixed)
    events = [json.loads(line) for line in (fixed.directory / "events.jsonl").read_text().splitlines()]
    own = [each["event"] for each in events if each.get("configuration") == "kind-1"]
    assert own[:3] == ["executed", "verdicts", "executed"], "a unit of runs is judged before the next ends"
    with monkeypatch.context() as patch:
        patch.setattr(flow_call.FlowCall, "run", lambda *_: pytest.fail("Prefect was started"))
        ended = run(store="fixed")
    assert (ended.summary.executed, ended.summary.reused, ended.summary.runs) == (0, 58, 58)
    assert judgments_of(ended) == judgments_of(first)
    assert runs_of(ended) == ENDS


def test_larger_maximum_adds_runs_and_smaller_one_none(run, first):
    larger = run("{min: 5, max: 40, stop: {}}")
    ends = runs_of(larger)
    assert ends["open"] > 20 and all(ends[kind] >= ENDS[kind] for kind in KINDS)
    assert larger.summary.executed == sum(ends.values()) - 58
    smaller = run()
    assert smaller.summary.executed == 0
    assert content(smaller) == content(first)


def test_unjudged_configuration_has_maximum_of_runs(run):
    found = run(store="faulty", kinds=("silent", "breaks"))
    assert runs_of(found, "verdicts") == {"silent": 20, "breaks": 10}
    assert {fault.configuration for fault in found.faults} == {"kind-2"}
    assert found.summary.not_judged == found.summary.runs


def test_plan_of_sequential_campaign_is_an_upper_bound(place, run, first):
    options = {"results": place / "results"}
    file = file_of(place, SEQUENTIAL)
    untouched = planned(file, store=str(place / "nothing"), **options)
    assert (untouched.computed("execute"), untouched.least) == (80, 5)
    assert any("less may be computed" in str(part) for part in plan_text(untouched))
    decided = planned(file, store=str(place / "store"), **options)
    assert (decided.computed("execute"), decided.found("judge"), decided.due) == (0, 58, [])
    assert plan_json(decided, str(file))["at_most"] is True
    fixed = planned(file, runs=2, store=str(place / "store"), **options)
    assert (fixed.found("judge"), fixed.least) == (8, None)


def test_runs_that_a_rule_may_ask_for_are_open_and_have_no_cause(place, first):
    shutil.copytree(first.directory, place / "results of first" / first.directory.name)  # of no other test
    options = {"results": place / "results of first", "store": str(place / "store")}
    file = file_of(place, SEQUENTIAL)
    fresh = why_json(planned(file, results=place / "no results", store=str(place / "nothing")))
    said = {each["kind"]: (each["computed"], each["reason"]) for each in fresh if each["stage"] == "execute"}
    assert said["never computed"][0] + said["open"][0] == 80
    assert said["open"][1] == f"open until judged, at most {said['open'][0]}"
    own = place / "campaign" / "own.py"
    try:
        own.write_text(ORACLE.replace("so it is", "so it was"))
        (execute, *_, judge) = (each for each in why_json(planned(file, **options)) if each["kind"] != "follows")
    finally:
        own.write_text(ORACLE)
    open_runs = execute["computed"]  # of the 22 that no call has asked for, less what other tests have
    assert (execute["kind"], execute["reason"]) == ("open", f"open until judged again, at most {open_runs}")
    assert 0 < open_runs <= 22
    assert (judge["stage"], judge["kind"], judge["computed"]) == ("judge", "source changed", 80 - open_runs)


def test_run_of_directory_uses_the_same_rule(place, first, no_prefect, capsys):
    answer = called("run", first.directory, "--store", place / "store")
    assert answer.exit_code == 0, answer.output
    assert "20 runs of each configuration at most" in answer.output
    assert re.search(r"58 runs of at most 80, 22 saved", answer.output)


def test_staged_execute_stops_after_as_many_runs_as_the_campaign(place, first, tmp_path):
    configurations = instantiate(file_of(place, SEQUENTIAL), store=tmp_path / "store", workers=2)
    recordings = execute(configurations, workers=2)
    assert {configurations[name].factors["kind"]: len(recordings.of(name)) for name in recordings.names} == ENDS
    assert repr(recordings) == "<kinds: 4 configurations × 20 runs at most, 58 recorded>"
    assert recordings.table().num_rows == 58
    verdicts = judge(observe(recordings))
    theirs = pq.read_table(first.directory / "verdicts.parquet")
    assert verdicts.table().drop_columns("metrics").equals(theirs.drop_columns("metrics"))  # times of programs differ
    assert execute(configurations).blocks == recordings.blocks
    assert len(execute(configurations, runs=6, only="kind-1", workers=2).of("kind-1")) == 6


def test_forced_campaign_stops_after_as_many_runs_as_before(run, first):
    again = run(force="execute")
    assert again.summary.executed == again.summary.runs == first.summary.runs == sum(ENDS.values())
