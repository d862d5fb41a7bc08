"""`vastflow init --worlds`: a folder of maps and Gazebo worlds as a campaign."""

import re
import shutil

import pytest
from command_line import called, refused
from outside import SHARED
from synthetic import walled_room, write_map
from table import each_row

from vastflow.flows.cli.worlds import places_in, slug
from vastflow.flows.request.campaign_file import read_campaign
from vastflow.producers.instantiation.instantiate import instantiate
from vastflow.sim.world.environment import world_of

MRPB = SHARED / "upstream" / "mrpb"
WALLS = [(0, 2, 6, 0.2), (0, -2, 6, 0.2), (3, 0, 0.2, 4), (-3, 0, 0.2, 4)]
ACTOR = """<actor name='walker'><script><trajectory id='0' type='walking'>
<waypoint><time>0</time><pose>-1 0 0 0 0 0</pose></waypoint>
<waypoint><time>6</time><pose>2 0 0 0 0 0</pose></waypoint>
<waypoint><time>8</time><pose>2 0 0 0 0 3.14 </pose></waypoint>
<waypoint><time>20</time><pose>-1 0 0 0 0 0 -0.3</pose></waypoint></trajectory></script></actor>"""
TRIPS = """# Test 1
<arg name="initial_pose_x" default="-1.5"/> <arg name="initial_pose_y" default="0.5"/>
<arg name="initial_pose_a" default="1.571"/>
<arg name="goal_pose_x" default="1.5"/>
<arg name="goal_pose_y" default="-0.5"/>
<arg name="goal_pose_a" default="3.142"/>
"""


def room_world(file, more=""):
    boxes = "".join(
        f"<model name='wall{k}'><pose>{x} {y} 0.5 0 0 0</pose><link name='l'><collision name='c'><geometry><box><size>{w} {d} 1</size>"
        "</box></geometry></collision></link></model>"
        for k, (x, y, w, d) in enumerate(WALLS)
    )
    file.parent.mkdir(parents=True, exist_ok=True)
    file.write_text(f"<sdf version='1.6'><world name='w'>{boxes}{more}</world></sdf>")
    return file


def room_map(folder):
    return write_map(folder, walled_room(6.0, 4.0), (-3.0, -2.0))


@pytest.fixture
def data(tmp_path):
    folder = tmp_path / "data"
    room_map(folder / "maps" / "Room 1")
    room_map(folder / "maps" / "Room 1_partially_unknown")
    room_world(folder / "world" / "Room 1.world")
    room_world(folder / "world" / "Room 1_dynamic.world", ACTOR)
    (folder / "trips" / "Room 1").mkdir(parents=True)
    (folder / "trips" / "Room 1" / "config.txt").write_text(TRIPS)
    (folder / "params.yaml").write_text("DWAPlannerROS: {max_vel_x: 0.55}\n")
    return folder


def written(folder, *options):
    done = called("init", folder, "--worlds", *options)
    assert done.exit_code == 0, done.output
    campaign, _ = read_campaign(folder / f"{slug(folder.name)}.vast", strict=True)
    made = instantiate(campaign)
    assert not made.rejections, made.rejections
    return done.stdout, {each.family: each for each in made.configurations}


def test_init_pairs_maps_worlds_and_trips_by_name(data, tmp_path):
    said, by_family = written(tmp_path / "my rooms", data)
    assert said.splitlines()[0] == f"wrote {tmp_path / 'my rooms' / 'my-rooms.vast'}, now run it:"
    assert {*by_family} == {"room-1", "room-1-partially-unknown", "room-1-dynamic"}
    for name, found in by_family.items():
        environment = found.scenario.environment
        known = "Room 1_partially_unknown" if "unknown" in name else "Room 1"
        assert f"/{known}/map.yaml" in environment["map_file"].path
        stands = "Room 1_dynamic.world" if "dynamic" in name else "Room 1.world"
        assert environment["world"].path.endswith(stands)
        assert len(world_of(environment).bodies) == 4
    start, goal = (by_family["room-1"].scenario.task[key] for key in ("start_pose", "goal_pose"))
    assert start == {"x": -1.5, "y": 0.5, "yaw": 1.571} and goal == {"x": 1.5, "y": -0.5, "yaw": 3.142}


def test_actor_walks_its_round_in_its_time(data):
    """3 m there and 3 m back in 20 s; waypoints in one place are pauses."""
    places, left_out = places_in(data)
    (walker,) = next(place.movers for place in places if place.movers)
    assert walker["waypoints"] == [[-1.0, 0.0], [2.0, 0.0], [-1.0, 0.0]]
    assert (walker["name"], walker["speed_m_s"], walker["loop"]) == ("walker", 0.3, "around")
    assert left_out == []


def test_walk_begins_at_time_of_its_first_waypoint(data):
    room_world(data / "world" / "Room 1_dynamic.world", ACTOR.replace("<time>0<", "<time>4<"))
    (walker,) = next(place.movers for place in places_in(data)[0] if place.movers)
    assert walker["speed_m_s"] == 6.0 / 16.0


def test_world_with_actors_warns_without_movers(data, tmp_path):
    file = tmp_path / "own.vast"
    places = f"      - map_file: {data}/maps/Room 1/map.yaml\n      - world: {data}/world/Room 1_dynamic.world\n"
    poses = "      - start_pose: {x: -1.5, y: 0.5}\n      - goal_pose: {x: 1.5, y: -0.5}\n"
    file.write_text(
        f"version: 1\nmetadata: {{name: own}}\nconfiguration:\n  - name: own\n    parameters:\n{places}{poses}"
    )
    done = called("validate", file)
    assert done.exit_code == 0 and "The world's actors are no bodies: walker." in done.output, done.output
    file.write_text(f"{file.read_text()}      - movers: []\n")
    assert "actors" not in called("validate", file).output


def test_partially_unknown_map_has_other_map_as_world(data, tmp_path):
    shutil.rmtree(data / "world")
    _, by_family = written(tmp_path / "rooms", data)
    environment = by_family["room-1-partially-unknown"].scenario.environment
    assert environment["world"].path.endswith("/Room 1/map.yaml")
    assert "world" not in by_family["room-1"].scenario.environment


def test_world_without_map_gets_one_where_robot_needs_it(tmp_path):
    file = room_world(tmp_path / "data" / "hall.world")
    _, by_family = written(tmp_path / "halls", file.parent)
    world = world_of(by_family["hall"].scenario.environment)
    assert world.map.shape == world.walls.shape and (world.map.cells == world.walls.cells).all()
    no_map = tmp_path / "no_map.yaml"
    layers = "plugins: [obstacle_layer], obstacle_layer: {plugin: nav2_costmap_2d::ObstacleLayer, observation_sources: scan, scan: {topic: /scan}}"
    no_map.write_text(
        "bt_navigator: {ros__parameters: {global_frame: odom}}\n"
        f"local_costmap: {{local_costmap: {{ros__parameters: {{global_frame: odom, rolling_window: true, {layers}}}}}}}\n"
        f"global_costmap: {{global_costmap: {{ros__parameters: {{global_frame: odom, width: 30, height: 30, {layers}}}}}}}\n"
    )
    _, by_family = written(tmp_path / "unknown", file.parent, "--params", no_map)
    assert "map_file" not in by_family["hall"].scenario.environment and not (tmp_path / "unknown" / "maps").exists()


def test_trips_without_map_or_world_of_their_name_are_left_out(data):
    """People of a dynamic world that is not there would be missing in the base's."""
    (data / "world" / "Room 1_dynamic.world").unlink()
    shutil.copytree(data / "trips" / "Room 1", data / "trips" / "Room 1_dynamic")
    places, left_out = places_in(data)
    assert {place.name for place in places} == {"room-1", "room-1-partially-unknown"}
    assert left_out == ["room-1-dynamic: There are starts and goals, and no map or world of this name."]


def test_init_lists_files_it_leaves_out(data, tmp_path):
    (data / "maps" / "Room 1_partially_unknown" / "map.pgm").write_bytes(b"P5")
    cone = "<collision name='c'><geometry><mesh><uri>model://cone/cone.dae</uri></mesh></geometry></collision>"
    room_world(data / "world" / "Room 1.world", f"<model name='cone'><link name='l'>{cone}</link></model>")
    room_map(data / "narrow" / "Room 1")
    room_world(data / "world" / "odd.world", ACTOR.replace("20</time>", "soon</time>"))
    said, by_family = written(tmp_path / "rooms", data)
    left_out = [line for line in said.splitlines() if line.startswith("left out: ")]
    assert len(left_out) == 4 and {*by_family} == {"room-1", "room-1-dynamic"}
    for file, why in (
        ("maps/Room 1_partially_unknown/map.yaml", "the picture is damaged|expected a picture"),
        ("world/Room 1.world", "cone::l::c: There is no file 'cone/cone.dae' beside the world"),
        ("narrow/Room 1/map.yaml|maps/Room 1/map.yaml", "is the first of this name"),
        ("world/odd.world", "could not convert string to float: 'soon'"),
    ):
        assert any(re.search(f"(?i)({file}): .*({why})", line) for line in left_out), (file, left_out)


@each_row(
    ("content", "options", "message"),
    [
        (None, (), "data: expected maps of map_server or Gazebo worlds, got none"),
        ("<sdf", (), r"expected maps of map_server or Gazebo worlds, got: .*/bad.world:1:\d+: "),
        ("<sdf><world/></sdf>", (), "got: .*/bad.world: The world has no body that a robot could meet"),
        (None, ("--map", "m.yaml"), "--worlds: expected no --map beside it, got both"),
    ],
)
def test_init_refuses_folder_without_places(content, options, message, tmp_path):
    (tmp_path / "data").mkdir()
    if content is not None:
        (tmp_path / "data" / "bad.world").write_text(content)
    said = refused("init", tmp_path / "own", "--worlds", tmp_path / "data", *options)
    assert re.search(message, said), said
    assert not (tmp_path / "own").exists()


def test_init_refuses_trips_with_missing_numbers(data):
    (data / "trips" / "Room 1" / "config.txt").write_text(TRIPS.rpartition("<arg")[0])
    _, left_out = places_in(data)
    assert left_out == [
        f"{data / 'trips' / 'Room 1' / 'config.txt'}: expected x, y, and yaw of starts and goals in turn, got 5 numbers"
    ]


def test_places_of_mrpb_are_driven(tmp_path):
    if not MRPB.is_dir():
        pytest.skip(
            "MRPB is not beside the repository: https://github.com/NKU-MobFly-Robotics/local-planning-benchmark"
        )
    said, by_family = written(tmp_path / "mrpb", MRPB)
    assert {*by_family} == {"maze", "office02", "office02-partially-unknown"} and "left out" not in said
    stands = {name: found.scenario.environment.get("world") for name, found in by_family.items()}
    assert stands["office02"] is None and stands["maze"].path.endswith("maze.world")
    assert stands["office02-partially-unknown"].path.endswith("office02/map.yaml")
    unknown = by_family["office02-partially-unknown"].scenario.environment
    world = world_of(unknown)
    assert world.walls.occupied.sum() > 1.1 * world.map.occupied.sum()  # the robot meets walls that it does not know
