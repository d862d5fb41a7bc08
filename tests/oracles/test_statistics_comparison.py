"""Comparison of paired runs, against published tests and by hand."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import binomtest, t
from table import each_row

from vastflow.oracles.results.factors import factors_of
from vastflow.oracles.statistics.comparison import Pairs, by_level, changes, difference, mcnemar


def pairs(*configurations, blocks=None):
    """For each configuration, how many pairs passed both times, only before, only after, never; blocks by configuration."""
    rows = [
        (k, then, now)
        for k, counts in enumerate(configurations)
        for (then, now), times in zip(((1, 1), (1, 0), (0, 1), (0, 0)), counts, strict=True)
        for _ in range(times)
    ]
    number, before, after = np.array(rows, dtype=np.int64).reshape(-1, 3).T
    return Pairs(number, before == 1, after == 1, None if blocks is None else np.array(blocks)[number])


@each_row(
    ("lost", "gained", "p_value", "within"),
    [
        (150, 86, 3.716e-5, 5e-9),  # approval ratings: A. Agresti, Categorical Data Analysis, table 10.1
        (1, 7, 0.0703, 5e-5),  # Fagerland, Lydersen and Laake 2013
        (0, 0, 1.0, 0.0),
        (3, 3, 1.0, 0.0),
    ],
)
def test_mcnemar_is_published_exact_test(lost, gained, p_value, within):
    assert mcnemar(lost, gained) == pytest.approx(p_value, abs=within)


@each_row("target", ["these", "others"])
def test_difference_of_approval_ratings_has_published_interval(target):
    # Agresti: -0.04 with a standard error of 0.0095, -0.059 to -0.021; each person is a path of its own.
    said = difference(
        pairs(*[(1, 0, 0, 0)] * 794, *[(0, 1, 0, 0)] * 150, *[(0, 0, 1, 0)] * 86, *[(0, 0, 0, 1)] * 570), target
    )
    assert said.difference == pytest.approx(-0.04)
    assert said.interval == pytest.approx((-0.059, -0.021), abs=1e-3)


def test_difference_counts_paths_once_for_others_and_pairs_for_these():
    # One of four paths lost all: for others, the exact interval of one in four; for these, that of ten in forty.
    lost = pairs((0, 10, 0, 0), *[(10, 0, 0, 0)] * 3)
    for target, ends in (("others", binomtest(1, 4)), ("these", binomtest(10, 40))):
        found = difference(lost, target)
        assert (found.difference, found.interval[0]) == (
            -0.25,
            pytest.approx(-ends.proportion_ci(0.95, "exact").high, abs=1e-6),
        )
    # D = -1/4, deviations -7.5, 2.5, 2.5, 2.5: V = 4/3 · 75 / 1600 = 1/16, t with 3 degrees of freedom.
    found = difference(lost)
    assert (found.p_value, found.mcnemar) == (pytest.approx(2 * float(t.sf(1.0, 3))), pytest.approx(2 / 2**10))
    said = difference(pairs(*[(10, 0, 0, 0)] * 3, (0, 10, 0, 0), blocks=[0, 0, 0, 1]), "others")
    assert (said.difference, said.paths) == (-0.5, 2)


def test_difference_has_blocks_as_clusters():
    # Two settings on each of four paths; on one path both lost all: the same as four configurations of twenty pairs.
    blocked = difference(pairs(*[(0, 10, 0, 0)] * 2, *[(10, 0, 0, 0)] * 6, blocks=np.arange(8) // 2), "others")
    alone = difference(pairs((0, 20, 0, 0), *[(20, 0, 0, 0)] * 3), "others")
    assert (blocked.interval, blocked.p_value, blocked.configurations) == (alone.interval, alone.p_value, 8)
    # On a single path configurations are the clusters, and other paths are unknown.
    counts = (5, 5, 0, 0), (10, 0, 0, 0), (8, 2, 0, 0)
    one_path = pairs(*counts, blocks=[0, 0, 0])
    assert replace(difference(one_path), paths=3) == difference(pairs(*counts))
    assert np.ptp(difference(one_path, "others").interval) > 1.0
    assert set(pairs(*counts, blocks=[7, 8, 9]).of(pairs(*counts).configuration == 1).block) == {8}


def test_difference_without_changes_rules_out_large_losses_alone():
    found = difference(pairs(*[(10, 0, 0, 0)] * 10))
    assert found.interval == pytest.approx((0.025**0.01 - 1, 1 - 0.025**0.01), abs=1e-6)
    assert [found.non_inferior(margin) for margin in (0.037, 0.036, -found.interval[0])] == [True, False, False]
    one = difference(pairs((5, 5, 0, 10)))
    assert (one.configurations, one.p_value, one.mcnemar) == (1, None, pytest.approx(2 / 2**5))
    assert (difference(pairs()), changes(pairs())) == (None, [])


def test_changes_show_newly_failing_configurations_first():
    found = changes(pairs((18, 1, 1, 0), (0, 20, 0, 0), (20, 0, 0, 0), (5, 0, 15, 0)))
    said = [(one.configuration, one.shown, one.worse) for one in found]
    assert said == [(1, True, True), (3, True, False), (0, False, False)]
    assert (found[0].before, found[0].after, found[0].pairs) == (20, 0, 20)
    assert found[0].p_value == pytest.approx(binomtest(20, 20).pvalue)
    (five,) = changes(pairs((0, 5, 0, 0)))
    assert (five.shown, five.adjusted) == (False, 1.0)


def test_changes_are_adjusted_over_configurations_that_can_show_any():
    # Three of six discordant pairs, p = 2/64, and one of twenty: Benjamini and Hochberg over four.
    found = changes(pairs(*[(14, 6, 0, 0)] * 3, (0, 20, 0, 0), *[(19, 1, 0, 0)] * 30))
    assert [one.adjusted for one in found[:4]] == pytest.approx([4 * 2 / 2**20, *[2 / 64] * 3])
    assert sum(one.shown for one in found) == 4


def test_levels_are_compared_by_pairs():
    factors, _ = factors_of([{"noise": k % 2} for k in range(8)])
    quiet, loud = by_level(factors, pairs(*[(8, 0, 0, 2), (2, 6, 0, 2)] * 4))
    assert (quiet.level, quiet.difference.difference) == ("0", 0.0)
    assert (loud.level, loud.difference.difference) == ("1", pytest.approx(-0.6))
    assert loud.adjusted < 0.05
    # A level with one configuration has McNemar's p-value for these scenarios, and none for others.
    factors, _ = factors_of([{"radius": 0.2}, {"radius": 0.45}])
    found = pairs((15, 0, 0, 0), (4, 11, 0, 0))
    assert [one.adjusted for one in by_level(factors, found)] == pytest.approx([1.0, 2 * binomtest(11, 11).pvalue])
    assert [one.adjusted for one in by_level(factors, found, "others")] == [None, None]
    assert [one.level for one in by_level(factors, pairs((5, 0, 0, 0)))] == ["0.2"]
