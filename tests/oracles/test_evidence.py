"""Rates, findings, criteria that separate nothing, and varying values of configurations."""

import json
from itertools import product
from types import SimpleNamespace

import numpy as np
import pyarrow as pa
import pytest
from hypothesis import given
from hypothesis import strategies as st
from table import each_row

from vastflow.oracles.evidence import findings
from vastflow.oracles.evidence.causes import criteria_json, criteria_of
from vastflow.oracles.evidence.findings import found_text
from vastflow.oracles.evidence.varied import chosen_rows, matched_sets, named, path_property_rows, varied_rows
from vastflow.oracles.figures.charts import threshold_figure
from vastflow.oracles.page.report import write_report
from vastflow.oracles.page.words import criterion_text
from vastflow.oracles.results.factors import factors_of
from vastflow.oracles.results.tables import read_tables
from vastflow.oracles.statistics.analysis import factor_analysis
from vastflow.oracles.statistics.intervals import (
    Counts,
    Interval,
    clopper_pearson_intervals,
    clustered,
    counts_of,
    interval,
    pooled,
)

counted = st.integers(0, 20).flatmap(lambda n: st.integers(0, n).map(lambda x: Counts(x, n - x)))


def test_counts_leave_unjudged_runs_out_of_rates():
    counts = counts_of(["pass", "not judged", "fail", "pass", "not judged"])
    assert (counts, counts.rate) == (Counts(passed=2, failed=1, not_judged=2), pytest.approx(2 / 3))
    assert (Counts(not_judged=5).rate, Counts(not_judged=5).interval) == (None, Interval(0.0, 1.0))
    assert pooled([Counts(1, 2, 3), Counts(4, 5, 6)]) == Counts(5, 7, 9)


SETTINGS = [Counts(9, 1), Counts(8, 2), Counts(1, 9)]


@each_row(
    ("configurations", "blocks", "expected"),
    [
        ([Counts(4, 1), Counts(not_judged=5)], None, None),
        ([*SETTINGS, Counts(2, 8)], [7, 7, 3, 3], clustered([Counts(17, 3), Counts(3, 17)])),
        (SETTINGS, [4, 4, 4], clustered(SETTINGS)),
        ([*SETTINGS[:2], Counts(not_judged=5)], [4, 4, 9], clustered(SETTINGS[:2])),
        ([Counts(20, 0)] * 6, None, interval(clopper_pearson_intervals(6, 6))),
        ([Counts(0, 20)] * 6, None, interval(clopper_pearson_intervals(0, 6))),
    ],
)
def test_clustered_uses_blocks_or_configurations_as_clusters(configurations, blocks, expected):
    assert clustered(configurations, blocks=blocks) == expected


@given(st.lists(counted, min_size=2, max_size=12))
def test_clustered_is_never_narrower_than_interval_of_pooled_runs(clusters):
    whole = pooled(clusters)
    if (found := clustered(clusters)) is not None:
        low, high = clopper_pearson_intervals(whole.passed, whole.judged)
        assert found.low <= low + 1e-9 and high - 1e-9 <= found.high


def said(**parts):
    best = {"configuration": "point-0007", "point": {}, "objective": 0.9, "runs": 10}
    confirmation = {"runs": 60, "samples": [1.0] * 42 + [0.0] * 18, "found": 0.9}
    return {"objective": "failure_rate", "is_rate": True, "best": best, "confirmation": confirmation, **parts}


def beside(as_good):
    best = {"configuration": "random-0003", "point": {}, "objective": 0.4, "runs": 10}
    runs = {"runs": 500, "runs_until_best": 43, "runs_until_as_good": as_good}
    return {"baseline": {"strategy": "random", "best": best, **runs}}


CONFIRMED = "point-0007: failure rate found at 90 %, confirmed at 70 % [56, 82] on 60 fresh runs."


@each_row(
    ("parts", "text"),
    [
        ({}, CONFIRMED),
        ({"confirmation": None}, "point-0007: failure rate found at 90 % on 10 runs, not confirmed."),
        ({"best": None}, "No point was judged."),
        ({"is_rate": False, "objective": "time"}, "point-0007: time found at 0.9. The mean of 60 fresh runs is 0.7."),
        (beside(428), f"{CONFIRMED} Found after 43 runs, by random search after 428."),
        (beside(None), f"{CONFIRMED} Found after 43 runs. Random search comes to 40 % in 500 runs."),
    ],
)
def test_found_text_confirms_best_point(parts, text):
    assert found_text(said(**parts)) == text


TASK = {"start_pose": {"x": 1.0, "y": 2.0}, "goal_pose": {"x": 5.0, "y": 2.0}}
WAY = [(1.0 + 0.1 * i, 2.0) for i in range(41)]


@pytest.fixture
def add(synthetic_campaign, room, build):
    """A function that adds a configuration with so many runs, of which the first fail."""

    def add(name, failed, runs=4, task=TASK, **given):
        outcomes = ["aborted" if i < failed else "succeeded" for i in range(runs)]
        recordings = [build.a_recording(WAY, run_index=i, outcome=outcome) for i, outcome in enumerate(outcomes)]
        synthetic_campaign.add(name, name.split("-")[0], room, task, recordings=recordings, **given)

    return add


def test_findings_compare_families_with_same_keys(synthetic_campaign, add):
    for k in range(12):
        add(f"{('east', 'west')[k % 2]}-{k}", 4 * (k // 2 % 2), factors={"noise": (0.0, 0.4)[k // 2 % 2]})
    for k in range(2):
        add(f"other-{k}", k, factors={"boxes": k})
    found = findings.findings_of(read_tables(synthetic_campaign.write()))
    assert [design.families for design in found.designs] == [("east", "west"), ("other",)]
    noise, family = found.designs[0].analysis.factors
    assert (noise.name, noise.highest, noise.lowest, noise.difference) == ("noise", "0.4", "0.0", 1.0)
    assert family.name == "family"
    assert findings.shape_of(found) == {"always": 7, "never": 6, "mixed": 1}
    assert (found.total_failures.failures, found.total_failures.of_failures) == (24, 25)
    said = json.loads(json.dumps(findings.findings_json(found), allow_nan=False))
    assert set(said) == {"classes", "total_failures", "dispersion", "factors", "saved"}
    assert said["saved"] is None


def test_requested_length_of_path_is_factor(synthetic_campaign, add):
    for k in range(24):  # longer by 5 m, and with one failure more, each six
        task = {"start_pose": {"x": 1.0, "y": 2.0}, "goal_pose": {"x": 5.0, "y": 1.0 + 0.1 * k}}
        asked = 5.0 * (1 + k // 6)
        noted = {"_path_length": asked + 0.01 * (k % 6), "_requested_goal_pose": {"path_length": asked}}
        add(f"way-{k}", k // 6, task=task, provenance=noted, factors=task)
    (design,) = findings.findings_of(read_tables(synthetic_campaign.write())).designs
    (factor,) = design.analysis.factors
    assert (factor.name, factor.these.p_value, factor.others.shown) == ("path_length", None, True)
    assert [level.level for level in factor.levels] == ["5.0", "10.0", "15.0", "20.0"]
    assert factor.trend.change == pytest.approx(0.75, abs=1e-3)


def test_matched_sets_have_first_runs_of_stopped_campaign(synthetic_campaign, add):
    for radius, runs, failed in ((0.2, 4, 0), (0.4, 12, 3)):
        given = {"robot_radius": radius}
        add(f"r-{radius}", failed, runs, factors=given, system=given)
    synthetic_campaign.metadata["sequential"] = {"min": 4, "max": 12}
    (design,) = findings.findings_of(read_tables(synthetic_campaign.write())).designs
    assert [(level.failed, level.runs) for level in design.analysis.factors[0].levels] == [(0, 4), (3, 4)]


@pytest.fixture
def judged(synthetic_campaign):
    """A function that writes one configuration from oracle to judgment and metrics (m) of each run, and reads its tables."""

    def tables(oracles, parameters=None):
        row = {"name": "a", "family": "f", "abstract": "x", "scenario": "{}", "factors": "{}", "provenance": "{}"}
        synthetic_campaign.configurations = [row]
        synthetic_campaign.verdicts = [
            {
                "configuration": "a",
                "family": "f",
                "run_index": k,
                "oracle": oracle,
                "judgment": judgment,
                "metrics": json.dumps({name: {"value": value, "unit": "m"} for name, value in metrics.items()}),
            }
            for oracle, runs in oracles.items()
            for k, (judgment, metrics) in enumerate(runs)
        ]
        asked = [{"name": name, "parameters": values} for name, values in (parameters or {}).items()]
        synthetic_campaign.metadata = {"oracles": asked}
        return read_tables(synthetic_campaign.write())

    return tables


UPDATES = [("fail", {"update": value, "threshold": 0.3}) for value in (9.3, 2.57, 40.0)]
RMSE = [("pass", {"rmse": 0.5, "threshold": 1.0}), ("pass", {"rmse": 0.6, "threshold": 4.0})]
MARGINS = [("pass", {"margin": 0.4}), ("pass", {"margin": 0.21}), ("not judged", {"margin": None})]


@each_row(
    ("oracle", "runs", "text", "score"),
    [
        ("robustness", UPDATES, "fail, and the least update is 2.57 m, 8.6 times the threshold", ("update", "m", 2.57, 0.3)),
        ("performance", RMSE, "pass, and the greatest rmse is 0.5 m, 0.5 times the threshold", ("rmse", "m", 0.5, 1.0)),
        ("mine.py:Mine", MARGINS, "pass, and the least margin is 0.21 m; below 0 fails", ("margin", "m", 0.21, 0.0)),
        ("success", [("fail", {"time": 3.0})] * 2, "fail", ()),
    ],
)  # fmt: skip
def test_criterion_names_nearest_score(judged, oracle, runs, text, score):
    (found,) = criteria_of(judged({oracle: runs}, {oracle: {"basis": "update"}}))
    count = sum(judgment != "not judged" for judgment, _ in runs)
    assert criterion_text(found).replace("\xa0", " ") == f"separates nothing here: all {count} judged runs {text}"
    expected = {"passed": text.startswith("pass"), "runs": count}
    expected |= dict(zip(("metric", "unit", "nearest", "threshold"), score, strict=False))
    assert criteria_json([found]) == {oracle: expected}


def test_criteria_leave_out_oracles_that_separate_or_measure(judged):
    passed, failed = ("pass", {"margin": 1.0}), ("fail", {"margin": -1.0})
    oracles = {"safety": [passed, failed], "navigation": [passed, passed], "mine": [passed, ("not judged", {})]}
    assert criteria_of(judged(oracles)) == []


@each_row(("name", "judgment", "values"), [("margin", "pass", (0.2, 0.5)), ("update", "fail", (0.4, 0.8))])
def test_threshold_figure_shows_pass_rates(judged, name, judgment, values):
    oracle = "safety" if name == "margin" else "robustness"
    runs = [(judgment, {name: value, "threshold": 0.3}) for value in values]
    (found,) = criteria_of(judged({oracle: runs}, {oracle: {"basis": "update"}}))
    line = threshold_figure(found, found.score).axes[0].lines[0]
    at, rate = np.asarray(line.get_xdata()), np.asarray(line.get_ydata())
    passing = [sum(v >= x for v in values) / 2 if name == "margin" else sum(v <= x for v in values) / 2 for x in at]
    np.testing.assert_allclose(rate, passing)


MAP = "ab" * 32
NARROW = "narrowest passage (m)"
BOXES = [{"entity_name": "box", "spawn_pose": {"x": 1.0, "y": 1.0}}]


def table_of(*configurations):
    """A table from factors, provenance, the keys that each step wrote, and the content of the scenario."""
    factors, provenances, steps, contents = zip(*configurations, strict=True)
    return SimpleNamespace(
        factors=factors,
        provenances=provenances,
        written=steps,
        contents=contents,
        table=pa.table({"abstract": ["builtin:navigate_to_pose"] * len(factors)}),
    )


def with_boxes(per_m, radius, draw, boxes, start=0.0):
    """A configuration with a path and boxes near it, as producers write it."""
    pose = {"x": start, "y": 0.0}
    noted = {"_requested_start_pose": {"path_length": 6.0}, "_requested_boxes": {"amount_per_m": per_m, "draw": draw}}
    given = {"start_pose": pose, "boxes": boxes, "robot_radius": radius}
    steps = (["start_pose", "_requested_start_pose"], ["boxes", "_requested_boxes"], ["robot_radius"])
    content = {"environment": {"boxes": boxes}, "task": {"start_pose": pose}, "system": {"robot_radius": radius}}
    return given, noted, steps, content


LENGTH = {"_path_length": 5.031370849898476}
WORLD = {"_wall_offset_m": 0.1, "_missing_furniture": 0.0}
TOLD = {"noise": 0.1, "wall offset (m)": 0.1, "missing furniture": 0.0}


@each_row(
    ("configuration", "row"),
    [
        (with_boxes(0.6, 0.2, 1, [{"x": 1.0}]), {"path_length": 6.0, "amount_per_m": 0.6, "robot_radius": 0.2}),
        (
            ({"map_file": {"file": MAP}, "mesh": {"file": "cd" * 32}}, {}, (), {}),
            {"map_file": "office", "mesh": "cd" * 4},
        ),
        (({"noise": 0.1}, LENGTH, (), {}), {"noise": 0.1}),  # a drawn length is no factor
        (({"noise": 0.1, "world": {"seed": 5, "wall_offset": 0.1}}, WORLD, (), {}), TOLD),
        (({"noise": 0.1}, WORLD | {"_wall_offset_m": 0.0}, (), {}), TOLD | {"wall offset (m)": 0.0}),
        (({"world": {"seed": 5}}, {}, (), {}), {"world": {"seed": 5}}),
    ],
)
def test_chosen_rows_name_draws_by_requested_values(configuration, row):
    assert chosen_rows(table_of(configuration), [0], {MAP: "office"}) == [row]


def test_varied_rows_add_drawn_length_and_names_of_files():
    assert varied_rows(table_of(({"noise": 0.1}, LENGTH, (), {})), [0], {}) == [{"noise": 0.1, "path length (m)": 5.03}]
    known = {"abcdef0123": "office"}
    assert named({"file": "abcdef0123"}, known) == "office"
    assert (named({"file": "abcdef0123"}, {}), named(0.4, {})) == ("abcdef01", 0.4)


def test_matched_sets_are_equal_in_all_but_factor_and_its_draws():
    one, two = [{"x": 1.0}], [{"x": 1.0}, {"x": 2.0}]
    table = table_of(
        with_boxes(0.6, 0.2, 1, one), with_boxes(0.9, 0.2, 1, two), with_boxes(0.6, 0.3, 1, one),
        with_boxes(0.9, 0.2, 2, two[:1]), with_boxes(0.6, 0.2, 1, one, start=1.0),
    )  # fmt: skip
    assert matched_sets(table, range(5), "amount_per_m").tolist() == [0, 0, 1, 2, 3]
    assert matched_sets(table, range(5), "robot_radius").tolist() == [0, 1, 0, 2, 3]
    assert len(set(matched_sets(table, [0, 4], "path_length").tolist())) == 2  # poses differ


WIDE, GIVEN = {"_narrowest_passage_m": 2.0}, {"static_objects": BOXES}
MANY = {"_narrowest_passage_m": 0.8131, "_turning_rad": 1.571, "_obstacles_near_path": 0, "_path_length": 5.0}


@each_row(
    ("factors", "noted", "row"),
    [
        ({}, MANY, {NARROW: 0.81, "turning (rad)": 1.57, "obstacles near the path": 0}),
        ({}, {"_narrowest_passage_m": None, "_goal_clearance_m": 0.3}, {"clearance at goal (m)": 0.3}),
        # The path was drawn without obstacles of the file, and with those of producers.
        (GIVEN, WIDE, {}),
        (GIVEN, {**WIDE, "_obstacles": GIVEN}, {NARROW: 2.0}),
    ],
)
def test_path_properties_are_known_with_placed_obstacles(factors, noted, row):
    assert path_property_rows(SimpleNamespace(factors=[factors], provenances=[noted]), [0]) == [row]


def analyzed(seed, harm, seen=True):
    """The analysis of 60 paths with 3 numbers of boxes, where narrow passages fail runs by `harm` a meter."""
    rng, boxes = np.random.default_rng(seed), np.tile([0, 1, 2], 60)
    width_m = np.round(rng.uniform(0.6, 3.0, 180) - 0.2 * boxes, 2)
    clearance_m = np.round(rng.uniform(0.2, 1.0, 180), 2)
    passed = 20 - rng.binomial(20, np.clip(0.2 + harm * (1.8 - width_m), 0.0, 1.0))
    factors, _ = factors_of([{"boxes": int(n)} for n in boxes])
    rows = [{NARROW: float(w), "clearance": float(c)} for w, c in zip(width_m, clearance_m, strict=True)]
    properties = factors_of(rows)[0] if seen else ()
    return factor_analysis(factors, passed, np.full(180, 20), np.repeat(np.arange(60), 3), path_properties=properties)


def test_narrow_passage_is_shown_and_harmless_clearance_is_not():
    narrow, clearance = analyzed(4, 0.2).path_properties
    assert [(each.name, each.others.shown) for each in (narrow, clearance)] == [(NARROW, True), ("clearance", False)]
    assert narrow.trend.change == pytest.approx(-0.2 * (narrow.trend.greatest - narrow.trend.smallest), abs=0.12)
    assert analyzed(5, 0.1).factors == analyzed(5, 0.1, seen=False).factors


def test_harmless_path_properties_are_rarely_shown():
    wrong = sum(any(each.others.shown for each in analyzed(100 + k, 0.0).path_properties) for k in range(60))
    assert wrong <= 7  # of 60 at 5 %, more in 2 % of cases


def test_path_property_confounded_with_factor_has_no_effect():
    factors, _ = factors_of([{"boxes": k % 3} for k in range(30)])
    seen, _ = factors_of([{"obstacles near the path": k % 3} for k in range(30)])
    passed = np.random.default_rng(6).binomial(20, 0.7, 30)
    (found,) = factor_analysis(factors, passed, np.full(30, 20), path_properties=seen).path_properties
    assert (found.others.p_value, found.others.note) == (None, "cannot be told from other factors")
    assert not found.matters


def test_report_names_metric_that_differs_where_no_failure_does(synthetic_campaign, room, build):
    for k, controller in product(range(7), ("dwb", "mppi")):
        task = {"start_pose": {"x": 1.0, "y": 2.0}, "goal_pose": {"x": 5.0, "y": 1.0 + 0.1 * k}}
        way = np.linspace((1.0, 2.0), (5.0, 2.0), 40 if controller == "dwb" else 80 + k)
        runs = [build.a_recording(way, run_index=i) for i in range(3)]
        given = {"controller": controller}
        synthetic_campaign.add(f"{controller}-{k}", "f", room, task, recordings=runs, factors=given, system=given)
    directory = synthetic_campaign.write()
    write_report(directory)
    page = (directory / "report.html").read_text()
    assert "1 factor varied, and none is shown to matter for the failure rate." in page
    assert "controller matters for the time on these 7 paths: mppi 8" in page
    assert "mppi is above dwb in 7 of 7 situations" in page
    (design,) = json.loads((directory / "evidence.json").read_text())["factors"]
    assert [(each["name"], each["metric"], each["these"]["shown"]) for each in design["metrics"]] == [
        ("controller", "time", True)
    ]
