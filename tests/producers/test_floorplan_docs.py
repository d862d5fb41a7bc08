"""The page about floor plans: its examples work, and its files are those that are written."""

import re
from pathlib import Path

import pytest

from vastflow.producers.campaign import load_campaign
from vastflow.producers.floorplan.environment import environments_in
from vastflow.producers.floorplan.files import read_plan_file, read_variation_file
from vastflow.producers.floorplan.rendering import render
from vastflow.producers.instantiation.instantiate import instantiate
from vastflow.producers.model.configuration import Fragment
from vastflow.producers.model.producer import evaluate

PAGE = Path(__file__).parents[2] / "docs" / "draw-a-floor-plan.md"
BLOCKS = {
    about: text for _, about, text in re.findall(r"^```(\w+) (\S+)\n((?:.*\n)*?)^```$", PAGE.read_text(), re.MULTILINE)
}


@pytest.fixture
def folder(tmp_path):
    for name in ("rooms.fpm", "rooms.variation"):
        (tmp_path / name).write_text(BLOCKS[name])
    with environments_in(tmp_path / "environments"):
        yield tmp_path


def test_documented_plan_and_variation_match_page(folder):
    building = read_plan_file(folder / "rooms.fpm").building()
    assert (building.notes, [hole.name for hole in building.holes]) == ((), ["study_door", "north_window"])
    variation = read_variation_file(folder / "rooms.variation").variation()
    names = ["door", "study.location.translation.x", "study.desk.shape.width"]
    assert [varied.name for varied in variation.varied] == names


def test_pages_producers_build_every_configuration(folder):
    variations = "".join(f"      {line}\n" for line in BLOCKS["floorplans"].splitlines())
    (folder / "c.vast").write_text(f"version: 1\nconfiguration:\n  - name: rooms\n    variations:\n{variations}")
    campaign = load_campaign(folder / "c.vast")
    found = instantiate(campaign)
    assert (campaign.notes, campaign.unexecutable, found.rejections) == ((), (), ())
    assert len(found.configurations) == 3 * 2
    assert all(isinstance(item, Fragment) for item in evaluate(campaign.families[0].producers[0], {}))


def test_pages_table_names_the_files_that_are_written(folder):
    plan = read_plan_file(folder / "rooms.fpm")
    cells = re.findall(r"^\| (`[^|]*) \| [^|]* \|$", PAGE.read_text(), re.MULTILINE)
    named = {name.replace("NAME", "rooms") for cell in cells for name in re.findall(r"`([^`]+)`", cell)}
    assert set(render(plan.building(), plan.text, "rooms.fpm", 0.05, 0.193)) == named
