import numpy as np
import pytest
from scipy.stats import linregress
from table import each_row

from vastflow.oracles.results.factors import factors_of
from vastflow.oracles.statistics.analysis import FactorAnalysis, factor_analysis
from vastflow.oracles.statistics.contrast import contrasts_of
from vastflow.oracles.statistics.margins import trend_of

ONE = np.ones((40, 1))
ALONE = np.arange(40)
RUNS = np.full(40, 20.0)


def analyzed(lengths, failed, runs=20, blocks=None, **others) -> FactorAnalysis:
    rows = [{"length": float(v), **{name: values[k] for name, values in others.items()}} for k, v in enumerate(lengths)]
    found = factor_analysis(factors_of(rows)[0], runs - np.asarray(failed), np.full(len(rows), runs), blocks)
    assert found is not None
    return found


def test_slope_is_that_of_least_squares_and_its_interval_about_as_wide() -> None:
    rng = np.random.default_rng(1)
    lengths = rng.uniform(5, 20, 40)
    rates = 0.02 * lengths + rng.normal(0, 0.05, 40)
    found = trend_of(contrasts_of(rates, ALONE, 999), lengths, ONE, RUNS, 0.05)
    expected = linregress(lengths, rates)
    assert found is not None and found.p_value is not None
    half = (found.change_interval[1] - found.change_interval[0]) / 2
    assert half == pytest.approx(2.02 * expected.stderr * np.ptp(lengths), rel=0.35)  # robust, so not the same
    assert (found.smallest, found.greatest) == (lengths.min(), lengths.max())
    assert found.change == pytest.approx(expected.slope * np.ptp(lengths))


def test_slope_beside_another_factor_is_that_within_its_levels() -> None:
    # Long ways on map B, which is harder by 0.3; a meter costs 0.01 on either.
    lengths = np.r_[np.linspace(5, 15, 20), np.linspace(10, 20, 20)]
    b = np.repeat([0.0, 1.0], 20)
    found = trend_of(contrasts_of(0.3 * b + 0.01 * lengths, ALONE, 999), lengths, np.column_stack((ONE, b)), RUNS, 0.05)
    assert found is not None
    assert found.change == pytest.approx(0.15)
    low, high = found.change_interval
    assert -0.5 < low < 0.15 < high < 0.5  # blocks agree, and say no more than their runs


@each_row("values", [[1.0, 2.0] * 20, [3.0] * 40, [np.nan] * 39 + [1.0]])
def test_of_two_values_or_fewer_there_is_no_trend(values: list[float]) -> None:
    rates = np.linspace(0, 1, 40)
    assert trend_of(contrasts_of(rates, ALONE, 999), np.array(values), ONE, RUNS, 0.05) is None


def test_number_that_follows_from_another_factor_has_no_trend() -> None:
    lengths = np.repeat([5.0, 10.0, 15.0, 20.0], 10)
    others = np.column_stack((ONE, lengths[:, None] == [10.0, 15.0, 20.0]))
    assert trend_of(contrasts_of(np.linspace(0, 1, 40), ALONE, 999), lengths, others, RUNS, 0.05) is None


def test_configurations_without_the_number_are_in_no_trend() -> None:
    lengths = np.r_[np.linspace(5, 15, 30), np.full(10, np.nan)]
    rates = np.r_[0.02 * lengths[:30], np.full(10, 0.9)]
    others = np.column_stack((ONE, np.isnan(lengths)))
    found = trend_of(contrasts_of(rates, ALONE, 999), lengths, others, RUNS, 0.05)
    assert found is not None
    assert found.change == pytest.approx(0.2)


@each_row("failed", [0, 20])
def test_where_all_runs_end_alike_the_trend_is_flat(failed: int) -> None:
    (factor,) = analyzed(np.linspace(5, 20, 24), [failed] * 24).factors
    assert factor.trend is not None
    assert factor.trend.change == pytest.approx(0.0, abs=1e-9)
    assert factor.trend.change_interval[0] < 0 < factor.trend.change_interval[1]
    assert (factor.others.p_value, factor.matters) == (1.0, False)


@pytest.mark.parametrize("blocks", [4, 8])
def test_interval_of_a_total_effect_holds_it_within_100_points(blocks: int) -> None:
    values = np.tile([1.0, 2.0, 3.0], blocks)
    one, runs = np.ones((len(values), 1)), np.full(len(values), 5.0)
    found = trend_of(contrasts_of((values - 1) / 2, np.repeat(np.arange(blocks), 3), 999), values, one, runs, 0.05)
    assert found is not None
    low, high = found.change_interval
    assert -1 <= low < found.change <= high <= 1


def test_rise_over_eight_paths_is_found_where_their_lengths_are_all_different() -> None:
    # Eight blocks of three settings: bins have two blocks each, which show nothing on their own.
    rng = np.random.default_rng(2)
    lengths = np.repeat(np.linspace(5, 26, 8), 3)
    failed = rng.binomial(20, np.clip((lengths - 4) / 25, 0, 1))
    found = analyzed(lengths, failed, blocks=np.repeat(np.arange(8), 3), setting=[0, 1, 2] * 8)
    length = next(factor for factor in found.factors if factor.name == "length")
    assert length.others.shown
    assert length.trend is not None and length.trend.change_interval[0] < 21 / 25 < length.trend.change_interval[1]


def test_tests_of_levels_and_of_the_trend_share_the_error() -> None:
    rng = np.random.default_rng(5)
    lengths, failed = np.repeat([5.0, 10.0, 15.0, 20.0], 10), rng.binomial(20, 0.3, 40)
    (factor,) = analyzed(lengths, failed).factors
    levels = (lengths[:, None] == [10.0, 15.0, 20.0]).astype(float)
    of_levels = contrasts_of(failed / 20, ALONE, 999).test(levels, ONE).p_value
    assert factor.trend is not None and factor.trend.p_value is not None and of_levels is not None
    assert factor.others.p_value == pytest.approx(min(1.0, 2 * min(of_levels, factor.trend.p_value)))
