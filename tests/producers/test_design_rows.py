"""Covering arrays are complete, admissible, and small; samples are admissible and of their size."""

import itertools

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from table import each_row

from vastflow.producers.campaign_file.sections import Sample
from vastflow.producers.designs.covering_array import covering_array
from vastflow.producers.designs.space import FactorBlock, TooLarge, sampled


def free(*counts):
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
    assert loops(lambda: found.append(covering_array(free(*[4] * 10), [4] * 10, 2))) < 40
    assert len(found[0]) <= 32


def test_strength_of_all_factors_is_the_full_product():
    assert len(covering_array(free(3, 2, 2), [3, 2, 2], 3)) == 12
    assert len(covering_array(free(3, 1, 2), [3, 1, 2], 6)) == 6


def test_space_of_one_or_of_no_configuration_is_one_row_or_none():
    assert covering_array(free(1, 1), [1, 1], 2).tolist() == [[0, 0]]
    assert covering_array([], [], 2).shape == (1, 0)
    assert covering_array([*free(3), FactorBlock((1,), np.empty((0, 1), np.int64))], [3, 2], 2).shape == (0, 2)


def test_design_with_too_many_tuples_is_refused():
    with pytest.raises(TooLarge, match="combinations of 6 choices"):
        covering_array(free(*[10] * 20), [10] * 20, 6)


METHODS = ["lhs", "sobol", "random"]


def rows(blocks, n, **asked):
    return sampled(blocks, n, Sample(**asked))


@each_row("method", METHODS)
def test_sample_has_asked_size_and_no_row_twice(method):
    found, again, other = (rows(free(5, 4, 6, 3), 4, method=method, size=40, seed=seed).tolist() for seed in (3, 3, 4))
    assert found == again != other
    assert len(found) == len(set(map(tuple, found))) == 40
    assert set(map(tuple, found)) <= set(np.ndindex(5, 4, 6, 3))
    whole = rows(free(3, 2), 2, method=method, size=100).tolist()
    assert sorted(map(tuple, whole)) == list(np.ndindex(3, 2))


def test_latin_hypercube_takes_every_level_equally_often():
    found = rows(free(10, 10, 10), 3, method="lhs", size=50, seed=5)
    assert [np.bincount(column).tolist() for column in found.T] == pytest.approx(np.full((3, 10), 5), abs=1)


@each_row("method", METHODS)
def test_rows_of_a_sample_are_admissible(method):
    table = np.array([(i, j) for i in range(10) for j in range(10) if i < j])
    blocks = [FactorBlock((0, 2), table), FactorBlock((1,), np.arange(4).reshape(-1, 1))]
    found = rows(blocks, 3, method=method, size=60)
    assert len(found) == 60
    assert (found[:, 0] < found[:, 2]).all()
