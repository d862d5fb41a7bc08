"""Criteria that separate nothing."""

import json

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
from table import each_row

from vastflow.oracles.evidence.criteria import criteria_json, criteria_of
from vastflow.oracles.figures.rate_figure import threshold_figure
from vastflow.oracles.page.words import criterion_text
from vastflow.oracles.results.tables import read_tables


def directory(tmp_path, oracles, parameters=None):
    """A campaign directory of one configuration: oracle to a judgement and the values of metrics in m for each run."""
    content = {"environment": {}, "task": {}, "system": {}}
    row = {"name": "a", "family": "f", "duplicate_of": None, "environment": None, "abstract": "x"}
    row |= {"scenario": json.dumps(content), "factors": "{}", "provenance": "{}"}
    verdicts = [
        {
            "configuration": "a",
            "family": "f",
            "run_index": k,
            "oracle": oracle,
            "judgement": judgement,
            "reason": "",
            "metrics": json.dumps({name: {"value": value, "unit": "m"} for name, value in metrics.items()}),
        }
        for oracle, runs in oracles.items()
        for k, (judgement, metrics) in enumerate(runs)
    ]
    runs = [{"configuration": "a", "family": "f", "run_index": 0, "outcome": "succeeded", "reason": ""}]
    schema = pa.schema([*((name, pa.string()) for name in row)])
    pq.write_table(pa.Table.from_pylist([row], schema), tmp_path / "configurations.parquet")
    pq.write_table(pa.Table.from_pylist(verdicts), tmp_path / "verdicts.parquet")
    pq.write_table(pa.Table.from_pylist(runs), tmp_path / "runs.parquet")
    pq.write_table(pa.Table.from_pylist([], pa.schema([("family", pa.string())])), tmp_path / "rejections.parquet")
    (tmp_path / "campaign.vast").write_text("version: 1\n")
    said = [{"name": name, "parameters": values} for name, values in (parameters or {}).items()]
    (tmp_path / "metadata.json").write_text(json.dumps({"name": "a", "created": "now", "oracles": said}))
    return read_tables(tmp_path)


def test_oracle_that_fails_every_run_says_how_far_the_least_is_from_its_threshold(tmp_path):
    runs = [("fail", {"update": value, "threshold": 0.3}) for value in (9.3, 2.57, 40.0)]
    (found,) = criteria_of(directory(tmp_path, {"robustness": runs}, {"robustness": {"basis": "update"}}))
    assert criterion_text(found) == (
        "separates nothing here: all 3 judged runs fail, and the least update is 2.57\xa0m, 8.6 times the threshold"
    )


def test_oracle_that_passes_every_run_says_the_greatest_of_runs_by_their_own_thresholds(tmp_path):
    runs = [("pass", {"rmse": 0.5, "threshold": 1.0}), ("pass", {"rmse": 0.6, "threshold": 4.0})]
    (found,) = criteria_of(directory(tmp_path, {"performance": runs}))
    assert criterion_text(found).endswith("the greatest rmse is 0.5\xa0m, 0.5 times the threshold")


def test_margin_of_any_oracle_is_a_score(tmp_path):
    runs = [("pass", {"margin": 0.4}), ("pass", {"margin": 0.21}), ("not judged", {"margin": None})]
    (found,) = criteria_of(directory(tmp_path, {"mine.py:Mine": runs}))
    assert criterion_text(found) == (
        "separates nothing here: all 2 judged runs pass, and the least margin is 0.21\xa0m; below 0 fails"
    )


def test_oracle_without_a_score_has_the_sentence_alone(tmp_path):
    (found,) = criteria_of(directory(tmp_path, {"success": [("fail", {"time": 3.0})] * 2}))
    assert found.score is None
    assert criterion_text(found) == "separates nothing here: all 2 judged runs fail"
    assert criteria_json([found]) == {"success": {"passed": False, "runs": 2}}


def test_oracle_that_separates_one_that_only_measures_and_one_run_are_left_out(tmp_path):
    passed, failed = ("pass", {"margin": 1.0}), ("fail", {"margin": -1.0})
    oracles = {"safety": [passed, failed], "navigation": [passed, passed], "mine": [passed, ("not judged", {})]}
    assert criteria_of(directory(tmp_path, oracles)) == []


@each_row(("name", "judgement", "values"), [("margin", "pass", (0.2, 0.5)), ("update", "fail", (0.4, 0.8))])
def test_figure_shows_the_share_that_passes_at_each_threshold(tmp_path, name, judgement, values):
    metrics = [{name: value, "threshold": 0.3} for value in values]
    oracle = "safety" if name == "margin" else "robustness"
    tables = directory(tmp_path, {oracle: [(judgement, each) for each in metrics]}, {oracle: {"basis": "update"}})
    (found,) = criteria_of(tables)
    line = threshold_figure(found, found.score).axes[0].lines[0]
    at, rate = np.asarray(line.get_xdata()), np.asarray(line.get_ydata())
    passing = [sum(v >= x for v in values) / 2 if name == "margin" else sum(v <= x for v in values) / 2 for x in at]
    np.testing.assert_allclose(rate, passing)
