"""The paper's three campaigns, on our floor plans and on the paper's maps."""

from collections import Counter
from dataclasses import replace
from pathlib import Path

import pytest
import yaml
from outside import NO_MAPS, PAPER_MAPS
from paper_published import PUBLISHED
from paper_results import Requested, requested_of

from vastflow.flows.request.campaign_file import read_campaign
from vastflow.producers.instantiation.instantiate import instantiate
from vastflow.sim.model.faults import FileError

pytestmark = pytest.mark.slow

ROOT = Path(__file__).parents[2]
PAPER = ROOT / "campaigns" / "paper"
originals = pytest.mark.skipif(not PAPER_MAPS.is_dir(), reason=NO_MAPS)


def of_plan(file, plan, maps=None):
    """The instantiation of one floor plan's families; `vastflow plan` has the counts of all plans."""
    campaign, _ = read_campaign(PAPER / file, maps)
    families = tuple(family for family in campaign.families if family.name.startswith(plan))
    return instantiate(replace(campaign, families=families))


@pytest.mark.parametrize("kind", PUBLISHED)
def test_campaign_has_no_notes(kind):
    campaign, oracles = read_campaign(PAPER / f"{kind}.vast")
    assert (campaign.notes, campaign.unexecutable, campaign.runs) == ((), (), 20)
    assert kind in {oracle.name for oracle in oracles}


@pytest.mark.parametrize(("plan", "configurations"), [("corridors", 400), ("nested-rooms", 216)])
def test_paths_of_a_plan_are_as_many_as_the_papers_and_all_distinct(plan, configurations):
    found = requested_of(of_plan("performance.vast", plan).coverage)
    assert found == Requested(configurations, 0, 0, 0, configurations)


def test_levels_of_noise_are_as_many_as_the_papers_and_all_distinct():
    n = PUBLISHED["robustness"].configurations
    assert requested_of(of_plan("robustness.vast", "").coverage) == Requested(n, 0, 0, 0, n)


def test_radii_share_paths():
    tasks = {}
    for each in of_plan("performance.vast", "corridors").configurations:
        assert set(each.scenario.system) == {"global_costmap.robot_radius"}
        tasks.setdefault(each.scenario.system["global_costmap.robot_radius"], []).append(
            (each.scenario.environment["map_file"].digest, str(each.scenario.task))
        )
    wide, slim = tasks[0.22], tasks[0.175]
    assert Counter(wide) == Counter(slim)
    assert len(wide) == 200


def test_settings_of_obstacles_have_duplicates_and_rejections():
    found = requested_of(of_plan("safety.vast", "nested-rooms").coverage)
    assert (found.all, found.no_way, found.duplicates) == (3 * 2 * 24, 0, 3 * 2 * 5)
    assert found.distinct + found.no_room == 3 * 2 * 19
    assert 0 < found.no_room < 3 * 2 * 12


@originals
def test_papers_missing_cells_are_proved_impossible():
    found = of_plan("original-maps/performance.vast", "rooms", PAPER_MAPS)
    assert requested_of(found.coverage) == Requested(266, 50, 0, 0, 216)
    reasons = {each.reason for each in found.rejections if each.family == "rooms-random"}
    assert len(reasons) == 1 and "this map has no path of 20 m" in reasons.pop()


@originals
@pytest.mark.parametrize(
    ("kind", "plan", "counts"),
    [
        ("robustness", "", Requested(1792, 0, 0, 0, 1792)),
        ("safety", "rooms", Requested(432, 288, 0, 30, 114)),
        ("safety", "hallways", Requested(432, 0, 0, 90, 342)),
    ],
)
def test_paper_maps_have_room_for_paper_configurations(kind, plan, counts):
    assert requested_of(of_plan(f"original-maps/{kind}.vast", plan, PAPER_MAPS).coverage) == counts


@pytest.mark.parametrize("kind", PUBLISHED)
def test_missing_maps_of_the_paper_are_all_reported(kind):
    with pytest.raises(FileError, match="--map-dir") as raised:
        read_campaign(PAPER / "original-maps" / f"{kind}.vast")
    assert len(raised.value.faults) == (15 if kind == "performance" else 5)


@pytest.mark.parametrize("kind", PUBLISHED)
def test_oracles_and_execution_agree_on_both_sets_of_maps(kind):
    own, original = (yaml.safe_load((PAPER / folder / f"{kind}.vast").read_text()) for folder in (".", "original-maps"))
    assert [own[key] for key in ("version", "execution", "evaluation")] == [
        original[key] for key in ("version", "execution", "evaluation")
    ]
