"""Random streams of runs, and the distributions of their numbers."""

import math

import numpy as np
import pytest
from scipy import stats
from table import each_row

from vastflow.sim.kernels.numeric import njit
from vastflow.sim.kernels.streams import (
    AMCL,
    LIDAR,
    SUBSYSTEMS,
    TAIL,
    normal_pair,
    normals,
    run_entropy,
    streams_of,
    uniform,
)

DIGEST = "00ff" * 16


def test_streams_of_a_run_are_pinned():
    assert [hex(state) for state in streams_of(run_entropy(0, DIGEST, 0))[:, 0].tolist()] == [
        "0x6eb0dec9e8a52720",
        "0xe78f09fd730e95a0",
        "0xe30f00bcc8520b3e",
        "0xd3e2e01f84ff0fd4",
        "0x49c9ce63094355bf",
        "0x9a610b1b9dbc1151",
    ]


@each_row("other", [(1, DIGEST, 0), (0, "ff00" * 16, 0), (0, DIGEST, 1)])
def test_streams_depend_on_seed_situation_and_run(other):
    assert (streams_of(run_entropy(*other)) != streams_of(run_entropy(0, DIGEST, 0))).all()


def test_subsystems_have_streams_of_their_own():
    states = streams_of(run_entropy(0, DIGEST, 0))
    assert states.shape == (SUBSYSTEMS, 1)
    assert len(np.unique(states)) == SUBSYSTEMS
    before = states[AMCL].copy()
    normal_pair(states[LIDAR])
    assert states[AMCL] == before


def test_uniform_numbers_fill_the_unit_interval_evenly():
    stream = streams_of([1])[0]
    numbers = np.array([uniform(stream) for _ in range(20_000)])
    assert (numbers >= 0).all() and (numbers < 1).all()
    counts = np.histogram(numbers, 20, (0, 1))[0]
    chi_square = ((counts - 1000) ** 2 / 1000).sum()
    assert chi_square < 19 + 5 * math.sqrt(2 * 19)


def test_normal_pairs_are_standard_normal_and_independent():
    stream = streams_of([2])[0]
    pairs = np.array([normal_pair(stream) for _ in range(20_000)])
    n = len(pairs)
    assert np.abs(pairs.mean(axis=0)).max() < 5 / math.sqrt(n)
    assert np.abs(pairs.std(axis=0) - 1).max() < 5 / math.sqrt(2 * n)
    assert abs((pairs[:, 0] * pairs[:, 1]).mean()) < 5 / math.sqrt(n)


@njit
def filled(stream, out):
    normals(stream, out)


def draws(n, seed=1):
    out = np.empty(n)
    filled(streams_of([seed])[0], out)
    return out


def test_normals_are_independent_and_of_the_normal_distribution_to_the_tails():
    n = 1_000_000
    many = draws(n)
    assert stats.kstest(many, "norm").pvalue > 1e-3
    for moment, expected, variance in ((1, 0.0, 1), (2, 1.0, 2), (4, 3.0, 96)):
        assert (many**moment).mean() == pytest.approx(expected, abs=5 * np.sqrt(variance / n))
    for beyond in (2.0, 3.0, TAIL, 4.0):
        share = stats.norm.sf(beyond)
        for side in (-many, many):
            assert (side > beyond).mean() == pytest.approx(share, abs=5 * np.sqrt(share / n))
    for lag in (1, 2, 3):
        assert np.mean(many[:-lag] * many[lag:]) == pytest.approx(0.0, abs=5 / np.sqrt(n))


def test_normals_continue_where_the_stream_stopped():
    stream, whole = streams_of([3])[0], draws(1000, seed=3)
    first, second = np.empty(400), np.empty(600)
    filled(stream, first)
    filled(stream, second)
    np.testing.assert_array_equal(np.concatenate([first, second]), whole)
