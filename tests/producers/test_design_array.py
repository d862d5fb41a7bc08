"""Covering arrays: complete, admissible, small."""

import itertools

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from vastflow.producers.designs.covering_array import (
    admissible_tuples,
    covering_array,
    designed_factors,
    lower_bound,
)
from vastflow.producers.designs.space import FactorBlock, TooLarge


def free(counts):
    return [FactorBlock((i,), np.arange(n, dtype=np.int64).reshape(-1, 1)) for i, n in enumerate(counts)]


def rows_of(blocks):
    """Every admissible row, the plainest way."""
    found = []
    for parts in itertools.product(*(block.table.tolist() for block in blocks)):
        levels = {
            f: level
            for block, part in zip(blocks, parts, strict=True)
            for f, level in zip(block.factors, part, strict=True)
        }
        found.append(tuple(levels[f] for f in sorted(levels)))
    return found


@st.composite
def spaces(draw):
    counts = draw(st.lists(st.integers(1, 4), min_size=1, max_size=5))
    apart = draw(st.permutations(range(len(counts))))
    cut = draw(st.integers(1, len(counts)))
    blocks = []
    for factors in filter(None, (sorted(apart[:cut]), sorted(apart[cut:]))):
        every = list(itertools.product(*(range(counts[f]) for f in factors)))
        kept = [levels for levels in every if draw(st.integers(0, 2)) > 0]
        blocks.append(FactorBlock(tuple(factors), np.array(kept, dtype=np.int64).reshape(len(kept), len(factors))))
    return sorted(blocks, key=lambda block: block.factors), counts


@settings(deadline=None, max_examples=60)
@given(spaces(), st.integers(1, 4))
def test_covering_array_is_admissible_and_complete(space, strength):
    blocks, counts = space
    rows = list(map(tuple, covering_array(blocks, counts, strength).tolist()))
    every = rows_of(blocks)
    assert set(rows) <= set(every)
    assert len(set(rows)) == len(rows)
    for combo in itertools.combinations(range(len(counts)), min(strength, len(counts))):
        assert {tuple(row[f] for f in combo) for row in rows} == {tuple(row[f] for f in combo) for row in every}


def test_ten_factors_of_four_levels_take_at_most_32_rows(loops):
    found = []
    assert loops(lambda: found.append(covering_array(free([4] * 10), [4] * 10, 2))) < 40
    assert len(found[0]) <= 32


def test_lower_bound_of_free_factors_is_the_product_of_the_largest():
    counts = [2, 5, 3, 4]
    bound = lower_bound(admissible_tuples(free(counts), counts, designed_factors(free(counts)), 2))
    assert bound == 20
    assert len(covering_array(free(counts), counts, 2)) >= bound


def test_strength_of_all_factors_is_the_full_product():
    assert len(covering_array(free([3, 2, 2]), [3, 2, 2], 3)) == 12
    assert len(covering_array(free([3, 1, 2]), [3, 1, 2], 6)) == 6


def test_space_of_one_or_of_no_configuration_is_one_row_or_none():
    assert covering_array(free([1, 1]), [1, 1], 2).tolist() == [[0, 0]]
    assert covering_array([], [], 2).shape == (1, 0)
    assert covering_array([*free([3]), FactorBlock((1,), np.empty((0, 1), np.int64))], [3, 2], 2).shape == (0, 2)


def test_same_space_gives_the_same_rows():
    one, other = (covering_array(free([4, 3, 3, 2]), [4, 3, 3, 2], 2).tolist() for _ in range(2))
    assert one == other


def test_more_tuples_than_can_be_looked_after_are_refused():
    with pytest.raises(TooLarge, match="combinations of 6 choices"):
        covering_array(free([10] * 20), [10] * 20, 6)
