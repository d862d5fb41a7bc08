"""Campaigns that search: proposals, runs, tables, and that a search is repeated exactly."""

import json
import math
import re
import time

import numpy as np
import pyarrow.parquet as pq
import pytest
from pocket import BATCHES, SCENARIO, computed, file_of
from table import each_row

from vastflow.flows import run_campaign
from vastflow.flows.analysis.failing import failing_configuration
from vastflow.flows.request.run_request import request_of
from vastflow.flows.results.cleaning import DAY_S, clean, cleaning, references
from vastflow.flows.run import flow_call, prepared
from vastflow.flows.run.stored import write_stored
from vastflow.oracles.results.unusable import UnusableDirectory
from vastflow.sim.model.faults import FileError, UserError
from vastflow.tasks.store.store import open_store

pytestmark = pytest.mark.timeout(900)

CALLS = 3 * (12 + 1)
"""Calls of a stage in such a search: three for each point, and three for the confirmed one."""


@pytest.fixture(scope="module")
def place(tmp_path_factory, tree):
    folder = tmp_path_factory.mktemp("pocket")
    (folder / "campaign").mkdir()
    (folder / "campaign" / "pocket.osc").write_text(SCENARIO)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(prepared, "installed_tree", lambda: tree)
        yield folder


@pytest.fixture(scope="module")
def run(place):
    return lambda store="store", workers=2, calls=math.inf, **parts: computed(
        file_of(place, **parts), place, store, workers, calls
    )


@pytest.fixture(scope="module")
def first(run):
    return run()


def found(result):
    return json.loads((result.directory / "metadata.json").read_text())["search"]


def rows(result, table="evaluations"):
    return pq.read_table(result.directory / f"{table}.parquet").to_pylist()


def content(result, table="evaluations"):
    return (result.directory / f"{table}.parquet").read_bytes()


def test_search_runs_batches_until_budget_is_spent_and_confirms_best_by_fresh_runs(first):
    said = found(first)
    assert said["ended_by"] == "batches 3 of 3" and not first.faults
    assert [(row["configuration"], row["batch"], row["runs"]) for row in rows(first)] == [
        (f"point-{k:04}", (k - 1) // 4, 3) for k in range(1, 13)
    ]
    assert said["best"]["objective"] == max(row["objective"] for row in rows(first))
    assert said["confirmation"]["runs"] == 10
    best = said["best"]["configuration"]
    indices = [row["run_index"] for row in rows(first, "runs") if row["configuration"] == best]
    assert sorted(indices) == list(range(13))
    assert first.summary.runs == 12 * 3 + 10


@pytest.mark.slow
def test_flow_finds_same_and_repeats_nothing(place, first, prefect_home, monkeypatch):
    monkeypatch.setenv("PREFECT_HOME", str(prefect_home(place / "prefect")))
    monkeypatch.delenv("PREFECT_API_URL", raising=False)

    def called():
        return run_campaign(file_of(place), results=place / "results", store=place / "by_flow", workers=2)

    assert content(called()) == content(first)

    monkeypatch.setattr(flow_call.FlowCall, "run", lambda *_: pytest.fail("Prefect was started"))
    again = called()
    assert again.summary.executed == 0 and content(again) == content(first)


def test_greater_budget_continues_smaller_one(run, first):
    more = run(more="  budget: [{batches: 4}]")
    assert rows(more)[:12] == rows(first)
    new = [row["configuration"] for row in rows(more)[12:]]
    assert new == [f"point-{k:04}" for k in range(13, 17)]
    confirming = 0 if found(more)["best"] == found(first)["best"] else 10
    assert more.summary.executed == 4 * 3 + confirming


ARCHIVE = "{archive: {measures: {x: {low: 1, high: 11, bins: 5}, n: {low: -0.5, high: 3.5, bins: 4}}}}"


@pytest.mark.slow
@pytest.mark.parametrize(
    ("library", "strategy", "parameters"),
    [("numpy", "random", "{}"), ("optuna", "optuna", "{n_startup_trials: 4}"), ("ribs", "qd", ARCHIVE)],
)
def test_interrupted_search_finds_same(run, library, strategy, parameters):
    pytest.importorskip(library)
    more = f"{BATCHES}\n  strategy_parameters: {parameters}"
    file = {"more": more, "strategy": strategy, "objective": "badness"}
    whole = run(**file)
    left = CALLS - 1 - 2 * 5  # a point that was executed is judged, and is not asked for again after an interruption
    places = np.sort(np.random.default_rng(3).choice(left, size=5, replace=False)) + 1
    for k, calls in enumerate(np.diff(places, prepend=0)):
        with pytest.raises(KeyboardInterrupt):
            run(store=f"interrupted {strategy}", workers=1 + k % 2, calls=calls, **file)
    again = run(store=f"interrupted {strategy}", workers=1, **file)
    assert content(again) == content(whole)
    if strategy == "qd":
        assert content(again, "archive") == content(whole, "archive")
        cells, told = rows(whole, "archive"), {row["configuration"]: json.loads(row["point"]) for row in rows(whole)}
        places, points = [json.loads(row["cell"]) for row in cells], [told[row["configuration"]] for row in cells]
        assert places == sorted(places) == [[int((point["x"] - 1) / 2), point["n"]] for point in points]


def test_point_without_robot_cannot_be_minimized(first):
    best = found(first)["best"]
    with pytest.raises(UnusableDirectory, match=f"{best['configuration']} can't be minimized: it has no map"):
        failing_configuration(first.directory, best["configuration"], None, 0.1)


def test_points_that_cannot_be_built_cost_no_runs_and_count(run):
    result = run(limit=6)
    excluded = [row for row in rows(result) if row["standing"] == "rejected"]
    assert {row["reason"] for row in excluded} == {"the constraint short excludes it"}
    assert all(row["runs"] == 0 and row["objective"] is None for row in excluded)
    assert all(json.loads(row["point"])["x"] >= 6 for row in excluded)
    result = run(limit=-1, more="  budget: [{runs: 100}]\n  max_proposals: 10")
    assert found(result)["ended_by"] == "proposals 10 of 10" and found(result)["best"] is None
    assert result.summary.runs == 0


def test_baseline_has_equal_points_and_leaves_search_unchanged(run, first):
    both = run(more=f"{BATCHES}\n  baseline: random")
    assert content(both) == content(first) and "baseline" not in found(first)
    beside = rows(both, "baseline")
    assert [row["configuration"] for row in beside] == [f"random-{k:04}" for k in range(1, 13)]
    assert {row["point"] for row in beside}.isdisjoint(row["point"] for row in rows(both))
    assert both.summary.executed == 12 * 3
    told = found(both)["baseline"]
    best = max(row["objective"] for row in beside)
    assert (told["runs"], told["best"]["objective"]) == (36, best)
    as_good = [3 * k for k, row in enumerate(beside, 1) if row["objective"] >= found(both)["best"]["objective"]]
    assert told["runs_until_as_good"] == (as_good[0] if as_good else None)
    assert {row["family"] for row in rows(both, "configurations")} == {"search", "random"}
    judged = json.loads((both.directory / "evidence.json").read_text())["all_oracles"]
    assert judged["campaign"]["clustered"] is None and judged["families"]["search"]["clustered"] is None
    assert judged["families"]["random"]["clustered"] is not None


def test_points_of_running_search_are_written_from_store(place, run):
    with pytest.raises(KeyboardInterrupt):
        run(store="half", calls=3 * 5)
    # The time of the process that writes them ends no search, and is not stored.
    file = file_of(place, more="  budget: [{time: 0.001}]")
    request = request_of(file, {"results": place / "points", "store": place / "half", "workers": 1})
    for point in ("point-0001", "point-0005"):
        written = write_stored(request, point, 2)
        assert [(row["configuration"], row["run_index"]) for row in rows(written, "runs")] == [(point, 0), (point, 1)]
        assert [row["name"] for row in rows(written, "configurations")] == [point]
    with pytest.raises(UserError, match="not all of these runs are judged yet"):
        write_stored(request, "point-0006", 1)
    assert "search" not in {each.stage for each in open_store(str(place / "half")).holdings()}


@pytest.mark.slow
def test_search_ends_with_faults_after_second_try(run):
    result = run(broken="True", store="broken")
    assert found(result)["ended_by"] == "a point broke twice"
    assert {fault.configuration for fault in result.faults} == {f"point-{k:04}" for k in range(1, 5)}
    assert rows(result) == []
    repaired = run(store="broken")
    assert repaired.faults == () and len(rows(repaired)) == 12


def test_batches_that_fit_time_are_repeated_and_survive_gc(place, run):
    timed = run(store="timed", more="  budget: [{time: 0.01}]")
    assert found(timed)["batches"] == 1
    store = open_store(str(place / "timed"))
    store.refresh()
    clean(store, cleaning(store, references(store, [timed.directory]), DAY_S, time.time() + 30 * DAY_S))
    again = run(store="timed", more="  budget: [{time: 0.01}]")
    assert again.summary.executed == 0 and content(again) == content(timed)
    assert "search" in {each.stage for each in store.holdings()}
    clean(store, cleaning(store, None, DAY_S, time.time() + 30 * DAY_S))
    assert store.holdings() == []


def test_metric_of_oracle_is_objective(run):
    result = run(objective="badness")
    assert all(
        row["objective"] == pytest.approx(1 - abs(json.loads(row["point"])["x"] - 7) / 10, abs=0.03)
        for row in rows(result)
    )


@each_row(
    ("oracle", "metric", "only", "fault"),
    [
        ("own.py:Pocket", "badness", "point-0001", "search: --only does not go with a search, which proposes"),
        ("safety", "x", None, "search.extract.params.badness.oracle: No oracle 'safety' judges this campaign"),
        ("own.py:Pocket", "bad", None, "badness.metric: No metric 'bad' of oracle own.py:Pocket. Did you mean"),
    ],
)
def test_search_refuses_selection_and_unknown_numbers(place, oracle, metric, only, fault):
    file = file_of(place)
    text = file.read_text().replace("oracle: own.py:Pocket, metric: badness", f"oracle: {oracle}, metric: {metric}")
    file.write_text(text)
    with pytest.raises(FileError, match=re.escape(fault)):
        run_campaign(file, results=place / "results", store=place / "store", only=only)
