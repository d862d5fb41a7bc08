"""The JSON summary is a contract with scripts."""

import json

from vastflow.flows.results.summary import Summary
from vastflow.oracles.evidence.rates import Counts


def summary():
    return Summary(
        24, 1, 2, 120, 100, 20, 110, 9, 1, 4800.123456, 61.0004, 35.5, "results/c", {"success": Counts(119, 1, 0)}
    )


def test_json_summary_has_exactly_these_keys():
    assert list(json.loads(summary().json_text())) == [
        "configurations",
        "rejected",
        "duplicates",
        "runs",
        "executed",
        "reused",
        "passed",
        "failed",
        "not_judged",
        "simulated_s",
        "cpu_s",
        "wall_s",
        "results",
        "oracles",
        "excluded",
        "excluded_by",
        "sampled_from",
        "stood_still",
    ]


def test_oracles_have_three_counts():
    assert summary().as_json()["oracles"] == {"success": {"passed": 119, "failed": 1, "not_judged": 0}}


def test_seconds_are_rounded_to_milliseconds():
    assert summary().as_json()["simulated_s"] == 4800.123


def test_json_summary_is_one_line():
    assert "\n" not in summary().json_text()
