"""Varying values of configurations: requested, drawn, and properties of paths."""

from types import SimpleNamespace

import numpy as np
import pyarrow as pa
import pytest
from table import each_row

from vastflow.oracles.evidence.varied import chosen_rows, matched_sets, named, path_property_rows, varied_rows
from vastflow.oracles.results.factors import factors_of
from vastflow.oracles.statistics.analysis import factor_analysis

MAP = "ab" * 32
NARROW = "narrowest passage (m)"
BOXES = [{"entity_name": "box", "spawn_pose": {"x": 1.0, "y": 1.0}}]


def table_of(*configurations):
    """A table from factors, provenance, the keys that each step wrote, and the content of the scenario."""
    factors, provenances, steps, contents = zip(*configurations, strict=True)
    return SimpleNamespace(
        factors=factors,
        provenances=provenances,
        steps=[[{"keys": keys} for keys in each] for each in steps],
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
            {"map_file": "office", "mesh": "cdcdcdcd"},
        ),
        (({"noise": 0.1}, LENGTH, (), {}), {"noise": 0.1}),  # a drawn length is no factor
        (({"noise": 0.1, "world": {"seed": 5, "wall_offset": 0.1}}, WORLD, (), {}), TOLD),
        (({"noise": 0.1}, WORLD | {"_wall_offset_m": 0.0}, (), {}), TOLD | {"wall offset (m)": 0.0}),
        (({"world": {"seed": 5}}, {}, (), {}), {"world": {"seed": 5}}),
    ],
)
def test_chosen_rows_tell_draws_by_requested_values(configuration, row):
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


@each_row(
    ("factors", "noted", "row"),
    [
        (
            {},
            {"_narrowest_passage_m": 0.8131, "_turning_rad": 1.571, "_obstacles_near_path": 0, "_path_length": 5.0},
            {NARROW: 0.81, "turning (rad)": 1.57, "obstacles near the path": 0},
        ),
        ({}, {"_narrowest_passage_m": None, "_goal_clearance_m": 0.3}, {"clearance at goal (m)": 0.3}),
        # The path was drawn without obstacles of the file, and with those of producers.
        ({"static_objects": BOXES}, {"_narrowest_passage_m": 2.0}, {}),
        (
            {"static_objects": BOXES},
            {"_narrowest_passage_m": 2.0, "_obstacles": {"static_objects": BOXES}},
            {NARROW: 2.0},
        ),
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


def test_narrow_passage_is_found_and_harmless_clearance_is_not():
    narrow, clearance = analyzed(4, 0.2).path_properties
    assert [(each.name, each.others.shown) for each in (narrow, clearance)] == [(NARROW, True), ("clearance", False)]
    assert narrow.trend.change == pytest.approx(-0.2 * (narrow.trend.greatest - narrow.trend.smallest), abs=0.12)
    assert analyzed(5, 0.1).factors == analyzed(5, 0.1, seen=False).factors


def test_harmless_path_properties_are_rarely_shown():
    wrong = sum(any(each.others.shown for each in analyzed(100 + k, 0.0).path_properties) for k in range(60))
    assert wrong <= 7  # of 60 at 5 %, more in 2 % of cases


def test_path_property_equal_to_factor_cannot_be_told():
    factors, _ = factors_of([{"boxes": k % 3} for k in range(30)])
    seen, _ = factors_of([{"obstacles near the path": k % 3} for k in range(30)])
    passed = np.random.default_rng(6).binomial(20, 0.7, 30)
    (found,) = factor_analysis(factors, passed, np.full(30, 20), path_properties=seen).path_properties
    assert (found.others.p_value, found.others.note) == (None, "cannot be told from other factors")
    assert not found.matters
