"""The campaign of latency presets: what its file says, and how its proof counts."""

import pandas as pd
from latency_presets import CAMPAIGN, PRESET, classes_of

from vastflow.producers.campaign import load_campaign
from vastflow.producers.instantiation.robots import robots_json


def test_campaign_varies_only_latency_of_robot():
    campaign = load_campaign(CAMPAIGN)
    assert not campaign.notes
    assert {line["robot"][-1] for line in robots_json(campaign.families)} == {f"varied: {PRESET}"}


def test_configuration_is_flaky_where_some_of_its_runs_pass_and_some_fail():
    passed = {"well": [1, 1, 1, 1], "flaky": [1, 0, 1, 0], "rare": [1, 1, 1, 0], "never": [0, 0, 0, 0]}
    rows = [(name, bool(each)) for name, runs in passed.items() for each in runs]
    assert classes_of(pd.DataFrame(rows, columns=["configuration", "passed"])) == {
        "configurations": 4,
        "runs": 16,
        "failing runs": 7,
        "failing configurations": 3,
        "always": 1,
        "flaky": 2,
        "flaky of the failing": "67%",
        "failing runs of always failing": "57%",
    }
