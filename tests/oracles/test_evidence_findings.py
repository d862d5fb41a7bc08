"""Findings of a synthetic campaign directory, and criteria that separate nothing."""

import json

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from table import each_row

from vastflow.oracles.evidence.causes import criteria_json, criteria_of
from vastflow.oracles.evidence.findings import findings_json, findings_of, shape_of, stopping_rule
from vastflow.oracles.figures.charts import threshold_figure
from vastflow.oracles.page.words import criterion_text
from vastflow.oracles.results.tables import read_tables

TASK = {"start_pose": {"x": 1.0, "y": 2.0}, "goal_pose": {"x": 5.0, "y": 2.0}}
WAY = [(1.0 + 0.1 * i, 2.0) for i in range(41)]


@pytest.fixture
def found(synthetic_campaign, tmp_path, build):
    """Twelve configurations of two families with the same keys, where noise does harm; and one family with others."""
    room = build.write_map(tmp_path / "room", build.walled_room(6.0, 4.0))

    def add(name, family, factors, failed):
        runs = [build.a_recording(WAY, run_index=i, outcome="aborted" if i < failed else "succeeded") for i in range(4)]
        synthetic_campaign.add(name, family, room, TASK, recordings=runs, factors=factors)

    for k in range(12):
        family = ("east", "west")[k % 2]
        add(f"{family}-{k}", family, {"noise": (0.0, 0.4)[k // 2 % 2]}, 4 * (k // 2 % 2))
    for k in range(2):
        add(f"other-{k}", "other", {"boxes": k}, k)
    return findings_of(read_tables(synthetic_campaign.write()))


def test_findings_compare_families_with_same_keys(found):
    assert [design.families for design in found.designs] == [("east", "west"), ("other",)]
    noise, family = found.designs[0].analysis.factors
    assert (noise.name, noise.highest, noise.lowest, noise.difference) == ("noise", "0.4", "0.0", 1.0)
    assert family.name == "family"
    assert shape_of(found) == {"always": 7, "never": 6, "mixed": 1}
    assert (found.total_failures.failures, found.total_failures.of_failures) == (24, 25)
    said = json.loads(json.dumps(findings_json(found), allow_nan=False))
    assert set(said) == {"classes", "total_failures", "dispersion", "factors", "weighted", "saved"}
    assert (said["weighted"], said["saved"]) == (None, None)


def test_requested_length_of_path_is_factor(synthetic_campaign, tmp_path, build):
    room = build.write_map(tmp_path / "room", build.walled_room(6.0, 4.0))
    for k in range(24):
        task = {"start_pose": {"x": 1.0, "y": 2.0}, "goal_pose": {"x": 5.0, "y": 1.0 + 0.1 * k}}
        failed = k // 6  # of four runs, and longer by 5 m each time
        runs = [build.a_recording(WAY, run_index=i, outcome="aborted" if i < failed else "succeeded") for i in range(4)]
        asked = 5.0 * (1 + k // 6)
        noted = {"_path_length": asked + 0.01 * (k % 6), "_requested_goal_pose": {"path_length": asked}}
        synthetic_campaign.add(f"way-{k}", "way", room, task, recordings=runs, provenance=noted, factors=task)
    (design,) = findings_of(read_tables(synthetic_campaign.write())).designs
    (factor,) = design.analysis.factors
    assert (factor.name, factor.these.p_value, factor.others.shown) == ("path_length", None, True)
    assert [level.level for level in factor.levels] == ["5.0", "10.0", "15.0", "20.0"]
    assert factor.trend is not None
    assert factor.trend.change == pytest.approx(0.75, abs=1e-3)


def test_matched_sets_have_first_runs_of_stopped_campaign(synthetic_campaign, tmp_path, build):
    room = build.write_map(tmp_path / "room", build.walled_room(6.0, 4.0))
    for radius, runs, failed in ((0.2, 4, 0), (0.4, 12, 3)):
        outcomes = ["aborted" if i < failed else "succeeded" for i in range(runs)]
        recordings = [build.a_recording(WAY, run_index=i, outcome=outcome) for i, outcome in enumerate(outcomes)]
        given = {"robot_radius": radius}
        synthetic_campaign.add(f"r-{radius}", "r", room, TASK, recordings=recordings, factors=given, system=given)
    synthetic_campaign.metadata["sequential"] = {"min": 4, "max": 12}
    (design,) = findings_of(read_tables(synthetic_campaign.write())).designs
    assert [(level.failed, level.runs) for level in design.analysis.factors[0].levels] == [(0, 4), (3, 4)]


def test_stopping_rule_is_read_from_metadata():
    rule = stopping_rule({"sequential": {"min": 4, "max": 30, "reliable": 0.9}})
    assert (rule.min_runs, rule.max_runs, rule.bounds.reliable, rule.bounds.systematic) == (4, 30, 0.9, 0.2)
    assert stopping_rule({}) is None


def judged(tmp_path, oracles, parameters=None):
    """The tables of one configuration: oracle to a judgement and the values of metrics in m for each run."""
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
    schemas = {"configurations": pa.schema([(name, pa.string()) for name in row])}
    schemas["rejections"] = pa.schema([("family", pa.string())])
    for name, rows in (("configurations", [row]), ("verdicts", verdicts), ("runs", runs), ("rejections", [])):
        pq.write_table(pa.Table.from_pylist(rows, schemas.get(name)), tmp_path / f"{name}.parquet")
    (tmp_path / "campaign.vast").write_text("version: 1\n")
    said = [{"name": name, "parameters": values} for name, values in (parameters or {}).items()]
    (tmp_path / "metadata.json").write_text(json.dumps({"name": "a", "created": "now", "oracles": said}))
    return read_tables(tmp_path)


UPDATES = [("fail", {"update": value, "threshold": 0.3}) for value in (9.3, 2.57, 40.0)]
RMSE = [("pass", {"rmse": 0.5, "threshold": 1.0}), ("pass", {"rmse": 0.6, "threshold": 4.0})]
MARGINS = [("pass", {"margin": 0.4}), ("pass", {"margin": 0.21}), ("not judged", {"margin": None})]


@each_row(
    ("oracle", "runs", "text", "document"),
    [
        (
            "robustness",
            UPDATES,
            "all 3 judged runs fail, and the least update is 2.57 m, 8.6 times the threshold",
            {"passed": False, "runs": 3, "metric": "update", "unit": "m", "nearest": 2.57, "threshold": 0.3},
        ),
        (
            "performance",
            RMSE,
            "all 2 judged runs pass, and the greatest rmse is 0.5 m, 0.5 times the threshold",
            {"passed": True, "runs": 2, "metric": "rmse", "unit": "m", "nearest": 0.5, "threshold": 1.0},
        ),
        (
            "mine.py:Mine",
            MARGINS,
            "all 2 judged runs pass, and the least margin is 0.21 m; below 0 fails",
            {"passed": True, "runs": 2, "metric": "margin", "unit": "m", "nearest": 0.21, "threshold": 0.0},
        ),
        ("success", [("fail", {"time": 3.0})] * 2, "all 2 judged runs fail", {"passed": False, "runs": 2}),
    ],
)
def test_criterion_names_nearest_score(tmp_path, oracle, runs, text, document):
    (found,) = criteria_of(judged(tmp_path, {oracle: runs}, {oracle: {"basis": "update"}}))
    assert criterion_text(found).replace("\xa0", " ") == f"separates nothing here: {text}"
    assert criteria_json([found]) == {oracle: document}


def test_criteria_leave_out_oracles_that_separate_or_measure(tmp_path):
    passed, failed = ("pass", {"margin": 1.0}), ("fail", {"margin": -1.0})
    oracles = {"safety": [passed, failed], "navigation": [passed, passed], "mine": [passed, ("not judged", {})]}
    assert criteria_of(judged(tmp_path, oracles)) == []


@each_row(("name", "judgement", "values"), [("margin", "pass", (0.2, 0.5)), ("update", "fail", (0.4, 0.8))])
def test_threshold_figure_shows_pass_rates(tmp_path, name, judgement, values):
    oracle = "safety" if name == "margin" else "robustness"
    runs = [(judgement, {name: value, "threshold": 0.3}) for value in values]
    (found,) = criteria_of(judged(tmp_path, {oracle: runs}, {oracle: {"basis": "update"}}))
    line = threshold_figure(found, found.score).axes[0].lines[0]
    at, rate = np.asarray(line.get_xdata()), np.asarray(line.get_ydata())
    passing = [sum(v >= x for v in values) / 2 if name == "margin" else sum(v <= x for v in values) / 2 for x in at]
    np.testing.assert_allclose(rate, passing)
