"""The paper's three campaigns, on our floor plans and on the paper's maps."""

import functools
from collections import Counter
from dataclasses import replace
from pathlib import Path

import pytest
import yaml
from paper_published import PUBLISHED
from paper_results import Requested, requested_of

from vastflow.flows.request.campaign_file import read_campaign
from vastflow.producers.faults import CampaignError
from vastflow.producers.instantiate import instantiate

ROOT = Path(__file__).parents[2]
PAPER = ROOT / "campaigns" / "paper"
MAPS = ROOT.parent / "shared" / "maps"

originals = pytest.mark.skipif(not MAPS.is_dir(), reason="the paper's maps are not beside the repository")


@pytest.fixture(scope="module")
def made():
    """Instantiates a campaign, once for all that ask for it."""

    @functools.cache
    def instantiated(file, maps=None):
        return instantiate(read_campaign(PAPER / file, maps)[0])

    return instantiated


@pytest.mark.parametrize("kind", PUBLISHED)
def test_it_has_nothing_to_complain_of(kind):
    campaign, oracles = read_campaign(PAPER / f"{kind}.vast")
    assert (campaign.notes, campaign.unexecutable, campaign.runs) == ((), (), 20)
    assert kind in {oracle.name for oracle in oracles}


@pytest.mark.parametrize("kind", ["performance", "robustness"])
def test_its_configurations_are_as_many_as_the_papers_and_all_distinct(made, kind):
    n = PUBLISHED[kind].configurations
    assert requested_of(made(f"{kind}.vast").coverage) == Requested(n, 0, 0, 0, n)


def test_both_radii_have_the_same_ways(made):
    configurations = made("performance.vast").configurations
    tasks = {}
    for each in configurations:
        tasks.setdefault(each.scenario.system["global_costmap.robot_radius"], []).append(
            (each.scenario.environment["map_file"].digest, str(each.scenario.task))
        )
    wide, slim = tasks[0.22], tasks[0.175]
    assert Counter(wide) == Counter(slim)
    assert len(wide) == 908


def test_the_radius_is_the_planners_alone(made):
    for each in made("performance.vast").configurations:
        assert set(each.scenario.system) == {"global_costmap.robot_radius"}


def test_of_the_settings_of_obstacles_six_are_the_same_and_some_boxes_find_no_room():
    """Of one floor plan: all of them take half a minute."""
    campaign, _ = read_campaign(PAPER / "safety.vast")
    rooms = [family for family in campaign.families if family.name == "nested-rooms"]
    found = requested_of(instantiate(replace(campaign, families=tuple(rooms))).coverage)
    assert (found.all, found.no_way, found.duplicates) == (3 * 2 * 24, 0, 3 * 2 * 5)
    assert found.distinct + found.no_room == 3 * 2 * 19
    assert 0 < found.no_room < 3 * 2 * 12


@originals
def test_on_the_papers_maps_the_cells_that_its_counts_lack_are_proved_to_be_impossible(made):
    found = made("original-maps/performance.vast", MAPS)
    assert requested_of(found.coverage) == Requested(1866, 50, 0, 0, PUBLISHED["performance"].configurations)
    reasons = {each.reason for each in found.rejections if each.family == "rooms-random"}
    assert len(reasons) == 1 and "this map has no path of 20 m" in reasons.pop()


@originals
@pytest.mark.parametrize(
    ("kind", "requested", "no_way", "duplicates"), [("robustness", 1792, 0, 0), ("safety", 2160, 288, 390)]
)
def test_on_the_papers_maps_none_of_its_configurations_is_lost_for_want_of_room(
    made, kind, requested, no_way, duplicates
):
    n = PUBLISHED[kind].configurations
    found = requested_of(made(f"original-maps/{kind}.vast", MAPS).coverage)
    assert found == Requested(requested, no_way, 0, duplicates, n - duplicates)


@pytest.mark.parametrize("kind", PUBLISHED)
def test_without_the_papers_maps_every_map_that_is_missing_is_said(kind):
    with pytest.raises(CampaignError, match="--map-dir") as raised:
        read_campaign(PAPER / "original-maps" / f"{kind}.vast")
    assert len(raised.value.faults) == (15 if kind == "performance" else 5)


@pytest.mark.parametrize("kind", PUBLISHED)
def test_on_both_sets_of_maps_the_oracles_and_the_execution_are_the_same(kind):
    own, original = (yaml.safe_load((PAPER / folder / f"{kind}.vast").read_text()) for folder in (".", "original-maps"))
    assert [own[key] for key in ("version", "execution", "evaluation")] == [
        original[key] for key in ("version", "execution", "evaluation")
    ]
