"""Samples of a space."""

import numpy as np
import pytest
from table import each_row

from vastflow.producers.campaign_file.sections import Sample
from vastflow.producers.designs.sample import sampled
from vastflow.producers.designs.space import FactorBlock

METHODS = ["lhs", "sobol", "random"]


def free(*counts):
    return [FactorBlock((i,), np.arange(n, dtype=np.int64).reshape(-1, 1)) for i, n in enumerate(counts)]


def rows(blocks, n, **asked):
    return sampled(blocks, n, Sample(**asked))


@each_row("method", METHODS)
def test_sample_has_the_asked_size_and_no_row_twice(method):
    found = rows(free(5, 4, 6, 3), 4, method=method, size=40, seed=3)
    assert found.shape == (40, 4)
    assert len(set(map(tuple, found.tolist()))) == 40
    assert (found >= 0).all() and (found < [5, 4, 6, 3]).all()


@each_row("method", METHODS)
def test_sample_larger_than_the_space_is_the_space(method):
    assert sorted(map(tuple, rows(free(3, 2), 2, method=method, size=100).tolist())) == [
        (i, j) for i in range(3) for j in range(2)
    ]


@each_row("method", METHODS)
def test_seed_decides(method):
    one, again = (rows(free(9, 9, 9), 3, method=method, size=20, seed=1).tolist() for _ in range(2))
    assert one == again
    assert one != rows(free(9, 9, 9), 3, method=method, size=20, seed=2).tolist()


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


def test_space_too_large_to_list_is_sampled_at_once():
    found = rows(free(*[10] * 25), 25, method="sobol", size=100)
    assert found.shape == (100, 25)
