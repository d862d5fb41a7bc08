"""What surrounds the path, as an explanation of failures."""

from types import SimpleNamespace

import numpy as np
import pytest

from vastflow.oracles.evidence.varied import path_property_rows
from vastflow.oracles.results.factors import factors_of
from vastflow.oracles.statistics.analysis import factor_analysis

NARROW = "narrowest passage (m)"


def rows(factors, provenance):
    return path_property_rows(SimpleNamespace(factors=[factors], provenances=[provenance]), [0])


def test_path_properties_have_names_with_units_and_centimeters():
    found = {"_narrowest_passage_m": 0.8131, "_turning_rad": 1.571, "_obstacles_near_path": 0, "_path_length": 5.0}
    assert rows({}, found) == [{NARROW: 0.81, "turning (rad)": 1.57, "obstacles near the path": 0}]


def test_passage_that_is_none_is_missing():
    assert rows({}, {"_narrowest_passage_m": None, "_goal_clearance_m": 0.3}) == [{"clearance at goal (m)": 0.3}]


def test_with_obstacles_that_the_file_places_path_properties_are_not_known():
    boxes = [{"entity_name": "box", "spawn_pose": {"x": 1.0, "y": 1.0}}]
    assert rows({"static_objects": boxes}, {"_narrowest_passage_m": 2.0}) == [{}]
    noted = {"_narrowest_passage_m": 2.0, "_obstacles": {"static_objects": boxes}}
    assert rows({"static_objects": boxes}, noted) == [{NARROW: 2.0}]


def campaign(rng, harm):
    """60 paths with 3 numbers of boxes each; passages are the narrower the more boxes, and fail runs by `harm` for each meter."""
    boxes = np.tile([0, 1, 2], 60)
    width_m = np.round(rng.uniform(0.6, 3.0, 180) - 0.2 * boxes, 2)
    clearance_m = np.round(rng.uniform(0.2, 1.0, 180), 2)
    rate = np.clip(0.2 + harm * (1.8 - width_m), 0.0, 1.0)
    passed = 20 - rng.binomial(20, rate)
    factors, _ = factors_of([{"boxes": int(n)} for n in boxes])
    seen, _ = factors_of([{NARROW: float(w), "clearance": float(c)} for w, c in zip(width_m, clearance_m, strict=True)])
    return factors, seen, passed, np.repeat(np.arange(60), 3)


def test_narrow_passage_that_fails_runs_is_found_and_a_clearance_that_does_nothing_is_not():
    factors, seen, passed, blocks = campaign(np.random.default_rng(4), 0.2)
    analysis = factor_analysis(factors, passed, np.full(180, 20), blocks, path_properties=seen)
    assert [(each.name, each.others.shown) for each in analysis.path_properties] == [
        (NARROW, True),
        ("clearance", False),
    ]
    trend = analysis.path_properties[0].trend
    assert trend.change == pytest.approx(-0.2 * (trend.greatest - trend.smallest), abs=0.12)


def test_factors_are_told_as_surely_as_without_path_properties():
    factors, seen, passed, blocks = campaign(np.random.default_rng(5), 0.1)
    judged = np.full(180, 20)
    alone = factor_analysis(factors, passed, judged, blocks)
    assert factor_analysis(factors, passed, judged, blocks, path_properties=seen).factors == alone.factors


def test_path_properties_that_do_nothing_are_called_harmful_in_one_campaign_of_twenty_at_most():
    wrong = 0
    for k in range(60):
        factors, seen, passed, blocks = campaign(np.random.default_rng(100 + k), 0.0)
        analysis = factor_analysis(factors, passed, np.full(180, 20), blocks, path_properties=seen)
        wrong += any(each.others.shown for each in analysis.path_properties)
    assert wrong <= 7  # of 60 at 5 %, more in 2 % of cases


def test_what_says_the_same_as_a_factor_cannot_be_told_from_it():
    factors, _ = factors_of([{"boxes": k % 3} for k in range(30)])
    seen, _ = factors_of([{"obstacles near the path": k % 3} for k in range(30)])
    passed = np.random.default_rng(6).binomial(20, 0.7, 30)
    (found,) = factor_analysis(factors, passed, np.full(30, 20), path_properties=seen).path_properties
    assert (found.others.p_value, found.others.note, found.matters) == (
        None,
        "cannot be told from other factors",
        False,
    )
