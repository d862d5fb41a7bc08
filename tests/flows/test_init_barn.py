"""`vastflow init barn`: the BARN benchmark's data as a campaign."""

import gzip
import re
from pathlib import Path

import numpy as np
import pytest
from command_line import called, refused
from packed_barn import CELLS, CENTERS_M, packed
from table import each_row

from vastflow.flows.cli.barn import barn_worlds
from vastflow.flows.request.campaign_file import read_campaign
from vastflow.oracles.observation.situation import situation_of
from vastflow.producers.instantiation.instantiate import instantiate
from vastflow.sim.model.faults import ScenarioError
from vastflow.sim.model.scenario import Scenario
from vastflow.sim.reading.checked import checked_of
from vastflow.sim.world.world import world_at

ROOT = Path(__file__).parents[2]
NAV2 = "nav2.yaml"
LAYERS = "plugins: [i], i: {plugin: 'nav2_costmap_2d::InflationLayer'}"
WITHOUT_MAP = f"""\
bt_navigator: {{ros__parameters: {{global_frame: odom}}}}
local_costmap/local_costmap: {{ros__parameters: {{global_frame: odom, rolling_window: true, {LAYERS}}}}}
global_costmap/global_costmap: {{ros__parameters: {{global_frame: odom, width: 40, height: 40, {LAYERS}}}}}
"""
BENCHMARK = ROOT.parent / "shared" / "upstream" / "barn"
LENGTH_M = 10.177


@pytest.fixture(autouse=True)
def _nav2(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / NAV2).write_text(WITHOUT_MAP)


def cylinder(name, x, y, radius=0.075):
    shape = f"<geometry><cylinder><radius>{radius}</radius><length>1</length></cylinder></geometry>"
    link = f"<link name='link'><collision name='c'>{shape}</collision></link>"
    return f"<model name='{name}'><static>1</static><pose>{x} {y} 0.5 0 0 0</pose>{link}</model>"


def cloned(folder, numbers, radius=0.075):
    place = folder / "jackal_helper" / "worlds" / "BARN"
    (place / "path_files").mkdir(parents=True)
    for number in numbers:
        models = "".join(cylinder(f"c{k}", *at_m, (0.075, radius)[k]) for k, at_m in enumerate(CENTERS_M))
        (place / f"world_{number}.world").write_text(f"<sdf version='1.6'><world name='w'>{models}</world></sdf>")
        np.save(place / "path_files" / f"path_{number}.npy", np.array(CELLS))
    return folder


def initialized(folder, data, *options):
    done = called("init", folder, "--worlds", data, "--params", NAV2, *options)
    assert done.exit_code == 0, done.stdout
    return done.stdout


@each_row("make", [packed, cloned])
def test_init_barn_writes_circles_and_length_of_each_world(make, tmp_path):
    said = initialized(tmp_path / "barn", make(tmp_path / "data", range(0, 300, 100)), "--every", 100)
    assert said.splitlines()[-1] == f"vastflow run {tmp_path / 'barn' / 'barn.vast'}"
    worlds = sorted((tmp_path / "barn" / "worlds").iterdir())
    assert [world.name for world in worlds] == ["world_0.csv", "world_100.csv", "world_200.csv"]
    for world in worlds:
        found = [(body.pose.x_m, body.pose.y_m, body.shape.radius_m) for body in world_at(world).bodies]
        assert found == [(x, y, 0.075) for x, y in CENTERS_M]
    # From (-2, 3) to cell (15, 0) at (-2.325, 5.075), 3 m up, (0.45, 0.6) m on, and from (-1.875, 8.675) to (-2, 13).
    length_m = np.hypot(0.325, 2.075) + 3.0 + 0.75 + np.hypot(0.125, 4.325)
    rows = re.findall(r"- \[worlds/world_(\d+)\.csv, ([\d.]+)\]", (tmp_path / "barn" / "barn.vast").read_text())
    assert f"{length_m:.3f}" == str(LENGTH_M)
    assert rows == [(number, str(LENGTH_M)) for number in ("0", "100", "200")]


@each_row("changed", [False, True])
def test_init_barn_writes_ten_runs_of_fifty_worlds(changed, tmp_path):
    initialized(tmp_path / "barn", packed(tmp_path / "data", range(0, 300, 6)))
    file = tmp_path / "barn" / "barn.vast"
    text = file.read_text()
    if changed:
        text = re.sub(r"^      # (- OneOf|    )", r"      \1", text, flags=re.MULTILINE)
    file.write_text(text)
    campaign, oracles = read_campaign(file, strict=True)
    assert campaign.spec.execution.runs == 10
    assert [oracle.name for oracle in oracles] == ["success", "barn"]
    made = instantiate(campaign)
    assert len(made.configurations) == 50 * (6 if changed else 1)
    situation = situation_of(made.configurations[0].scenario)
    assert situation.reference_length_m == pytest.approx(LENGTH_M)
    if changed:
        asked = {
            (each.factors["controller"], *(v for k, v in each.factors.items() if "FollowPath" in k))
            for each in made.configurations
        }
        assert asked == {(c, *[v] * (2 if c == "dwb" else 1)) for c in ("mppi", "dwb", "rpp") for v in (0.5, 2.0)}


def test_reader_finds_cylinders_and_lengths_of_the_benchmark():
    if not BENCHMARK.is_dir():
        pytest.skip("the benchmark's data is not here")
    worlds = barn_worlds(BENCHMARK, 1)
    first = [worlds[number].length_m for number in range(5)]
    assert first == pytest.approx([13.43178594, 12.31249104, 12.73900461, 11.82289715, 11.86278611], abs=5e-9)
    lengths_m = [world.length_m for world in worlds.values()]
    assert (min(lengths_m), np.mean(lengths_m), max(lengths_m)) == pytest.approx((10.006, 11.452, 13.883), abs=5e-4)
    counts = [len(world.centers_m) for world in worlds.values()]
    assert (len(counts), min(counts), np.median(counts), max(counts), sum(counts)) == (300, 181, 260, 365, 78_925)


@each_row(
    ("data", "options", "message"),
    [
        (None, (), "expected a folder with the data of BARN, such as a clone of https://github.com/Daffan/the-barn-challenge"),
        (None, ("--params", NAV2), "expected a folder with the data of BARN"),
        (packed, (), "requires --params, a Nav2 file without a map such as .*/nav2.yaml .*, and no --map"),
        (packed, ("--params", NAV2, "--map", "m.yaml"), "requires --params"),
        (lambda folder: packed(folder, [0, 6]), ("--params", NAV2), "or a clone of .*, got no world 12"),
        (lambda folder: cloned(folder, [0], 0.1), ("--params", NAV2), "has others than cylinders of 0.075 m"),
        (lambda folder: folder, ("--params", NAV2), "got no world 0"),
        (packed, ("--params", ROOT / "campaigns" / "nav2" / "dwb.yaml"), "dwb.yaml: expected a robot that drives without a map"),
    ],
)  # fmt: skip
def test_init_barn_refuses_unusable_data(data, options, message, tmp_path):
    if data is not None:
        options = ("--worlds", data(tmp_path / "data", [0]) if data is packed else data(tmp_path / "data"), *options)
    said = refused("init", tmp_path / "barn", *options)
    assert re.search(message, said), said
    assert not (tmp_path / "barn").exists()


@each_row(
    "content",
    [
        b"no gzip",
        gzip.compress(b"a,b\n1,2\n"),
        gzip.compress(b"world,x,y\n0,1,two\n"),
        gzip.compress(b"world,x,y\n7,1,2\n"),
    ],
)
def test_init_barn_refuses_damaged_data(content, tmp_path):
    (packed(tmp_path / "data", range(300)) / "barn-cylinders.csv.gz").write_bytes(content)
    said = refused("init", tmp_path / "barn", "--worlds", tmp_path / "data", "--params", NAV2)
    assert said.startswith(f"{tmp_path / 'data'}: expected ") and "Traceback" not in said


@each_row("length", [0, -1.0, "long", float("inf"), None])
def test_scenario_refuses_wrong_reference_length(length):
    task = {"start_pose": {"x": 0.0, "y": 0.0}, "goal_pose": {"x": 1.0, "y": 0.0}, "reference_length": length}
    with pytest.raises(ScenarioError, match="reference_length: expected a length above 0 m, got"):
        checked_of(Scenario("builtin:navigate_to_pose", 60.0, {}, task, {}))
