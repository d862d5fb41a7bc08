"""Classes of configurations, comparison of paired runs, and failure maps."""

import itertools
import math
from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import binom, binomtest, t
from table import each_row

from vastflow.oracles.results.factors import factors_of
from vastflow.oracles.statistics import classes
from vastflow.oracles.statistics.comparison import Pairs, by_level, changes, difference, mcnemar
from vastflow.oracles.statistics.failure_map import FailureGrid, FailureMap, empty_map, failure_map, grid_over
from vastflow.oracles.statistics.intervals import wilson_intervals


@each_row(
    ("passed", "judged", "names"),
    [
        ([20, 0, 10], [20, 20, 20], ("reliable", "systematic", "flaky")),
        ([19], [20], ("undecided",)),  # does not show a rate of four in five
        ([2, 0, 1], [2, 2, 2], ("undecided",) * 3),
        ([], [], ()),
        ([20, 0, 0, 2], [20, 0, 0, 2], ("reliable", "undecided", "undecided", "undecided")),
        # Two of forty never pass; 16 to 18 of 20 show nothing.
        ([0] * 2 + [16, 17, 18] * 12 + [17] * 2, [20] * 40, ("systematic",) * 2 + ("undecided",) * 38),
        # 1 of 20 at 0.2 has p = 0.069, none of 20 has 0.012: one in thirty is no evidence.
        ([0] + [4] * 29, [20] * 30, ("undecided",) * 30),
        ([0] + [4] * 29 + [20] * 500, [20] * 530, ("undecided",) * 30 + ("reliable",) * 500),
    ],
)
def test_classify_names_classes(passed, judged, names):
    assert classes.classify(passed, judged).names == names


def test_classify_takes_binomial_tails_and_adjusts_candidates_by_benjamini_and_hochberg():
    tails = classes._tails(np.array([19.0, 1.0, 9.0]), np.full(3, 20.0), classes.ClassBounds(), given=False).min(axis=0)
    flaky = max(binom.sf(8, 20, 0.2), binom.cdf(9, 20, 0.8))
    assert tails == pytest.approx([binom.sf(18, 20, 0.8), binom.cdf(1, 20, 0.2), flaky])
    assert tails[0] == pytest.approx(0.0692, abs=5e-5)  # 0.8^20 + 20 · 0.2 · 0.8^19, by hand
    # 0.8^20 = 0.0115, given that 13 or more of 20 pass: / 0.9679. One of ten is above 5 %, seven of ten are below.
    given = 0.8**20 / binom.sf(12, 20, 0.8)
    assert classes.classify([20] + [17] * 9, [20] * 10).count("reliable") == 0
    found = classes.classify([20] * 7 + [17] * 3, [20] * 10)
    assert (found.count("reliable"), found.adjusted[0]) == (7, pytest.approx(given * 10 / 7))
    assert classes.classify([20, 0, 0, 2], [20, 0, 0, 2]).adjusted[0] == pytest.approx(given)


def test_runs_and_passes_that_show_classes_agree_with_tails():
    # 0.8^13 = 0.055, 0.8^14 = 0.044; 0.9^28 = 0.052, 0.9^29 = 0.047.
    assert classes.runs_for_a_claim() == {"systematic": 14, "flaky": 10, "reliable": 14}
    assert classes.runs_for_a_claim(classes.ClassBounds(0.5, 0.9), error=0.05)["reliable"] == 29
    assert classes.passes_that_show(20) == {"systematic": (0, 0), "flaky": (8, 12), "reliable": (20, 20)}
    assert classes.passes_that_show(10) == {"flaky": (5, 5)}
    assert classes.passes_that_show(2) == classes.passes_that_show(0) == {}
    found = classes.total_failures([0, 0, 10, 20, 0], [20, 20, 20, 20, 0])
    assert (found.configurations, found.failures, found.of_failures) == (2, 40, 50)
    assert found.share == pytest.approx(0.8)
    assert classes.total_failures([5, 5], [5, 5]).share is None
    assert [*classes.classify([20, 0, 10], [20, 20, 20]).counts.values()] == [1, 1, 1, 0]


def test_impossible_bounds_and_rules_are_refused():
    for make, message in (
        (lambda: classes.ClassBounds(0.8, 0.2), r"0 < systematic < reliable < 1 must hold, got 0\.8 and 0\.2"),
        (lambda: classes.StoppingRule(5, 3), r"1 <= min_runs <= max_runs must hold, got 5 and 3"),
        (lambda: classes.StoppingRule(error=0.7), r"error must be between 0 and 0\.5, got 0\.7"),
    ):
        with pytest.raises(ValueError, match=message):
            make()


def test_stopping_rule_decides():
    # 0.8^14 = 0.044 is the chance of so many passes at the bound; one failure among twenty would add more than 0.05 allows.
    decisions = {(13, 13): None, (14, 14): "reliable", (0, 14): "systematic", (15, 19): None, (16, 20): "undecided"}
    assert {counts: classes.StoppingRule().decision(*counts) for counts in decisions} == decisions
    assert classes.StoppingRule(min_runs=16).decisions([15, 16], [15, 16]) == [None, "reliable"]
    # Thresholds come near Wald's ln(1/error), from below: the exact error of a truncated test is smaller than his bound.
    systematic, _, reliable = classes.StoppingRule(1, 400).thresholds
    assert reliable == pytest.approx(systematic)
    assert 2.8 < reliable <= math.log(20)
    assert [classes.StoppingRule(2, most).decidable for most in (10, 20)] == [("flaky",), classes.CLAIMS]


def test_operating_characteristics_match_enumeration():
    rule = classes.StoppingRule(2, 10, classes.ClassBounds(0.4, 0.6), error=0.2)
    assert len(rule.decidable) >= 2
    said = {(n, x): rule.decision(x, n) for n in range(1, 11) for x in range(n + 1)}
    for p in (0.3, 0.5, 0.9):
        ends, runs = dict.fromkeys((*classes.CLAIMS, "undecided"), 0.0), 0.0
        for outcomes in itertools.product((0, 1), repeat=10):
            chance = math.prod(p if outcome else 1 - p for outcome in outcomes)
            n, name = next((n, name) for n in range(1, 11) if (name := said[n, sum(outcomes[:n])]) is not None)
            ends[name] += chance
            runs += n * chance
        found = rule.operating_characteristics(p)
        ours = {**{name: share[0] for name, share in found.ends.items()}, "runs": found.expected_runs[0]}
        assert ours == pytest.approx({**ends, "runs": runs})


@each_row("rule", [classes.StoppingRule(), classes.StoppingRule(1, 30, classes.ClassBounds(0.45, 0.55), 0.1)])
def test_stopping_rule_holds_its_error_at_all_success_rates(rule):
    assert rule.operating_characteristics(np.linspace(0, 1, 997)).wrong.max() <= rule.error
    assert 0.5 * rule.error < rule.worst_error <= rule.error
    each, rounds = (rule.operating_characteristics([0.2, 0.5, 1.0], runs_per_look) for runs_per_look in (1, 5))
    assert (rounds.wrong <= each.wrong + 1e-12).all()
    assert (rounds.expected_runs >= each.expected_runs).all()


def test_classes_of_stopped_campaign_follow_its_rule():
    found = classes.classes_by(classes.StoppingRule(), [14, 0, 16, 3], [14, 14, 20, 3])
    assert found.names == ("reliable", "systematic", "undecided", "undecided")
    assert "at most 5 %" in found.controls


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
        low = -ends.proportion_ci(0.95, "exact").high
        assert (found.difference, found.interval[0]) == (-0.25, pytest.approx(low, abs=1e-6))
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


def test_difference_without_changes_excludes_only_large_losses():
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


GRID = grid_over(0.0, 0.0, 4.0, 1.0, cell_m=1.0)


def along(*x_m):
    return np.array([(x, 0.5) for x in x_m]).reshape(-1, 2)


def mapped(*ways, failed, **given):
    starts = np.r_[0, np.cumsum([len(way) for way in ways])].astype(int)
    return failure_map(GRID, np.concatenate(ways), starts, failed, **given)


def drawn(rng, configurations, rates):
    """A row of cells with ten visits of each configuration, whose rates are spread around those of the cells."""
    visits = np.full((configurations, 1, len(rates)), 10)
    failures = rng.binomial(10, rng.beta(2 * rates, 2 * (1 - rates), visits.shape))
    squares = np.stack([(failures**2).sum(0), (failures * visits).sum(0), (visits**2).sum(0)])
    came = np.full((1, len(rates)), configurations)
    return FailureMap(FailureGrid((0.0, 0.0), 0.25, came.shape), visits.sum(0), failures.sum(0), came, squares)


@each_row(
    ("ways", "failed", "visits", "failures"),
    [
        ([along(0.2, 0.8, 1.2, 0.8, 0.2, 1.4)], [False], [1, 1, 0, 0], [0, 0, 0, 0]),  # a cell is visited once
        ([along(0.5, 0.9, 1.3, 1.7, 2.1), along(0.5, 1.5)], [True, False], [2, 2, 1, 0], [0, 1, 1, 0]),
        ([along(0.9, 1.1, 1.4, 1.1, 1.4)], [True], [1, 1, 0, 0], [0, 1, 0, 0]),  # path, not distance
        ([along(2.5, 2.5, 2.5)], [True], [0, 0, 1, 0], [0, 0, 1, 0]),  # never moved
        ([along(-0.5, 0.5), along(), along(9.0)], [False, True, True], [1, 0, 0, 0], [0, 0, 0, 0]),  # off the grid
    ],
)
def test_failure_map_counts_visits_and_last_half_meter(ways, failed, visits, failures):
    found = mapped(*ways, failed=failed)
    assert (found.visits.tolist(), found.failures.tolist()) == ([visits], [failures])


def test_rate_needs_visits_and_maps_add_up():
    found = mapped(*[along(0.5)] * 4, along(0.5, 1.5), failed=[True, False, False, False, False])
    assert found.rate(5)[0, 0] == pytest.approx(0.2)
    assert np.isnan(found.rate(5)[0, 1:]).all()
    ways, failed = [along(0.5, 1.5), along(0.5), along(0.5, 1.5), along(1.5)], [True, False, False, True]
    together = mapped(*ways, failed=failed, configurations=[0, 0, 1, 1])
    added = empty_map(GRID) + mapped(*ways[:2], failed=failed[:2]) + mapped(*ways[2:], failed=failed[2:])
    for name in ("visits", "failures", "configurations", "squares"):
        assert np.array_equal(getattr(added, name), getattr(together, name))


def test_intervals_have_configurations_as_clusters():
    failures, visits = [3, 0, 4, 1], [5, 5, 5, 4]
    failed = [k < f for f, v in zip(failures, visits, strict=True) for k in range(v)]
    found = mapped(*[along(0.5)] * sum(visits), failed=failed, configurations=np.repeat(np.arange(4), visits))
    # p = 8/19, x - p n = 17/19, -40/19, 36/19, -13/19: V = 4/3 · 3354/19² / 19² = 0.034315, so p(1 - p)/V = 7.1034 visits;
    # t with 3 degrees of freedom is 3.182446.
    effective = 7.1034 * (1.959964 / 3.182446) ** 2
    assert found.intervals()[0, 0] == pytest.approx(wilson_intervals(8 / 19 * effective, effective), abs=1e-4)
    one = mapped(*[along(0.5)] * 20, failed=[True] * 20).intervals()
    assert one[0, 0] == pytest.approx(wilson_intervals(1, 1))
    assert one[0, 3] == pytest.approx([0.0, 1.0])


def test_hot_marks_only_planted_cell():
    rng = np.random.default_rng(2)
    found = empty_map(GRID)
    for _ in range(60):
        bad = rng.random(10) < 0.4
        ways = [along(0.5, 1.5, 2.5) if fails else along(0.5, 1.5, 2.5, 3.5) for fails in bad]
        found += mapped(*ways, failed=bad.tolist())
    assert found.hot().tolist() == [[False, False, True, False]]
    rates = np.r_[np.full(10, 0.8), np.full(190, 0.1)]
    hot = drawn(np.random.default_rng(3), 20, rates).hot().ravel()
    assert hot[:10].mean() >= 0.9 and hot[10:].sum() <= 1
    assert not mapped(*[along(0.5)] * 9, failed=[False] * 9).hot().any()
    assert not empty_map(GRID).hot().any()


@each_row("configurations", [1, 2, 3, 5, 12])
def test_hot_rarely_marks_cells_that_fail_like_others(configurations):
    # Configurations differ much: rates from B(0.4, 1.6), mean 0.2, the same in every cell, so that each mark is a false one.
    rng = np.random.default_rng(3)
    marked = sum(drawn(rng, configurations, np.full(200, 0.2)).hot().any() for _ in range(100))
    assert marked / 100 <= 0.05 + 4 * (0.05 * 0.95 / 100) ** 0.5
    grid = grid_over(-1.0, 2.0, 1.1, 3.0, cell_m=0.5)
    assert (grid.shape, grid.extent_m) == ((2, 5), (-1.0, 1.5, 2.0, 3.0))
