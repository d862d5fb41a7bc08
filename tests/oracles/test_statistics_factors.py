from typing import Any

import numpy as np
from hypothesis import given
from hypothesis import strategies as st
from table import each_row

from vastflow.oracles.results.factors import blocks_of, factors_of


def test_values_are_levels_in_their_natural_order() -> None:
    factors, dropped = factors_of([{"noise": v, "planner": p} for v in (0.1, 0.02, 0.1) for p in ("b", "a")])
    assert [(f.name, f.levels) for f in factors] == [("noise", ("0.02", "0.1")), ("planner", ("b", "a"))]
    assert factors[0].codes.tolist() == [1, 1, 0, 0, 1, 1]
    assert dropped == []


def test_what_never_varies_is_no_factor() -> None:
    assert factors_of([{"speed": 0.5}, {"speed": 0.5}]) == ([], [])


def test_numbers_of_many_values_are_binned_at_their_quantiles() -> None:
    (factor,), _ = factors_of([{"drawn": float(v)} for v in range(100)])
    assert factor.levels == ("0 to 24", "25 to 49", "50 to 74", "75 to 99")
    assert np.bincount(factor.codes).tolist() == [25, 25, 25, 25]


def test_numbers_that_come_in_heaps_are_a_level_each_heap() -> None:
    lengths = [wanted + 0.02 * k for wanted in (5.0, 10.0, 30.0) for k in range(10)]
    (factor,), _ = factors_of([{"length": v} for v in lengths])
    assert factor.levels == ("5 to 5.18", "10 to 10.18", "30 to 30.18")
    assert np.bincount(factor.codes).tolist() == [10, 10, 10]


@given(st.lists(st.floats(-1e3, 1e3), min_size=14, max_size=40, unique=True))
def test_every_number_has_a_level_and_levels_are_in_order(values: list[float]) -> None:
    (factor,), _ = factors_of([{"drawn": v} for v in values])
    assert 2 <= len(factor.levels) <= 12
    assert factor.codes.min() == 0
    assert (np.diff(factor.codes[np.argsort(values)]) >= 0).all()
    assert factor.values is not None and factor.values.tolist() == values


def test_levels_that_are_no_numbers_have_no_values() -> None:
    (number, word), _ = factors_of(
        [{"noise": 0.1, "planner": "a"}, {"noise": None, "planner": "a"}, {"noise": 0.2, "planner": "b"}]
    )
    assert word.values is None
    assert number.values is not None and np.array_equal(number.values, [0.1, np.nan, 0.2], equal_nan=True)


def test_level_without_end_has_no_place_in_a_trend() -> None:
    (factor,), _ = factors_of([{"range": 1.0}, {"range": 2.0}, {"range": float("inf")}])
    assert (len(factor.levels), factor.values) == (3, None)


def test_words_of_many_kinds_are_dropped_with_their_number() -> None:
    factors, (dropped,) = factors_of([{"seed": f"s{k}"} for k in range(20)])
    assert factors == []
    assert dropped.reason == "has 20 different values, at most 12 can be compared"


def test_obstacles_count_by_their_number_and_places_not_at_all() -> None:
    rows: list[dict[str, Any]] = [
        {"static_objects": [{"x": k}] * n, "start_pose": {"x": float(k)}} for n in (0, 2) for k in range(3)
    ]
    (factor,), (dropped,) = factors_of(rows)
    assert (factor.name, factor.levels) == ("number of static_objects", ("0", "2"))
    assert (dropped.name, dropped.reason) == ("start_pose", "is a place or a list, and not one of a few values")


def test_files_are_levels_by_their_content() -> None:
    (factor,), _ = factors_of([{"map_file": {"file": letter * 64}} for letter in "ab"])
    assert factor.levels == ("a" * 12, "b" * 12)


def test_keys_that_divide_alike_are_one_factor() -> None:
    (factor,), (dropped,) = factors_of([{"map": m, "size": {"A": 3, "B": 1}[m]} for m in "ABBA"])
    assert factor.name == "map"
    assert (dropped.name, dropped.reason) == ("size", "divides the configurations as map does")


def test_configuration_without_the_key_has_no_level() -> None:
    (factor,), _ = factors_of([{"a": 1}, {"a": 2}, {}])
    assert factor.codes.tolist() == [0, 1, -1]


def test_key_with_one_value_where_it_is_given_can_compare_nothing() -> None:
    factors, (dropped,) = factors_of([{"a": 1}, {}])
    assert factors == []
    assert dropped.reason == "has one value where it is given at all"


def test_configurations_on_one_map_with_one_task_are_a_block_whatever_their_obstacles_and_system() -> None:
    def scenario(where: str, goal: int, **system: object) -> dict[str, Any]:
        return {"environment": {"map_file": {"file": where}, **system}, "task": {"goal": goal}, "system": system}

    blocks = blocks_of([scenario("a", 1), scenario("a", 1, noise=2), scenario("a", 2), scenario("b", 1)])
    assert blocks.tolist() == [0, 0, 1, 2]


def test_scenarios_without_map_and_task_are_a_block_each() -> None:
    assert len(set(blocks_of([{"environment": {}, "task": {}, "system": {"a": 1}}] * 3).tolist())) == 3


@each_row("rows", [[], [{}], [{}, {}]])
def test_nothing_has_no_factors(rows: list[dict[str, Any]]) -> None:
    assert factors_of(rows) == ([], [])
