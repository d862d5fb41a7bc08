"""The behaviors of a block's runs: they come back as they were, however the runs were cut."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from table import each_row

from vastflow.sim.model.archive import behaviors_below, columns_of, read_behaviors, write_behaviors

TEXTS = st.text(st.characters(exclude_categories=["Cs"]), max_size=9)
TABLES = st.lists(st.tuples(st.floats(allow_nan=False), st.integers(-5, 5), TEXTS), max_size=4)


def table(rows):
    t_s, behavior, names = zip(*rows, strict=True) if rows else ((), (), ())
    return {
        "t_s": np.array(t_s, dtype=float),
        "behavior": np.array(behavior, dtype=int),
        "name": np.array(names, dtype=object),
    }


def rows_of(found):
    return list(zip(*(column.tolist() for column in columns_of(found).values()), strict=True))


def stacked(runs):
    return [(run, *row) for run in sorted(runs) for row in runs[run]]


@given(st.lists(TABLES, min_size=1, max_size=6), st.data())
def test_runs_are_complete_and_ordered_for_any_blocks(tables, data):
    runs = dict(enumerate(tables))
    cuts = data.draw(st.lists(st.sets(st.sampled_from(sorted(runs)), min_size=1), max_size=4))
    wanted = data.draw(st.integers(1, len(runs) + 1))
    blocks = [write_behaviors({run: table(runs[run]) for run in sorted(cut)}) for cut in cuts]
    found = behaviors_below(blocks, wanted)
    there = set().union(*cuts)
    expected = stacked({run: rows for run, rows in runs.items() if run in there and run < wanted})
    assert ([] if found is None else rows_of(found)) == expected


def test_equal_behaviors_have_equal_bytes():
    rows = [(0.5, 1, "drive"), (1.0, 2, "wait")]
    assert write_behaviors({0: table(rows)}) == write_behaviors({0: table(rows)})


@each_row("damaged", [b"", b"PAR1", b"x 12", b"12"])
def test_block_of_wrong_kind_is_refused(damaged):
    with pytest.raises((ValueError, OSError)):
        read_behaviors(damaged)
