import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.stats import binomtest

from vastflow.oracles.statistics.intervals import clopper_pearson_intervals, wilson_intervals


@given(st.integers(1, 300), st.floats(0, 1), st.sampled_from([0.8, 0.95, 0.99]))
def test_both_intervals_are_scipys(n: int, share: float, level: float) -> None:
    passed = round(n * share)
    for method, ours in (("wilson", wilson_intervals), ("exact", clopper_pearson_intervals)):
        expected = binomtest(passed, n).proportion_ci(level, method=method)
        assert ours(passed, n, level) == pytest.approx([expected.low, expected.high], abs=1e-9)


def test_exact_interval_is_the_published_one_of_81_in_263_and_of_none_in_20() -> None:
    # R. G. Newcombe, Statistics in Medicine 17 (1998) 857, table I, method 5.
    assert clopper_pearson_intervals([81, 0], [263, 20]) == pytest.approx(
        np.array([[0.2527, 0.3676], [0.0, 0.1684]]), abs=5e-5
    )


def test_without_a_judged_run_both_intervals_know_nothing() -> None:
    assert wilson_intervals([0], [0]).tolist() == [[0.0, 1.0]]
    assert clopper_pearson_intervals([0], [0]).tolist() == [[0.0, 1.0]]


def test_where_all_pass_or_all_fail_the_exact_interval_ends_at_one_or_zero() -> None:
    # (a/2)^(1/n) and 1 - (a/2)^(1/n), by hand.
    assert clopper_pearson_intervals([20, 0], [20, 20]) == pytest.approx(
        np.array([[0.025 ** (1 / 20), 1.0], [0.0, 1 - 0.025 ** (1 / 20)]])
    )


def test_more_passes_than_runs_are_refused_with_the_first_of_them() -> None:
    with pytest.raises(ValueError, match=r"0\.\.n, got 6 of 5"):
        clopper_pearson_intervals([1, 6, 7], [5, 5, 5])


def test_many_configurations_take_one_call() -> None:
    passed, judged = np.arange(5480) % 21, np.full(5480, 20)
    intervals = wilson_intervals(passed, judged)
    assert intervals.shape == (5480, 2)
    assert intervals[7] == pytest.approx(wilson_intervals(7, 20))


def test_published_intervals_of_newcombe_with_few_runs_and_none_passed() -> None:
    # R. G. Newcombe, Statistics in Medicine 17 (1998) 857, table I, methods 3 and 5.
    assert wilson_intervals([15, 0, 1], [148, 20, 29]) == pytest.approx(
        np.array([[0.0624, 0.1605], [0.0, 0.1611], [0.0061, 0.1718]]), abs=5e-5
    )
    assert clopper_pearson_intervals([15, 1], [148, 29]) == pytest.approx(
        np.array([[0.0578, 0.1617], [0.0009, 0.1776]]), abs=5e-5
    )
