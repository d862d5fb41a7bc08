"""Normal numbers: distribution, tail and streams."""

import numpy as np
import pytest
from scipy import stats
from table import each_row

from vastflow.sim.kernels.numeric import njit
from vastflow.sim.kernels.streams import TAIL, normals, streams_of

N = 1_000_000


@njit
def filled(stream, out):
    normals(stream, out)


def draws(n, seed=1):
    out = np.empty(n)
    filled(streams_of([seed])[0], out)
    return out


@pytest.fixture(scope="module")
def many():
    return draws(N)


def test_numbers_are_normally_distributed(many):
    assert stats.kstest(many, "norm").pvalue > 1e-3


def test_mean_variance_and_fourth_moment_are_a_normal_s(many):
    assert many.mean() == pytest.approx(0.0, abs=5 / np.sqrt(N))
    assert many.var() == pytest.approx(1.0, abs=5 * np.sqrt(2 / N))
    assert (many**4).mean() == pytest.approx(3.0, abs=5 * np.sqrt(96 / N))


@each_row("beyond", [2.0, 3.0, TAIL, 4.0])
@each_row("side", [-1.0, 1.0])
def test_tails_hold_their_share_on_both_sides(many, side, beyond):
    share = stats.norm.sf(beyond)
    assert (side * many > beyond).mean() == pytest.approx(share, abs=5 * np.sqrt(share / N))


def test_successive_numbers_are_independent(many):
    for lag in (1, 2, 3):
        assert np.mean(many[:-lag] * many[lag:]) == pytest.approx(0.0, abs=5 / np.sqrt(N))


def test_stream_goes_on_where_it_stopped():
    stream, whole = streams_of([3])[0], draws(1000, seed=3)
    first, second = np.empty(400), np.empty(600)
    filled(stream, first)
    filled(stream, second)
    np.testing.assert_array_equal(np.concatenate([first, second]), whole)
