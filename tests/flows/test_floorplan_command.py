"""The commands about floor plans, as a user meets them."""

import hashlib
import json
import re
import shutil
from pathlib import Path

import pytest
from PIL import Image
from typer.testing import CliRunner

from vastflow.flows.__main__ import app
from vastflow.sim.world.map_file import load_map

EXAMPLE = Path(__file__).parents[1] / "producers" / "test_floorplan_example.fpm"

OFFICE_WING = Path(__file__).parents[2] / "campaigns" / "floorplans" / "office_wing.fpm"


@pytest.fixture
def plan(tmp_path):
    for suffix in (".fpm", ".variation"):
        shutil.copy(EXAMPLE.with_suffix(suffix), tmp_path)
    return tmp_path / EXAMPLE.name


def run(*arguments):
    return CliRunner().invoke(app, ["floorplan", *map(str, arguments)])


def refused(*arguments):
    """What is said where nothing is done: one message, no traceback, exit code 2."""
    result = run(*arguments)
    assert (result.exit_code, result.stdout) == (2, "")
    assert "Traceback" not in result.stderr
    return result.stderr.strip()


def test_render_writes_map_mesh_picture_plan_and_provenance(plan, tmp_path):
    result = run("render", plan, "--out", tmp_path / "out")
    written = {str(file.relative_to(tmp_path / "out")) for file in (tmp_path / "out").rglob("*") if file.is_file()}
    assert written == {
        "maps/flat.yaml",
        "maps/flat.pgm",
        "3d-mesh/flat.stl",
        "flat.png",
        "fpm/flat.fpm",
        "flat.provenance.json",
    }
    assert (result.exit_code, result.stderr) == (0, "")
    assert {Path(line) for line in result.stdout.splitlines()} == {tmp_path / "out" / name for name in written}
    occupancy = load_map(tmp_path / "out" / "maps" / "flat.yaml")
    assert (occupancy.shape, occupancy.origin_xy_m) == ((95, 240), (-3.25, -0.5))
    with Image.open(tmp_path / "out" / "flat.png") as picture:
        assert min(picture.size) > 400


def test_provenance_says_from_what_when_and_by_what_and_what_came_of_it(plan, tmp_path):
    run("render", plan, "--out", tmp_path / "out")
    provenance = json.loads((tmp_path / "out" / "flat.provenance.json").read_text())
    assert provenance["derived_from"] == {"file": str(plan), "sha256": hashlib.sha256(plan.read_bytes()).hexdigest()}
    assert re.match(r"vastflow \d", provenance["attributed_to"])
    assert re.match(r"\d{4}-\d\d-\d\dT.*\+00:00", provenance["created_at"])
    assert provenance["solid_volume_m3"] == pytest.approx(16.07, abs=1e-4)
    for name, sha256 in provenance["files"].items():
        assert hashlib.sha256((tmp_path / "out" / name).read_bytes()).hexdigest() == sha256


def test_render_takes_resolution_and_height_of_the_laser(plan, tmp_path):
    assert run("render", plan, "--out", tmp_path, "--resolution", 0.1, "--laser-height", 0.7).exit_code == 0
    header = (tmp_path / "maps" / "flat.yaml").read_text()
    assert "resolution: 0.1" in header and "laser_height: 0.7" in header


def test_geometry_prints_json_and_nothing_else(plan):
    result = run("geometry", plan)
    found = json.loads(result.stdout)
    assert result.exit_code == 0
    assert {"spaces", "walls", "obstacles", "openings"} <= set(found)
    assert found["spaces"]["corridor"] == [[-2.0, 3.0], [4.0, 3.0], [4.0, 1.0], [-2.0, 1.0]]
    assert found["walls"]["corridor-wall-1"] == {
        "polygon": [[4.2, 3.2], [4.2, 0.8], [4.0, 1.0], [4.0, 3.0]],
        "height": 2.5,
    }


def test_what_there_is_to_note_goes_to_the_other_output(plan):
    plan.write_text(plan.read_text().replace("spaced", "translation: y: 3 m").replace("translation: x: 0.25 m", ""))
    result = run("geometry", plan)
    assert json.loads(result.stdout)
    assert "warning: Entryway door: it does not reach corridor.walls[1]" in result.stderr


def test_variations_writes_a_plan_for_each_seed(plan, tmp_path):
    result = run("variations", plan.with_suffix(".variation"), "--count", 3, "--seed", 7, "--out", tmp_path / "v")
    files = [tmp_path / "v" / f"flat_{seed}.fpm" for seed in (7, 8, 9)]
    assert result.stdout.splitlines() == list(map(str, files))
    assert [re.search(r"gap = (\S+) m", file.read_text())[1] for file in files] == ["0.7", "0.7", "1.1"]
    assert all(run("geometry", file).exit_code == 0 for file in files)


def test_variation_that_makes_no_building_is_reported_and_the_others_are_written(plan, tmp_path):
    file = plan.with_suffix(".variation")
    file.write_text(file.read_text().replace("0.7, 0.9, 1.1", "0.9, -7.0"))
    result = run("variations", file, "--count", 6, "--out", tmp_path / "v")
    written = len(list((tmp_path / "v").iterdir()))
    assert result.exit_code == 0 and 0 < written < 6
    reports = result.stderr.splitlines()
    assert len(reports) == 6 - written
    assert re.search(r"\.variation: not written: flat_\d.fpm:\d+:\d+: Entryway door: the width is -7 m", reports[0])


def test_door_that_is_drawn_beside_its_wall_is_said_of_the_plan_that_is_written(plan, tmp_path):
    file = plan.with_suffix(".variation")
    door = "door: {\n    location.translation.x : "
    assert door in file.read_text()
    file.write_text(file.read_text().replace(f"{door}normal(mean=0.0, std=0.1)", f"{door}uniform([9.0])"))
    result = run("variations", file, "--seed", 7, "--out", tmp_path / "v")
    assert (result.exit_code, result.stdout.strip()) == (0, str(tmp_path / "v" / "flat_7.fpm"))
    assert re.match(rf"{tmp_path}/v/flat_7.fpm:\d+:\d+: warning: Entryway door: it cuts nothing: ", result.stderr)


@pytest.mark.parametrize("command", ["render", "geometry"])
def test_fault_of_a_plan_is_said_with_its_place(plan, tmp_path, command):
    plan.write_text(plan.read_text().replace("width=gap", "width=gab"))
    out = ("--out", tmp_path / "out") if command == "render" else ()
    said = refused(command, plan, *out)
    assert said == f"{plan}:41:32: Entryway door: no variable 'gab'; did you mean 'gap'?"


def test_other_mistakes_are_one_message_each(plan, tmp_path):
    out = ("--out", tmp_path / "out")
    missing = tmp_path / "none.fpm"
    assert refused("geometry", missing).startswith(f"{missing}:1:1: file: no such file")
    assert "--resolution: expected a number of meters, got inf" in refused("render", plan, *out, "--resolution", "inf")
    for wrong in ("0", "nan", "fine"):
        assert "Invalid value for '--resolution'" in refused("render", plan, *out, "--resolution", wrong)
    assert "cells; at most" in refused("render", OFFICE_WING, *out, "--resolution", "0.001")
    assert "is not a folder" in refused("render", plan, "--out", plan)
    assert "--seed 4294967295: the last seed is 4294967296" in refused(
        "variations", plan.with_suffix(".variation"), *out, "--seed", 2**32 - 1, "--count", 2
    )
    assert "syntax: found 'Floor'" in refused("variations", plan, *out)


def test_folder_that_can_not_be_written_to_is_said(plan, tmp_path):
    (tmp_path / "out").mkdir()
    (tmp_path / "out" / "maps").touch()
    result = run("render", plan, "--out", tmp_path / "out")
    assert result.exit_code == 2
    assert "can't be written" in result.stderr and "name another folder" in result.stderr
