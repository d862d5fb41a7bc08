"""Factors and blocks of configurations."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st
from table import each_row

from vastflow.oracles.results.factors import blocks_of, factors_of

PLACES = [{"static_objects": [{"x": k}] * n, "start_pose": {"x": float(k)}} for n in (0, 2) for k in range(3)]
HEAPS = [wanted + 0.02 * k for wanted in (5.0, 10.0, 30.0) for k in range(10)]


@each_row(
    ("rows", "factors", "dropped"),
    [
        ([], [], []),
        ([{}, {}], [], []),
        ([{"speed": 0.5}, {"speed": 0.5}], [], []),
        # Levels stand in natural order.
        (
            [{"noise": v, "planner": p} for v in (0.1, 0.02, 0.1) for p in ("b", "a")],
            [("noise", ("0.02", "0.1"), [1, 1, 0, 0, 1, 1]), ("planner", ("b", "a"), [0, 1, 0, 1, 0, 1])],
            [],
        ),
        ([{"a": 1}, {"a": 2}, {}], [("a", ("1", "2"), [0, 1, -1])], []),
        # Many numbers are binned at quantiles, or grouped by their gaps.
        (
            [{"drawn": float(v)} for v in range(100)],
            [("drawn", ("0 to 24", "25 to 49", "50 to 74", "75 to 99"), [k // 25 for k in range(100)])],
            [],
        ),
        (
            [{"length": v} for v in HEAPS],
            [("length", ("5 to 5.18", "10 to 10.18", "30 to 30.18"), [k // 10 for k in range(30)])],
            [],
        ),
        (
            PLACES,
            [("number of static_objects", ("0", "2"), [0, 0, 0, 1, 1, 1])],
            [("start_pose", "is a place or a list, and not one of a few values")],
        ),
        ([{"map": {"file": letter * 64}} for letter in "ab"], [("map", ("a" * 12, "b" * 12), [0, 1])], []),
        (
            [{"map": m, "size": {"A": 3, "B": 1}[m]} for m in "ABBA"],
            [("map", ("A", "B"), [0, 1, 1, 0])],
            [("size", "divides the configurations as map does")],
        ),
        ([{"seed": f"s{k}"} for k in range(20)], [], [("seed", "has 20 different values, at most 12 can be compared")]),
        ([{"a": 1}, {}], [], [("a", "has one value where it is given at all")]),
    ],
)
def test_factors_of_finds_levels(rows, factors, dropped):
    found, left = factors_of(rows)
    assert [(each.name, each.levels, each.codes.tolist()) for each in found] == factors
    assert [(each.name, each.reason) for each in left] == dropped


@given(st.lists(st.floats(-1e3, 1e3), min_size=14, max_size=40, unique=True))
def test_factors_of_gives_each_number_a_level_in_order(values):
    (factor,), _ = factors_of([{"drawn": v} for v in values])
    assert 2 <= len(factor.levels) <= 12
    assert factor.codes.min() == 0
    assert (np.diff(factor.codes[np.argsort(values)]) >= 0).all()
    assert factor.values.tolist() == values


def test_factors_of_keeps_finite_numbers_as_values():
    rows = [{"noise": 0.1, "planner": "a"}, {"noise": None, "planner": "a"}, {"noise": 0.2, "planner": "b"}]
    (number, word), _ = factors_of(rows)
    assert word.values is None
    assert np.array_equal(number.values, [0.1, np.nan, 0.2], equal_nan=True)
    (factor,), _ = factors_of([{"range": 1.0}, {"range": 2.0}, {"range": float("inf")}])
    assert (len(factor.levels), factor.values) == (3, None)


def test_blocks_of_join_configurations_with_one_map_and_task():
    def scenario(where, goal, **system):
        return {"environment": {"map_file": {"file": where}, **system}, "task": {"goal": goal}, "system": system}

    blocks = blocks_of([scenario("a", 1), scenario("a", 1, noise=2), scenario("a", 2), scenario("b", 1)])
    assert blocks.tolist() == [0, 0, 1, 2]
    assert len(set(blocks_of([{"environment": {}, "task": {}, "system": {"a": 1}}] * 3).tolist())) == 3
