"""The shipped campaign with a notebook as an oracle."""

import json
from pathlib import Path

import pytest

from vastflow.flows.request.campaign_file import read_campaign
from vastflow.flows.results.inputs import inputs_of
from vastflow.oracles.judgment.judge import judge_block
from vastflow.oracles.observation.observe import observe_block
from vastflow.producers.instantiation.instantiate import instantiate
from vastflow.sim.model.blocks import write_recordings
from vastflow.sim.run import run

LOST = Path(__file__).parents[2] / "campaigns" / "notebook" / "lost.vast"


@pytest.fixture(scope="module")
def campaign():
    return read_campaign(LOST)


def test_campaign_has_no_notes_and_is_built_in_full(campaign):
    found = instantiate(campaign[0])
    assert (campaign[0].notes, campaign[0].unexecutable, found.rejections) == ((), (), ())
    assert len(found.configurations) == 2


def test_notebook_is_kept_with_the_campaign(campaign):
    kept = inputs_of(*campaign).files
    assert kept["lost.ipynb"] == LOST.with_suffix(".ipynb").read_bytes()


def test_notebook_is_shipped_without_outputs():
    cells = json.loads(LOST.with_suffix(".ipynb").read_text())["cells"]
    code = [cell for cell in cells if cell["cell_type"] == "code"]
    assert [(cell["outputs"], cell["execution_count"]) for cell in code] == [([], None)] * len(code)


def test_notebook_judges_beside_other_oracles(campaign):
    scenario = instantiate(campaign[0]).configurations[0].scenario
    recorded = write_recordings([run(scenario, 0)])
    verdicts = judge_block(scenario, recorded, observe_block(scenario, recorded), campaign[1]).verdicts
    assert [verdict.oracle for verdict in verdicts] == ["success", "lost.ipynb", "navigation"]
    assert verdicts[1].judgment == "pass"
    assert 0 < verdicts[1].metrics["greatest_error"].value < 0.3
