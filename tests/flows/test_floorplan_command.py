"""The commands about floor plans, as a user meets them."""

import hashlib
import json
import re
import shutil
from pathlib import Path

import pytest
from command_line import called, refused
from PIL import Image

from vastflow.sim.world.map_file import load_map

EXAMPLE = Path(__file__).parents[1] / "producers" / "test_floorplan_example.fpm"

OFFICE_WING = Path(__file__).parents[2] / "campaigns" / "floorplans" / "office_wing.fpm"


@pytest.fixture
def plan(tmp_path):
    for suffix in (".fpm", ".variation"):
        shutil.copy(EXAMPLE.with_suffix(suffix), tmp_path)
    return tmp_path / EXAMPLE.name


def run(*arguments):
    return called("floorplan", *arguments)


def test_render_writes_map_mesh_picture_plan_and_provenance(plan, tmp_path):
    out = tmp_path / "out"
    result = run("render", plan, "--out", out)
    written = {str(file.relative_to(out)) for file in out.rglob("*") if file.is_file()}
    names = ("maps/flat.yaml", "maps/flat.pgm", "3d-mesh/flat.stl", "flat.png", "fpm/flat.fpm")
    assert written == {*names, "flat.provenance.json"}
    assert (result.exit_code, result.stderr) == (0, "")
    assert {Path(line) for line in result.stdout.splitlines()} == {out / name for name in written}
    occupancy = load_map(out / "maps" / "flat.yaml")
    assert (occupancy.shape, occupancy.origin_xy_m) == ((95, 240), (-3.25, -0.5))
    with Image.open(out / "flat.png") as picture:
        assert min(picture.size) > 400
    provenance = json.loads((out / "flat.provenance.json").read_text())
    assert provenance["derived_from"] == {"file": str(plan), "sha256": hashlib.sha256(plan.read_bytes()).hexdigest()}
    assert re.match(r"vastflow \d", provenance["attributed_to"])
    assert re.match(r"\d{4}-\d\d-\d\dT.*\+00:00", provenance["created_at"])
    assert provenance["solid_volume_m3"] == pytest.approx(16.07, abs=1e-4)
    for name, sha256 in provenance["files"].items():
        assert hashlib.sha256((out / name).read_bytes()).hexdigest() == sha256


def test_render_accepts_resolution_and_laser_height(plan, tmp_path):
    assert run("render", plan, "--out", tmp_path, "--resolution", 0.1, "--laser-height", 0.7).exit_code == 0
    header = (tmp_path / "maps" / "flat.yaml").read_text()
    assert "resolution: 0.1" in header and "laser_height: 0.7" in header


def test_geometry_prints_only_json(plan):
    result = run("geometry", plan)
    found = json.loads(result.stdout)
    assert result.exit_code == 0
    assert {"spaces", "walls", "obstacles", "openings"} <= set(found)
    assert found["spaces"]["corridor"] == [[-2.0, 3.0], [4.0, 3.0], [4.0, 1.0], [-2.0, 1.0]]
    assert found["walls"]["corridor-wall-1"] == {
        "polygon": [[4.2, 3.2], [4.2, 0.8], [4.0, 1.0], [4.0, 3.0]],
        "height": 2.5,
    }


def test_geometry_writes_notes_to_stderr(plan):
    plan.write_text(plan.read_text().replace("spaced", "translation: y: 3 m").replace("translation: x: 0.25 m", ""))
    result = run("geometry", plan)
    assert json.loads(result.stdout)
    assert "warning: Entryway door: It does not reach corridor.walls[1]" in result.stderr


def test_variations_writes_plan_for_each_seed(plan, tmp_path):
    result = run("variations", plan.with_suffix(".variation"), "--count", 3, "--seed", 7, "--out", tmp_path / "v")
    files = [tmp_path / "v" / f"flat_{seed}.fpm" for seed in (7, 8, 9)]
    assert result.stdout.splitlines() == list(map(str, files))
    assert [re.search(r"gap = (\S+) m", file.read_text())[1] for file in files] == ["0.7", "0.7", "1.1"]
    assert all(run("geometry", file).exit_code == 0 for file in files)


def test_variations_reports_numbers_without_building_and_writes_the_others(plan, tmp_path):
    file = plan.with_suffix(".variation")
    file.write_text(file.read_text().replace("0.7, 0.9, 1.1", "0.9, -7.0"))
    result = run("variations", file, "--count", 6, "--out", tmp_path / "v")
    written = len(list((tmp_path / "v").iterdir()))
    assert result.exit_code == 0 and 0 < written < 6
    reports = result.stderr.splitlines()
    assert len(reports) == 6 - written
    assert re.search(r"\.variation: not written: flat_\d.fpm:\d+:\d+: Entryway door: The width is -7 m", reports[0])


def test_variations_warns_of_door_beside_its_wall(plan, tmp_path):
    file = plan.with_suffix(".variation")
    door = "door: {\n    location.translation.x : "
    assert door in file.read_text()
    file.write_text(file.read_text().replace(f"{door}normal(mean=0.0, std=0.1)", f"{door}uniform([9.0])"))
    result = run("variations", file, "--seed", 7, "--out", tmp_path / "v")
    assert (result.exit_code, result.stdout.strip()) == (0, str(tmp_path / "v" / "flat_7.fpm"))
    assert re.match(rf"{tmp_path}/v/flat_7.fpm:\d+:\d+: warning: Entryway door: It cuts nothing", result.stderr)


def test_floorplan_refuses_wrong_arguments(plan, tmp_path, monkeypatch, golden):
    monkeypatch.chdir(tmp_path)
    Path("there").mkdir()
    Path("there/maps").touch()
    names = {"PLAN": plan.name, "WING": OFFICE_WING, "FILE": plan.with_suffix(".variation").name}

    def faults_of(arguments):
        said = refused("floorplan", *(names.get(each, each) for each in arguments.split()))
        return [said.replace(str(tmp_path), "HERE").replace(str(OFFICE_WING), "WING")]

    golden("command_line", "floorplan", faults_of)
