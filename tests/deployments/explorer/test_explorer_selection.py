"""Filters as text, and the runs that pass them."""

import numpy as np
import pandas as pd
import pytest
from hypothesis import given
from hypothesis import strategies as st
from table import each_row

from vastflow.oracles.evidence.wide import WIDE_FILE
from vastflow.oracles.query.selection import (
    BadFilter,
    Between,
    Containing,
    ValuesOf,
    format_filter,
    mask_of,
    number_text,
    parse_filter,
    python_of,
    read_run_table,
)

NUMBERS = (-1.5, 0.0, 0.1, 2.0, 1e-7)
TEXTS = ("", "a|b", "a;b", "!", "x=y..z", "<script>", "ü*", "null")


def wide(n=60):
    """A table of runs with missing values in each kind of column."""
    rng = np.random.default_rng(3)

    def texts(levels):
        return pd.Categorical.from_codes(rng.integers(-1, len(levels), n), pd.Index(levels, dtype="string"))

    def missing(values):
        return np.where(rng.random(n) < 0.2, np.nan, values)

    return pd.DataFrame(
        {
            "configuration": pd.Categorical.from_codes(np.arange(n) // 4, [f"c-{k}" for k in range(n // 4)]),
            "family": texts(["a", "b"]),
            "run_index": np.arange(n) % 4,
            "passed": pd.arrays.BooleanArray(rng.random(n) < 0.5, rng.random(n) < 0.2),
            "passed.safety": pd.arrays.BooleanArray(rng.random(n) < 0.5, rng.random(n) < 0.2),
            "safety.margin (m)": missing(rng.choice(NUMBERS, n)),
            "kind; of: <b>": texts(TEXTS),
            "noise": missing(rng.choice(NUMBERS, n)),
        }
    )


@pytest.fixture(scope="module")
def directory(tmp_path_factory):
    folder = tmp_path_factory.mktemp("it's")
    wide().to_parquet(folder / WIDE_FILE, index=False)
    return folder


def conditions(name):
    """Conditions that suit a column of the table."""
    if name in ("safety.margin (m)", "noise", "run_index"):
        ends = st.none() | st.sampled_from(NUMBERS) | st.floats(-3, 3)
        ranges = st.tuples(ends, ends).filter(any_end).map(lambda each: Between(name, *map(unsigned, each)))
        values = st.none() | st.sampled_from(NUMBERS).map(number_text)
        return ranges | some_of(name, values)
    levels = {"passed": ("pass", "fail"), "passed.safety": ("pass", "fail"), "family": ("a", "b", "c")}.get(name, TEXTS)
    found = some_of(name, st.none() | st.sampled_from(levels))
    return (
        found if name.startswith("passed") else found | st.sampled_from(TEXTS).map(lambda part: Containing(name, part))
    )


def any_end(ends):
    return ends != (None, None)


def unsigned(end):
    return None if end is None else end + 0.0


def some_of(name, values):
    ordered = st.sets(values, min_size=1, max_size=4).map(lambda each: sorted(each, key=lambda v: (v is None, v or "")))
    return ordered.map(lambda each: ValuesOf(name, tuple(each)))


def filter_of(conditions):
    return {each.column: each for each in sorted(conditions, key=lambda each: each.column)}


filters = st.lists(st.sampled_from(wide().columns.tolist()), unique=True, max_size=4).flatmap(
    lambda names: st.tuples(*map(conditions, names)).map(filter_of)
)
any_filters = st.lists(st.text(), unique=True, max_size=4).flatmap(
    lambda names: st.tuples(
        *(
            some_of(name, st.none() | st.text())
            | st.text().map(lambda part, name=name: Containing(name, part))
            | st.tuples(*[st.none() | st.floats(allow_nan=False, allow_infinity=False)] * 2)
            .filter(any_end)
            .map(lambda ends, name=name: Between(name, *map(unsigned, ends)))
            for name in names
        )
    ).map(filter_of)
)


@given(any_filters)
def test_filter_is_read_back_from_its_text(chosen):
    assert [*parse_filter(format_filter(chosen)).items()] == [*chosen.items()]


@given(any_filters)
def test_filter_text_is_the_same_for_conditions_in_any_order(chosen):
    parts = format_filter(chosen).split(";")
    assert format_filter(parse_filter(";".join(reversed(parts)))) == format_filter(chosen)


@given(filters)
def test_selection_equals_that_of_its_pandas_program(directory, chosen):
    table = read_run_table(directory)
    mask = mask_of(table, chosen)
    names = {}
    exec(python_of(table, chosen, directory), names)  # noqa: S102
    assert names["selection"].index.tolist() == np.flatnonzero(mask).tolist()


def test_selection_keeps_runs_of_a_factor_value(directory):
    runs = wide()
    mask = mask_of(read_run_table(directory), parse_filter("noise=0.1|!"))
    assert mask.tolist() == (runs["noise"].eq(0.1) | runs["noise"].isna()).tolist()
    assert 0 < mask.sum() < len(runs)


@each_row(
    "text, message",
    [
        ("noise", "expected column=value"),
        ("noise:1", "expected low..high, got '1'"),
        ("noise:a..b", "expected low..high, got 'a..b'"),
        ("noise:..", "expected a range with a finite end"),
        ("noise:nan..", "expected a range with a finite end"),
        ("noise=1;noise=2", "expected one condition for each column, got two"),
        ("nothing=1", "expected a column of this campaign, got 'nothing'"),
        ("family:1..2", "expected values of a text, got a range"),
        ("noise=a", "expected numbers, got a"),
        ("noise*a", "expected a range of numbers"),
    ],
)
def test_wrong_filter_is_refused(directory, text, message):
    with pytest.raises(BadFilter, match=message):
        mask_of(read_run_table(directory), parse_filter(text))
