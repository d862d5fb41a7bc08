"""Campaigns in worlds of which the robot has no map."""

import json

import numpy as np
import pytest
from command_line import called, refused
from PIL import Image
from table import each_row

from vastflow.flows.plan.plan import plan_view_of
from vastflow.flows.request.campaign_file import read_campaign
from vastflow.flows.results.inputs import inputs_of
from vastflow.flows.results.results import _write_environments
from vastflow.flows.results.tables import configuration_row
from vastflow.oracles.results.units import units_of
from vastflow.producers.campaign import load_campaign
from vastflow.producers.instantiation.instantiate import instantiate
from vastflow.producers.places.ground import ground_of
from vastflow.sim.reading.checked import checked_of
from vastflow.sim.world.environment import ground_file, world_of

PROGRAM = "import osc.helpers\nscenario go:\n    timeout(20s)\n    do serial:\n        run_process('true')\n"
VAST = """\
version: 1
configuration:
  - name: posts
    parameters:
      - world: {world}
    variations:
      - PathVariationRandom: {{path_length: 3.0, num_paths: 4, robot_diameter: 0.5, seed: 1}}
{more}
execution: {{scenario_file: go.osc, runs: 1}}
"""
CIRCLES = "".join(f"{x},{y},0.3\n" for x in range(-3, 4) for y in (-3, 3)) + "".join(
    f"{x},{y},0.3\n" for x in (-3, 3) for y in range(-2, 3)
)
BOX = "<collision name='{name}'><pose>{pose} 0.5 0 0 0</pose><geometry><box><size>{size} 1</size></box></geometry></collision>"
WALLS = {"n": ("0 3", "6.2 0.2"), "s": ("0 -3", "6.2 0.2"), "e": ("3 0", "0.2 6.2"), "w": ("-3 0", "0.2 6.2")}
BOXES = "".join(BOX.format(name=name, pose=pose, size=size) for name, (pose, size) in WALLS.items())
WORLDS = {
    "posts.csv": CIRCLES,
    "room.sdf": f"<sdf version='1.9'><world name='w'><model name='m'><link name='l'>{BOXES}</link></model></world></sdf>",
}
each_world = each_row("world", [*WORLDS])


@pytest.fixture
def campaign(tmp_path, monkeypatch):
    """A function that writes the campaign of a world without a map, and returns its file."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("VASTFLOW_STORE", str(tmp_path / "store"))
    (tmp_path / "go.osc").write_text(PROGRAM)

    def write(world, more="", execution=None):
        (tmp_path / world).write_text(WORLDS[world])
        text = VAST.format(world=world, more=more)
        (tmp_path / "c.vast").write_text(text if execution is None else f"{text.partition('execution')[0]}{execution}")
        return tmp_path / "c.vast"

    return write


@each_world
def test_world_without_map_is_validated_planned_and_drawn(campaign, world):
    file = campaign(world)
    assert called("validate", file).exit_code == 0
    planned = called("plan", file, "--pictures", 1, "--json")
    assert planned.exit_code == 0, planned.stderr
    found = json.loads(planned.stdout)
    assert found["coverage"]["realized"] == 4
    with Image.open(found["pictures"][0]) as picture:
        assert picture.format == "PNG"


@each_world
def test_paths_are_drawn_on_ground_of_world_without_map(campaign, world):
    more = "      - ObstacleVariation: {obstacle_configs: [{amount: 2, max_distance: 0.5, args: ''}], robot_diameter: 0.5, seed: 1}\n"
    more += "    constraints:\n      - roomy: start_clearance >= 0.25\n"
    made = instantiate(load_campaign(campaign(world, more))).configurations
    assert len(made) == 4
    for each in made:
        environment, task = each.scenario.environment, each.scenario.task
        world = world_of(environment)
        assert world.map is None and len(environment["static_objects"]) == 2
        ground = ground_of(ground_file(environment), 0.5)
        for pose in (task["start_pose"], *task["goal_poses"]):
            place = pose["position"]
            assert ground.stands(place["x"], place["y"])
        assert plan_view_of(each).world.walls.digest == world.walls.digest


@each_world
def test_mission_in_world_without_map_is_one_sentence_at_its_line(campaign, world):
    said = refused("validate", campaign(world, execution="execution: {runs: 1}\n"))
    assert said.count("c.vast:") == 1
    assert "c.vast:5:9: configuration[0].parameters[0].world: A navigation mission needs a map to localize on" in said
    assert "Name what it knows as map_file, or drive a robot that needs no map." in said


def test_mission_in_varied_worlds_without_map_is_refused_at_producer(campaign):
    file = campaign("posts.csv", execution="execution: {runs: 1}\n")
    varied = "    variations:\n      - ParameterVariationList: {name: world, values: [posts.csv]}\n"
    file.write_text(file.read_text().replace("    parameters:\n      - world: posts.csv\n    variations:\n", varied))
    assert (
        "c.vast:5:9: configuration[0].variations[0].ParameterVariationList: A navigation mission needs a map"
        in refused("validate", file)
    )


@each_world
def test_bodies_move_in_world_without_map(campaign, world):
    more = (
        "      - CrossingVariation: {robot_diameter: 0.5, encounter_s: 4.0, angle_deg: 90, run_up: 0.3}\n"
        "      - PedestrianVariation: {amount: 2, route: 2.0, seed: 1}\n"
        "      - MoverVariation: {name: cart, waypoints: [[-1.0, 0.0], [1.0, 0.0]]}\n"
    )
    made = instantiate(load_campaign(campaign(world, more))).configurations
    assert made and all(len(each.scenario.environment["movers"]) == 4 for each in made)
    outside = "      - MoverVariation: {waypoints: [[-2.0, 0.0], [9.0, 0.0]]}\n"
    rejected = instantiate(load_campaign(campaign(world, outside))).rejections
    assert {each.reason for each in rejected} == {"mover would stand in a wall at [9.0, 0.0]"}


def test_worlds_without_map_are_varied_like_any_value(campaign, tmp_path):
    """The constraint is of each world's own ground."""
    (tmp_path / "room.sdf").write_text(WORLDS["room.sdf"])
    file = campaign("posts.csv", "    constraints:\n      - roomy: start_clearance >= 0.25\n")
    text = file.read_text().replace("    parameters:\n      - world: posts.csv\n", "")
    varied = "    variations:\n      - ParameterVariationList: {name: world, values: [posts.csv, room.sdf]}\n"
    file.write_text(text.replace("    variations:\n", varied))
    made = instantiate(load_campaign(file)).configurations
    assert [len(world_of(each.scenario.environment).bodies) for each in made] == [24] * 4 + [4] * 4
    fixed = "    parameters:\n      - start_pose: {x: 0.0, y: 2.5}\n      - goal_pose: {x: 0.0, y: -2.0}\n"
    head, _, tail = text.partition("    variations:\n")
    rest = tail[tail.index("    constraints") :].replace("start_clearance >= 0.25", "start_clearance >= 0.35")
    file.write_text(f"{head}{fixed}{varied}{rest}")
    (made,) = instantiate(load_campaign(file)).configurations
    assert len(world_of(made.scenario.environment).bodies) == 4  # the post is 0.2 m away, and the wall 0.4 m


def test_start_beyond_world_without_map_is_rejected_with_its_bounds(campaign):
    more = "      - ParameterVariationList: {name: start_pose, values: [{x: 9.0, y: 0.0}]}\n"
    (rejected, *_) = instantiate(load_campaign(campaign("posts.csv", more))).rejections
    assert "lies outside of the world, from (-5.3, -5.3) to (5.3, 5.3)" in rejected.reason


def test_units_of_worlds_without_map_are_worlds():
    task = {"start_pose": {"x": 1.0}}
    rows = [{"environment": {"world": {"file": name}}, "task": task} for name in "abc"]
    assert units_of(rows).noun == "map"


def test_campaign_directory_keeps_walls_of_world_without_map(campaign, tmp_path):
    found, oracles = read_campaign(campaign("room.sdf"))
    made = instantiate(found).configurations
    _write_environments(tmp_path / "environments", inputs_of(found, oracles).worlds, made)
    (folder,) = (tmp_path / "environments").iterdir()
    assert folder.name == made[0].scenario.environment["world"].digest == configuration_row(made[0])["environment"]
    with Image.open(folder / "map.pgm") as picture:
        assert np.count_nonzero(np.asarray(picture) == 0) == world_of(made[0].scenario.environment).walls.occupied.sum()


def test_paths_are_drawn_on_world_beside_a_map_where_producer_asks(campaign, tmp_path):
    """The map has no path, for all of it is unknown."""
    (tmp_path / "gray.pgm").write_bytes(b"P5 240 240 255\n" + bytes([205] * 240 * 240))
    (tmp_path / "gray.yaml").write_text("{image: gray.pgm, resolution: 0.05, origin: [-6, -6, 0], free_thresh: 0.196}")
    file = campaign("posts.csv")
    text = file.read_text().replace("- world:", "- map_file: gray.yaml\n      - world:")
    file.write_text(text)
    assert not instantiate(load_campaign(file)).configurations
    file.write_text(text.replace("seed: 1", "seed: 1, map_file: '@world'"))
    assert len(instantiate(load_campaign(file)).configurations) == 4


OF_COSTMAP = "plugins: [i], i: {plugin: 'nav2_costmap_2d::InflationLayer'}"
WITHOUT_MAP = f"""\
bt_navigator: {{ros__parameters: {{global_frame: odom}}}}
local_costmap: {{local_costmap: {{ros__parameters: {{global_frame: odom, rolling_window: true, {OF_COSTMAP}}}}}}}
global_costmap: {{global_costmap: {{ros__parameters: {{global_frame: odom, width: 40, height: 40, {OF_COSTMAP}}}}}}}
"""


@each_row(
    ("goal", "words"),
    [
        ("{x: 2.0, y: 1.0}", ""),
        ("{x: 2.0, y: 9.0}", ""),  # beyond all posts, where nothing stands
        ("{x: 3.0, y: 1.0}", "lies in a wall"),
    ],
)
def test_mission_of_robot_without_map_needs_world_alone(campaign, goal, words):
    file = campaign("posts.csv", execution="execution: {nav2_params: nav2.yaml, runs: 1}")
    file.with_name("nav2.yaml").write_text(WITHOUT_MAP)
    begins, _, ends = file.read_text().partition("    variations:")
    poses = f"      - start_pose: {{x: 0.0, y: 0.0}}\n      - goal_pose: {goal}\n"
    file.write_text(f"{begins}{poses}execution{ends.partition('execution')[2]}")
    if words:
        result = called("validate", file)
        assert result.exit_code == 2 and words in result.stderr
        return
    assert called("validate", file).exit_code == 0
    family = load_campaign(file).families[0]
    (found,) = instantiate(load_campaign(file)).configurations
    assert family.drives and checked_of(found.scenario).robot.world_file is None
