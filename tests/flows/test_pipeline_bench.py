"""The pipeline's benchmark, in short: what it counts, and none of its times."""

import pytest
from bench_pipeline import SCENARIO, bench_pipeline, campaign_text
from table import each_row

from vastflow.producers.campaign import load_campaign
from vastflow.producers.instantiation.instantiate import instantiate


@pytest.mark.slow
@pytest.mark.timeout(900)
def test_everything_is_executed_once_and_after_an_edit_one_configuration_alone():
    found = bench_pipeline(configurations=6, runs=2)
    assert (found["configurations"], found["runs"], found["executed"]) == (6, 12, 12)
    assert (found["rerun_executed"], found["edit_executed"]) == (0, 2)
    assert found["task_runs"] == found["task_runs_final"] > 0
    assert found["edit_task_runs"] == 3, "the shard of the edited configuration, through three stages"
    assert found["cpu_s"] > found["overhead_cpu_s"] > 0 < found["flow_peak_mb"]


@each_row("configurations", [2, 21, 22, 50])
def test_campaign_has_as_many_distinct_configurations_as_asked(tmp_path, configurations):
    (tmp_path / "nothing.osc").write_text(SCENARIO)
    (tmp_path / "nothing.vast").write_text(campaign_text(configurations, 3, edited=0))
    found = instantiate(load_campaign(tmp_path / "nothing.vast")).configurations
    assert len({configuration.scenario.digest for configuration in found}) == len(found) == configurations
