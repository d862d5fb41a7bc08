"""The courses after ISO 18646-2 and ASTM F3244: what their files ask for."""

from pathlib import Path

import numpy as np
import pytest
from table import each_row

from vastflow.flows.request.campaign_file import read_campaign
from vastflow.producers.instantiation.instantiate import instantiate
from vastflow.sim.run import run
from vastflow.sim.world.environment import world_of

COURSES = Path(__file__).parents[2] / "campaigns" / "courses"


def made(name):
    campaign, oracles = read_campaign(COURSES / name, strict=True)
    assert (campaign.notes, campaign.unexecutable) == ((), ())
    assert "navigation" in {oracle.name for oracle in oracles}
    found = instantiate(campaign)
    assert not found.rejections
    return campaign, found.configurations


@each_row(
    ("name", "configurations", "runs"), [("pose.vast", 8, 30), ("obstacles.vast", 36, 10), ("passage.vast", 14, 10)]
)
def test_course_asks_for_configurations_and_repetitions(name, configurations, runs):
    campaign, found = made(name)
    assert (len(found), campaign.spec.execution.runs) == (configurations, runs)
    assert "No certification." in (COURSES / name).read_text()


def test_passage_is_as_wide_as_its_variation_says():
    _, found = made("passage.vast")
    widths_m = []
    for each in found[:12:3]:
        walls = world_of(each.scenario.environment).walls
        _, column = walls.cell_of(2.45, 0.0)  # in its middle
        widths_m.append(np.sum(walls.free[:, column]) * walls.resolution_m)
    assert widths_m == pytest.approx([0.5, 0.55, 0.65, 0.9], abs=2 * 0.025)


@pytest.mark.slow
def test_robot_passes_wide_passage_and_not_narrowest():
    _, found = made("passage.vast")
    outcomes = [run(found[k].scenario, 0, 0).run.outcome for k in (0, 9)]
    assert outcomes == ["aborted", "succeeded"]
