"""The shipped quickstart campaign."""

from pathlib import Path

import numpy as np
import pytest
from scipy import ndimage

from vastflow.flows.request.campaign_file import read_campaign
from vastflow.flows.request.stopping import stopping_of
from vastflow.producers.instantiation.instantiate import instantiate
from vastflow.sim.world.map_file import load_map
from vastflow.sim.world.octile import passable

ROOT = Path(__file__).parents[2]
QUICKSTART = ROOT / "campaigns" / "quickstart" / "quickstart.vast"
OFFICE = QUICKSTART.parent / "maps" / "office.yaml"


@pytest.fixture(scope="module")
def campaign():
    found, _ = read_campaign(QUICKSTART)
    return found


@pytest.fixture(scope="module")
def instantiation(campaign):
    return instantiate(campaign)


def paths(instantiation, family):
    """Start and goal of each configuration, without repetitions, in order."""
    tasks = [c.scenario.task for c in instantiation.configurations if c.family == family]
    return list(dict.fromkeys((str(task["start_pose"]), str(task["goal_pose"])) for task in tasks))


def test_quickstart_has_two_families_of_twelve_and_sequential_runs(campaign, instantiation):
    assert (campaign.notes, campaign.unexecutable, instantiation.rejections) == ((), (), ())
    assert [c.name for c in instantiation.configurations if c.duplicate_of] == []
    sizes = {f.name: sum(c.family == f.name for c in instantiation.configurations) for f in campaign.families}
    assert sizes == {"sensor-noise": 12, "clutter": 12}
    assert (campaign.sequential.min, campaign.sequential.max) == (5, 12)
    assert set(stopping_of(campaign.sequential).rule.decidable) == {"reliable", "systematic", "flaky"}


def test_families_of_quickstart_share_first_three_paths(instantiation):
    assert paths(instantiation, "clutter")[:3] == paths(instantiation, "sensor-noise")
    assert len(paths(instantiation, "clutter")) == 4


def test_rooms_of_quickstart_map_are_connected():
    office = load_map(OFFICE)
    rooms, _ = ndimage.label(passable(office, 0.25), np.ones((3, 3)))
    sizes = np.bincount(rooms.ravel())[1:]
    assert sizes.max() / sizes.sum() > 0.98  # what is left are corners behind furniture
