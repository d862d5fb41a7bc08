"""The producers of environments: which they yield, that they are kept whole, and what they reject."""

import multiprocessing
import shutil
from pathlib import Path

import pytest
from families import made

from vastflow.producers.campaign import load_campaign
from vastflow.producers.floorplan.environment import environments_in
from vastflow.producers.floorplan.files import PlanFile, read_variation_file
from vastflow.producers.model.configuration import Fragment, Rejection
from vastflow.producers.model.conformance import check_producer
from vastflow.producers.model.producer import evaluate
from vastflow.sim.world.map_file import load_map
from vastflow.sim.world.world import map_content
from vastflow.tasks.engine import work
from vastflow.tasks.engine.evaluation import FRAGMENTS, content_of, files_in, packed, read_evaluation
from vastflow.tasks.store.store import open_store

HERE = Path(__file__).parent


@pytest.fixture
def base(tmp_path):
    """A folder with the documented example, as that of a campaign file."""
    for suffix in ("fpm", "variation"):
        shutil.copy(HERE / f"test_floorplan_example.{suffix}", tmp_path)
    return tmp_path


@pytest.fixture(autouse=True)
def store(tmp_path):
    """Environments are kept in a folder of the test."""
    with environments_in(tmp_path / "environments"):
        yield tmp_path / "environments"


def generation(base, **parameters):
    return made("FloorplanGeneration", {"floorplans": ["test_floorplan_example.fpm"], **parameters}, base)


def variation(base, **parameters):
    return made("FloorplanVariation", {"variation_files": ["test_floorplan_example.variation"], **parameters}, base)


def only(producer):
    (fragment,) = evaluate(producer, {})
    return fragment


def test_plan_yields_its_map_and_its_mesh(base):
    fragment = only(generation(base))
    map_file, mesh_file = fragment.values["map_file"], fragment.values["mesh_file"]
    assert map_content(map_file.path) == map_file
    assert load_map(map_file.path).shape == (95, 240)
    assert Path(mesh_file.path).read_bytes()[80:84] != b"\0\0\0\0"
    assert fragment.values["_floorplan"] == {"plan": "flat", "file": "test_floorplan_example.fpm"}


def test_map_and_mesh_go_to_the_keys_that_the_parameters_name(base):
    producer = generation(base, name=["@map", "mesh"])
    assert dict(producer.writes) == {"map": "environment", "mesh": "environment"}
    assert {"map", "mesh"} < set(only(producer).values)


def test_resolution_and_height_of_the_laser_are_the_users(base):
    coarse, low, high = (
        only(generation(base, **options)).values["map_file"]
        for options in ({"resolution": 0.1}, {}, {"laser_height": 0.7})
    )
    assert load_map(coarse.path).resolution_m == 0.1
    assert low.digest != high.digest


def test_plans_yield_environments_in_order(base):
    other = (base / "test_floorplan_example.fpm").read_text().replace("plan: flat", "plan: other")
    (base / "other.fpm").write_text(other)
    names = ["other.fpm", "test_floorplan_example.fpm"]
    found = evaluate(generation(base, floorplans=names), {})
    assert [fragment.values["_floorplan"]["plan"] for fragment in found] == ["other", "flat"]
    assert found[0].values["map_file"] == found[1].values["map_file"]  # a name is no geometry


def test_variations_have_the_documented_numbers_and_the_seed_of_their_place(base):
    found = evaluate(variation(base, num_variations=3, seed=7), {})
    assert [fragment.values["_floorplan"]["seed"] for fragment in found] == [7, 8, 9]
    drawn = [fragment.values["_floorplan"]["drawn"]["study.location.translation.x"] for fragment in found]
    assert drawn == [0.34, 0.02, -0.05]
    maps = [fragment.values["map_file"].digest for fragment in found]
    assert len(set(maps)) == 3
    others = evaluate(variation(base, num_variations=2, seed=8), {})
    assert [fragment.values["map_file"].digest for fragment in others] == maps[1:]


def test_unbuildable_numbers_are_rejected_with_their_seed(base):
    text = (base / "test_floorplan_example.variation").read_text().replace("[0.7, 0.9, 1.1]", "[0.9, -5.0]")
    (base / "wide.variation").write_text(text)
    found = evaluate(variation(base, variation_files=["wide.variation"], num_variations=6), {})
    rejected = [item for item in found if isinstance(item, Rejection)]
    assert rejected and any(isinstance(item, Fragment) for item in found)
    assert all(item.requested["drawn"]["gap"] == -5.0 for item in rejected)
    assert "Entryway door: The width is -5 m. It must be at least 0.001 m" in rejected[0].reason
    assert f"with seed {rejected[0].requested['seed']}:" in rejected[0].reason


def test_notes_on_drawn_plans_name_their_seeds(base):
    file = base / "test_floorplan_example.variation"
    door = "door: {\n    location.translation.x : "
    assert door in file.read_text()
    file.write_text(file.read_text().replace(f"{door}normal(mean=0.0, std=0.1)", f"{door}uniform([0.0, 9.0])"))
    (note,) = variation(base, num_variations=6, seed=3).notes
    beside = [
        seed for seed in range(3, 9)
        if "9.0" in read_variation_file(file).variation().sample(seed).text.partition("Entryway")[2]
    ]  # fmt: skip
    assert 1 < len(beside) < 6
    assert str(note).startswith(
        f"test_floorplan_example.fpm:40:14: warning: Entryway door: As drawn with seed {beside[0]} and in "
        f"{len(beside) - 1} more of the first 6 variations, it cuts nothing, as it reaches from "
    )
    child = {"FloorplanVariation": {"variation_files": [file.name], "num_variations": 6, "seed": 3}}
    assert made("OneOfVariation", {"variations": [child]}, base).notes == (note,)


def test_notes_of_drawn_plan_match_text(base):
    found = read_variation_file(base / "test_floorplan_example.variation").variation()
    for seed in range(4):
        sample = found.sample(seed)
        as_text = PlanFile("p.fpm", sample.text).building()
        as_drawn = found.building(sample)
        assert (as_drawn.walls, as_drawn.obstacles, as_drawn.holes) == (as_text.walls, as_text.obstacles, as_text.holes)


FAMILY = "  - {name: f%d, parameters: [start_pose: {x: 0, y: 2}, goal_pose: {x: 2, y: 2}], variations: [%s]}\n"


def test_campaign_reports_each_plan_warning_once(base):
    plan = base / "test_floorplan_example.fpm"
    plan.write_text(plan.read_text().replace("width=gap", "width=9.0 m"))
    families = "".join(FAMILY % (k, f"FloorplanGeneration: {{floorplans: [{plan.name}]}}") for k in range(2))
    (base / "c.vast").write_text(
        f"version: 1\nmetadata: {{name: c}}\nconfiguration:\n{families}execution: {{runs: 1}}\n"
    )
    (warning,) = [note for note in load_campaign(base / "c.vast").notes if note.place.file == plan.name]
    assert warning.expected == "it is cut to that"
    for producer in (generation(base), variation(base)):
        assert [str(note) for note in producer.notes] == [str(warning)]


def test_plan_is_rejected_when_too_large_for_resolution(base):
    (item,) = evaluate(generation(base, resolution=0.0001), {})
    assert isinstance(item, Rejection) and "cells. At most" in item.reason


def test_floor_plan_producers_keep_the_contract(base):
    check_producer(generation(base), [{}, {"map_file": 1, "noise": 0.1}])
    check_producer(variation(base, num_variations=2), [{}, {"noise": 0.1}])


def test_parameter_content_ignores_location_of_plan_files(base, tmp_path):
    moved = tmp_path / "elsewhere"
    moved.mkdir()
    for file in base.glob("test_floorplan_example.*"):
        shutil.copy(file, moved)
    for producer in (variation, generation):
        assert content_of(producer(base).parameters) == content_of(producer(moved).parameters)
    plan = moved / "test_floorplan_example.fpm"
    plan.write_text(plan.read_text().replace("height: 2.5 m", "height: 2.6 m"))
    assert content_of(variation(base).parameters) != content_of(variation(moved).parameters)


def test_built_producers_do_not_reread_files(base):
    producer = variation(base)
    assert files_in(producer.parameters) == {}
    for file in base.glob("test_floorplan_example.*"):
        file.unlink()
    assert isinstance(evaluate(producer, {})[0], Fragment)


# Keeping


def test_environment_of_a_worker_is_readable_elsewhere(base, tmp_path, monkeypatch):
    monkeypatch.setenv("VASTFLOW_STORE", str(tmp_path / "store"))
    kept = open_store()
    worker = multiprocessing.get_context("spawn").Process(
        target=work.evaluate, args=(kept, "evaluate/00/key", packed(generation(base)), {})
    )
    worker.start()
    worker.join(120)
    (fragment,) = read_evaluation(kept.read("evaluate/00/key", FRAGMENTS), {})
    assert fragment == only(generation(base))
    assert map_content(fragment.values["map_file"].path) == fragment.values["map_file"]
    assert Path(fragment.values["map_file"].path).is_relative_to(tmp_path / "store")


def test_environment_is_stored_once_and_recreated_when_damaged(base, store):
    map_file = only(generation(base)).values["map_file"]
    picture = Path(map_file.path).with_name("map.pgm")
    content = picture.read_bytes()
    for damaged in (content, content[:-9], None, bytes(len(content))):
        picture.unlink()
        if damaged is not None:
            picture.write_bytes(damaged)
        again = only(generation(base)).values["map_file"]
        assert (again.path, map_content(again.path)) == (map_file.path, map_file)
        assert len(list(store.iterdir())) == 1
