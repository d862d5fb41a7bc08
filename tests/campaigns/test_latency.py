"""The campaign of latency presets: what its file says, and how its proof counts."""

import pytest
from latency_presets import CAMPAIGN, PRESET, Classes, classes_of, table

from vastflow.producers.campaign import load_campaign
from vastflow.producers.instantiation.family import robots_json
from vastflow.sim.nav2.parameters.robot import PRESETS


def test_campaign_varies_only_latency_of_robot():
    campaign = load_campaign(CAMPAIGN)
    assert not campaign.notes
    assert {line["robot"][-1] for line in robots_json(campaign.families)} == {f"varied: {PRESET}"}


def test_configuration_is_flaky_where_some_of_its_runs_pass_and_some_fail():
    passed = {
        "well": [True] * 4,
        "flaky": [True, False, True, False],
        "rare": [True, True, True, False],
        "never": [False] * 4,
    }
    found = classes_of(passed)
    assert found == Classes(configurations=4, always=1, flaky=2, runs=16, failures=7, of_always=4)
    assert found.flaky_share == pytest.approx(2 / 3)
    assert found.always_share == pytest.approx(4 / 7)


def test_table_counts_the_runs_that_all_presets_have():
    both, none = [True, True], [False, False]
    kept = {f"a {preset}": {0: both, 1: none} for preset in PRESETS} | {"a loaded": {0: none}}
    reached = [line.split("|")[3:7] for line in table(kept, ["a"]) if line.startswith("| reached")]
    assert reached == [[" 1 ", " 1 ", " 0 ", " 0 "], [" 1 ", " 1 ", " 0 ", " 0 "], [" 1 ", " 1 ", " 1 ", " 1 "]]
