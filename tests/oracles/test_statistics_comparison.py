from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import binomtest, t

from vastflow.oracles.results.factors import factors_of
from vastflow.oracles.statistics.comparison import Pairs, Target, by_level, changes, difference, mcnemar

TARGETS: tuple[Target, ...] = ("these", "others")


def pairs(*configurations: tuple[int, int, int, int]) -> Pairs:
    """Of each configuration, how many pairs passed both times, before alone, after alone, never."""
    number, before, after = [], [], []
    for k, counts in enumerate(configurations):
        for (then, now), times in zip(((1, 1), (1, 0), (0, 1), (0, 0)), counts, strict=True):
            number += [k] * times
            before += [then] * times
            after += [now] * times
    return Pairs(np.array(number, dtype=np.int64), np.array(before, dtype=bool), np.array(after, dtype=bool))


def test_mcnemars_exact_test_is_the_published_one_of_approval_ratings() -> None:
    # A. Agresti, Categorical Data Analysis, table 10.1: 794, 150, 86, 570.
    assert mcnemar(150, 86) == pytest.approx(3.716e-5, abs=5e-9)


def test_mcnemars_exact_test_is_the_published_one_of_airway_hyper_responsiveness() -> None:
    # Fagerland, Lydersen and Laake 2013: 1 and 7 discordant pairs.
    assert mcnemar(1, 7) == pytest.approx(0.0703, abs=5e-5)


def test_pairs_that_agree_show_nothing() -> None:
    assert mcnemar(0, 0) == 1.0
    assert mcnemar(3, 3) == 1.0


def test_difference_of_approval_ratings_has_the_published_interval() -> None:
    # Agresti: -0.04 with a standard error of 0.0095, -0.059 to -0.021; each person is a path of its own.
    found = pairs(*[(1, 0, 0, 0)] * 794, *[(0, 1, 0, 0)] * 150, *[(0, 0, 1, 0)] * 86, *[(0, 0, 0, 1)] * 570)
    for target in TARGETS:
        said = difference(found, target)
        assert said is not None
        assert said.difference == pytest.approx(-0.04)
        assert said.interval == pytest.approx((-0.059, -0.021), abs=1e-3)


def test_path_that_lost_all_is_one_observation_of_others_and_many_of_these() -> None:
    # One of four paths lost all: of others, the exact interval of one in four; of these, that of ten in forty.
    lost = pairs((0, 10, 0, 0), *[(10, 0, 0, 0)] * 3)
    for target, ends in (("others", binomtest(1, 4)), ("these", binomtest(10, 40))):
        found = difference(lost, target)
        assert found is not None
        assert found.difference == -0.25
        assert found.interval[0] == pytest.approx(-ends.proportion_ci(0.95, "exact").high, abs=1e-6)


def test_changes_on_one_path_have_a_p_value_with_paths_as_clusters() -> None:
    # Four configurations of ten pairs, one of which lost all: D = -1/4, deviations -7.5, 2.5, 2.5, 2.5;
    # V = 4/3 · 75 / 1600 = 1/16, t with 3 degrees of freedom.
    found = difference(pairs((0, 10, 0, 0), *[(10, 0, 0, 0)] * 3))
    assert found is not None
    assert found.p_value == pytest.approx(2 * float(t.sf(1.0, 3)))
    assert found.mcnemar == pytest.approx(2 / 2**10)


def test_configurations_on_one_path_change_together() -> None:
    # Two settings on each of four paths; on one path both lost all: the same as four configurations of twenty pairs.
    found = pairs(*[(0, 10, 0, 0)] * 2, *[(10, 0, 0, 0)] * 6)
    blocked = difference(replace(found, block=found.configuration // 2), "others")
    alone = difference(pairs((0, 20, 0, 0), *[(20, 0, 0, 0)] * 3), "others")
    assert blocked is not None and alone is not None
    assert (blocked.interval, blocked.p_value, blocked.configurations) == (alone.interval, alone.p_value, 8)


def test_of_others_each_path_counts_once_however_many_settings_it_has() -> None:
    found = pairs(*[(10, 0, 0, 0)] * 3, (0, 10, 0, 0))
    said = difference(replace(found, block=(found.configuration == 3).astype(np.int64)), "others")
    assert said is not None
    assert (said.difference, said.paths) == (-0.5, 2)


def test_on_a_single_path_configurations_are_what_changes_together_and_others_are_unknown() -> None:
    found = pairs((5, 5, 0, 0), (10, 0, 0, 0), (8, 2, 0, 0))
    blocked, alone = difference(replace(found, block=np.zeros(30, dtype=np.int64))), difference(found)
    assert blocked is not None and alone is not None
    assert replace(blocked, paths=3) == alone
    of_others = difference(replace(found, block=np.zeros(30, dtype=np.int64)), "others")
    assert of_others is not None
    assert of_others.interval[1] - of_others.interval[0] > 1.0


def test_some_of_the_pairs_keep_their_blocks() -> None:
    found = pairs((5, 5, 0, 0), (10, 0, 0, 0))
    some = replace(found, block=found.configuration + 7).of(found.configuration == 1)
    assert some.block is not None and set(some.block.tolist()) == {8}


def test_pairs_without_a_change_leave_the_exact_interval_of_none_in_so_many() -> None:
    # (1 - 0.025^(1/100)), by hand.
    found = difference(pairs(*[(10, 0, 0, 0)] * 10))
    assert found is not None
    assert found.interval == pytest.approx((0.025**0.01 - 1, 1 - 0.025**0.01), abs=1e-6)


def test_one_configuration_speaks_of_itself() -> None:
    found = difference(pairs((5, 5, 0, 10)))
    assert found is not None
    assert (found.configurations, found.p_value, found.mcnemar) == (1, None, pytest.approx(2 / 2**5))


def test_without_a_pair_there_is_no_difference() -> None:
    assert difference(pairs()) is None
    assert changes(pairs()) == []


def test_loss_is_ruled_out_where_the_whole_interval_is_above_it() -> None:
    found = difference(pairs(*[(10, 0, 0, 0)] * 10))
    assert found is not None
    assert found.non_inferior(0.037)
    assert not found.non_inferior(0.036)
    assert not found.non_inferior(-found.interval[0])  # a loss of just as much may be


def test_configurations_that_fail_newly_are_shown_first_and_chance_is_not() -> None:
    found = changes(pairs((18, 1, 1, 0), (0, 20, 0, 0), (20, 0, 0, 0), (5, 0, 15, 0)))
    assert [(one.configuration, one.shown, one.worse) for one in found] == [
        (1, True, True),
        (3, True, False),
        (0, False, False),
    ]
    assert (found[0].before, found[0].after, found[0].pairs) == (20, 0, 20)
    assert found[0].p_value == pytest.approx(binomtest(20, 20).pvalue)


def test_changes_are_adjusted_for_all_that_could_have_shown_any() -> None:
    # Three of six discordant pairs, p = 2/64, and one of twenty: Benjamini and Hochberg over four.
    found = changes(pairs(*[(14, 6, 0, 0)] * 3, (0, 20, 0, 0), *[(19, 1, 0, 0)] * 30))
    assert [one.adjusted for one in found[:4]] == pytest.approx([4 * 2 / 2**20, *[2 / 64] * 3])
    assert sum(one.shown for one in found) == 4


def test_five_discordant_pairs_can_never_show_a_change() -> None:
    (found,) = changes(pairs((0, 5, 0, 0)))
    assert not found.shown and found.adjusted == 1.0


def test_each_level_of_each_factor_has_its_difference() -> None:
    factors, _ = factors_of([{"noise": k % 2} for k in range(8)])
    losing = pairs(*[(8, 0, 0, 2), (2, 6, 0, 2)] * 4)
    quiet, loud = by_level(factors, losing)
    assert (quiet.level, quiet.difference.difference) == ("0", 0.0)
    assert (loud.level, loud.difference.difference) == ("1", pytest.approx(-0.6))
    assert loud.adjusted is not None and loud.adjusted < 0.05


def test_level_with_one_configuration_has_mcnemars_p_value_for_these_scenarios() -> None:
    factors, _ = factors_of([{"radius": 0.2}, {"radius": 0.45}])
    found = pairs((15, 0, 0, 0), (4, 11, 0, 0))
    assert [one.adjusted for one in by_level(factors, found)] == pytest.approx([1.0, 2 * binomtest(11, 11).pvalue])
    assert [one.adjusted for one in by_level(factors, found, "others")] == [None, None]


def test_level_without_pairs_is_left_out() -> None:
    factors, _ = factors_of([{"noise": 0}, {"noise": 1}])
    assert [one.level for one in by_level(factors, pairs((5, 0, 0, 0)))] == ["0"]


def test_pair_has_both_outcomes() -> None:
    with pytest.raises(ValueError, match="expected a configuration and two outcomes"):
        Pairs(np.zeros(2, dtype=np.int64), np.zeros(2, dtype=bool), np.zeros(1, dtype=bool))
