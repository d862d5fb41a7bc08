"""The JSON summary is a contract with scripts."""

import json

from vastflow.flows.results.summary import Summary
from vastflow.oracles.evidence.rates import Counts

KEYS = """
configurations rejected duplicates runs executed reused passed failed not_judged simulated_s cpu_s wall_s results
oracles excluded excluded_by sampled_from stood_still
"""


def test_summary_prints_one_line_of_json_with_rounded_seconds():
    counts = {"success": Counts(119, 1, 0)}
    summary = Summary(24, 1, 2, 120, 100, 20, 110, 9, 1, 4800.123456, 61.0004, 35.5, "results/c", counts)
    text = summary.json_text()
    assert "\n" not in text and list(json.loads(text)) == KEYS.split()
    assert summary.as_json()["oracles"] == {"success": {"passed": 119, "failed": 1, "not_judged": 0}}
    assert summary.as_json()["simulated_s"] == 4800.123
