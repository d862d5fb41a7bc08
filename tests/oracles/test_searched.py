"""What is said of the best point of a search."""

import numpy as np
from table import each_row

from vastflow.oracles.evidence.searched import found_text
from vastflow.oracles.statistics.intervals import clopper_pearson_intervals


def said(**parts):
    best = {"configuration": "point-0007", "point": {}, "objective": 0.9, "runs": 10}
    samples = [1.0] * 42 + [0.0] * 18
    confirmation = {"runs": 60, "samples": samples, "found": 0.9}
    return {"objective": "failure_rate", "is_rate": True, "best": best, "confirmation": confirmation, **parts}


def beside(as_good):
    best = {"configuration": "random-0003", "point": {}, "objective": 0.4, "runs": 10}
    return {
        "strategy": "random",
        "runs": 500,
        "best": best,
        "runs_until_best": 43,
        "runs_until_as_good": as_good,
    }


@each_row(
    ("parts", "text"),
    [
        ({}, "point-0007: failure rate found at 90 %, confirmed at 70 % [56, 82] on 60 fresh runs."),
        ({"confirmation": None}, "point-0007: failure rate found at 90 % on 10 runs; not confirmed."),
        ({"best": None}, "No point was judged."),
        ({"is_rate": False, "objective": "time"}, "point-0007: time found at 0.9; the mean of 60 fresh runs is 0.7."),
    ],
)
def test_best_is_said_with_what_confirms_it(parts, text):
    assert found_text(said(**parts)) == text


@each_row(
    ("as_good", "text"),
    [
        (428, "Found after 43 runs, by random search after 428."),
        (None, "Found after 43 runs; random search comes to 40 % in 500 runs."),
    ],
)
def test_beside_it_stands_what_random_search_needed(as_good, text):
    assert found_text(said(baseline=beside(as_good))).endswith(f"on 60 fresh runs. {text}")


def test_interval_of_fresh_runs_covers_the_truth_whatever_was_selected():
    """200 searches among 100 points of rates up to 60 %: the best of 5 runs each looks worse than it is, its fresh runs do not."""
    draws = np.random.default_rng(1)
    covered, excess = 0, []
    for _ in range(200):
        rates = draws.uniform(0.0, 0.6, 100)
        failed = draws.binomial(5, rates)
        best = int(np.argmax(failed))
        low, high = clopper_pearson_intervals(draws.binomial(60, rates[best]), 60)
        covered += low <= rates[best] <= high
        excess.append(failed[best] / 5 - rates[best])
    assert covered >= 190 - 3 * (200 * 0.05 * 0.95) ** 0.5
    assert np.mean(excess) > 0.3
