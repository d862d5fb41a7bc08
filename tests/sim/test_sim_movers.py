"""Bodies that move by a rule of time, or react: places, contacts, scans, and recordings."""

import hashlib
import math
import os
import pickle
import subprocess
import sys
from dataclasses import replace

import numpy as np
import pytest
from table import each_row

from vastflow.producers.campaign import load_campaign
from vastflow.producers.instantiation.instantiate import instantiate
from vastflow.sim.loop.closed_loop import ClosedLoop
from vastflow.sim.model.blocks import write_recordings
from vastflow.sim.model.faults import FileError, ScenarioError
from vastflow.sim.model.obstacle import Obstacle, Trigger
from vastflow.sim.model.pose import Pose
from vastflow.sim.model.rates import TICK_S
from vastflow.sim.model.scenario import Scenario
from vastflow.sim.model.shape import Box, Disc
from vastflow.sim.nav2.navigator.prepared import prepare
from vastflow.sim.nav2.parameters.stack import NavParameters
from vastflow.sim.reading.checked import checked_digest, checked_of
from vastflow.sim.reading.movers import movers_of
from vastflow.sim.replay import Box as View
from vastflow.sim.replay import replay
from vastflow.sim.run import run
from vastflow.sim.world.motion import TOUCHING
from vastflow.sim.world.mover import Mover, MovingBody, ReactiveMover
from vastflow.sim.world.mover_conformance import check_mover
from vastflow.sim.world.mover_poses import MoverPoses
from vastflow.sim.world.occupancy import OccupancyMap
from vastflow.sim.world.robot_model import Lidar, Robot
from vastflow.sim.world.skip_table import skip_table_of
from vastflow.sim.world.social_force import Walls
from vastflow.sim.world.waypoints import Waypoints
from vastflow.sim.world.world import World

CROSSING = {
    "name": "cart",
    "shape": {"length_m": 0.6, "width_m": 0.4},
    "waypoints": [[3.0, 4.5], [3.0, 1.0]],
    "speed_m_s": 0.7,
    "loop": "back_and_forth",
    "pause_s": 0.4,
    "start_s": 0.3,
}
ROUND = {
    "name": "person 2",
    "shape": {"radius_m": 0.25},
    "waypoints": [[6.0, 1.0], [7.5, 1.0], [7.5, 2.5]],
    "speed_m_s": 1.2,
    "loop": "around",
}
VIEW = View(0.0, 0.0, 8.0, 5.0)


def scenario_in(map_file, movers=(CROSSING, ROUND), goal=(7.0, 4.0), timeout_s=8.0, **more):
    environment = {"map_file": map_file, **({"movers": list(movers)} if movers else {}), **more}
    task = {"start_pose": {"x": 1.5, "y": 2.0}, "goal_pose": {"x": goal[0], "y": goal[1], "yaw": 0.5}}
    return Scenario("builtin:navigate_to_pose", timeout_s, environment, task, {})


def cart_by_hand(t_s):
    """Pose 3.5 m down and up at 0.7 m/s from 0.3 s on, 0.4 s at either end."""
    t_s = math.fmod(max(t_s - 0.3, 0.0), 2 * 5.4)
    down_m = 0.7 * t_s if t_s < 5.0 else 3.5 if t_s < 5.4 else 3.5 - 0.7 * (t_s - 5.4) if t_s < 10.4 else 0.0
    return 3.0, 4.5 - down_m, -math.pi / 2


def person_by_hand(t_s):
    """A triangle of 1.5 m, 1.5 m, and its diagonal, at 1.2 m/s."""
    gone_m, diagonal_m = 1.2 * t_s, 1.5 * math.sqrt(2)
    gone_m = math.fmod(gone_m, 3.0 + diagonal_m)
    if gone_m < 1.5:
        return 6.0 + gone_m, 1.0, 0.0
    if gone_m < 3.0:
        return 7.5, 1.0 + gone_m - 1.5, math.pi / 2
    back_m = (gone_m - 3.0) / math.sqrt(2)
    return 7.5 - back_m, 2.5 - back_m, -3 * math.pi / 4


@pytest.fixture(scope="module")
def recording(two_rooms):
    return run(scenario_in(two_rooms), 0, 7)


def test_recording_has_the_poses_of_movers_at_its_rows(recording):
    t_s = recording.columns["t_ms"] * 1e-3
    assert len(t_s) > 60
    for name, by_hand in (("cart", cart_by_hand), ("person 2", person_by_hand)):
        found = np.column_stack([recording.columns[f"mover_{part}/{name}"] for part in ("x_mm", "y_mm", "yaw_mrad")])
        assert found.dtype == np.int32
        np.testing.assert_allclose(found, [[1e3 * part for part in by_hand(t)] for t in t_s], atol=0.51)
    assert not {event.kind for event in recording.run.events} & {"spawned", "obstacle_moved"}


def test_scan_ends_on_a_mover_where_it_is(two_rooms):
    ticks = {20: VIEW, 60: VIEW, 90: VIEW}
    for snapshot in replay(scenario_in(two_rooms, [CROSSING]), 0, 7, ticks).snapshots:
        x_m, y_m, _ = cart_by_hand(2 * (snapshot.moment.tick // 2) * TICK_S)
        off_m = np.abs(snapshot.scan_xy_m - (x_m, y_m)) - (0.2, 0.3)
        on = np.abs(off_m.max(axis=1)) < 0.02
        assert on.sum() > 3
        (outline,) = snapshot.obstacles
        np.testing.assert_allclose(
            outline[:-1].mean(axis=0) if len(outline) == 5 else outline.mean(axis=0), (x_m, y_m), atol=0.04
        )


def test_mover_is_in_the_digest_of_the_environment_and_changes_the_run(two_rooms, recording):
    plain, slower = scenario_in(two_rooms, ()), scenario_in(two_rooms, [{**CROSSING, "speed_m_s": 0.6}, ROUND])
    digests = {each.situation_digest for each in (plain, slower, scenario_in(two_rooms))}
    assert len(digests) == 3
    assert len({checked_digest(each) for each in (plain, slower, scenario_in(two_rooms))}) == 3
    assert run(plain, 0, 7).columns.keys() == {name for name in recording.columns if not name.startswith("mover_")}


AGAIN = """
import hashlib, pickle, sys
from vastflow.sim.model.blocks import write_recordings
from vastflow.sim.run import run
scenario = pickle.load(open(sys.argv[1], "rb"))
print(hashlib.sha256(write_recordings([run(scenario, i, 7) for i in range(2)])).hexdigest())
"""


def test_run_with_movers_has_equal_bytes_alone_batched_and_elsewhere(two_rooms, recording, tmp_path):
    scenario = scenario_in(two_rooms)
    batch = [run(scenario, i, 7) for i in (1, 0)]
    assert batch[1].digest == recording.digest != batch[0].digest
    here = hashlib.sha256(write_recordings(batch[::-1])).hexdigest()
    (tmp_path / "scenario").write_bytes(pickle.dumps(scenario))
    command = [sys.executable, "-c", AGAIN, str(tmp_path / "scenario")]
    there = subprocess.run(command, capture_output=True, text=True, env=os.environ, check=True, timeout=300).stdout
    assert there.strip() == here


FLOOR = OccupancyMap(np.zeros((120, 160), dtype=np.int8), 0.05, (0.0, 0.0))
WALLS = Walls(skip_table_of(FLOOR.occupied), 0.05, 0.0, 0.0, np.zeros((0, 7)))


def loop_with(movers, obstacles=(), at=(4.0, 3.0), timeout_s=20.0, occupancy=FLOOR, radius_m=0.17):
    parameters, lidar, robot = NavParameters(), Lidar(), Robot(radius_m=radius_m)
    prepared = prepare(World(occupancy), lidar, parameters)
    return ClosedLoop(prepared, parameters, lidar, robot, Pose(*at), obstacles, [7, 1, 0], timeout_s, movers)


def test_phase_is_drawn_for_each_run_and_equal_for_two_systems(two_rooms):
    late = {**CROSSING, "phase_s": 4.0, "start_s": 6.0}
    given_scenario = scenario_in(two_rooms, [late, {**late, "name": "cart 2"}], timeout_s=7.0)
    leaves_s = []
    for scenario in (given_scenario, replace(given_scenario, system={"controller": "dwb"})):
        for index in (0, 1, 2, 0):
            found = run(scenario, index, 7).columns
            for name in ("cart", "cart 2"):
                leaves_s.append(found["t_ms"][np.argmax(found[f"mover_y_mm/{name}"] < 4500 - 10)] * 1e-3)
    assert leaves_s[:8] == leaves_s[8:] and leaves_s[:2] == leaves_s[6:8]
    assert len(set(leaves_s)) == 6
    assert all(2.0 <= leaves <= 6.2 for leaves in leaves_s)


DRUM = Disc(0.25)


def through(y_m=3.0, speed_m_s=0.5, shape=DRUM, **more):
    return MovingBody("cart", shape, Waypoints(waypoints=((2.0, y_m), (6.0, y_m)), speed_m_s=speed_m_s, **more))


@each_row(("shape", "half_m"), [(Disc(0.25), 0.25), (Box(0.6, 0.4), 0.3)])
def test_mover_pushes_a_robot_that_stands_in_its_way(shape, half_m):
    loop = loop_with([through(shape=shape)])
    loop.advance()
    (contact,) = [event for event in loop.events if event.kind == "contact"][:1]
    meets_s = (2.0 - half_m - 0.17) / 0.5
    assert (contact.what, contact.t_s) == ("cart", pytest.approx(meets_s, abs=0.05))
    assert contact.value == pytest.approx(0.5, abs=0.02)
    # It ends at x = 6 m, and the robot before it.
    x_m, y_m, _ = loop.body.pose
    assert (x_m, y_m) == (pytest.approx(6.0 + half_m + 0.17, abs=0.03), pytest.approx(3.0, abs=0.02))


def test_beam_has_the_distance_to_a_mover_at_the_scan():
    loop = loop_with([through()], timeout_s=2.0)
    for tick in (2, 10, 20):
        loop.advance(tick + 1)
        nearest_m = float(loop.stack.m[0]["ranges"][:360].min())
        # The scanner is 4 cm behind the robot's center, the cart's rim 25 cm ahead of the cart's.
        assert nearest_m == pytest.approx(4.0 - 0.04 - (2.0 + 0.5 * tick * TICK_S + 0.25), abs=1e-3)


def test_mover_that_passes_by_touches_nothing():
    loop = loop_with([through(y_m=3.0 + 0.25 + 0.17 + 0.005)])
    loop.advance()
    assert not loop.events
    assert loop.body.pose.tolist() == [4.0, 3.0, 0.0]


def test_fast_mover_meets_the_robot_between_two_ticks():
    loop = loop_with([through(speed_m_s=9.0)], timeout_s=1.0)
    loop.advance()
    assert [event.kind for event in loop.events][:1] == ["contact"]
    assert loop.events[0].value == pytest.approx(9.0, rel=0.05)
    assert loop.events[0].t_s == pytest.approx((2.0 - 0.25 - 0.17) / 9.0, abs=0.0101)


def test_mover_starts_again_and_pushes_the_robot_that_it_stopped_at():
    way = Waypoints(waypoints=((2.0, 3.0), (3.59, 3.0), (5.0, 3.0)), speed_m_s=0.5, pause_s=3.0)
    loop = loop_with([MovingBody("cart", Disc(0.25), way)], timeout_s=12.0)
    loop.advance(round(5.0 / TICK_S))
    stopped_m = loop.body.pose[0]
    assert stopped_m == pytest.approx(3.59 + 0.42, abs=0.005)
    loop.advance()
    assert loop.body.pose[0] == pytest.approx(5.0 + 0.42, abs=0.03)


def test_mover_comes_to_a_robot_that_touches_a_thing_at_rest():
    way = Waypoints(waypoints=((4.0, 1.0), (4.0, 5.0)), speed_m_s=0.5)
    loop = loop_with([MovingBody("cart", DRUM, way)], timeout_s=5.0)
    loop.spawn(Obstacle("crate", Box(0.3, 0.3), Pose(4.0 + 0.17 + 0.15 - 0.001, 3.0)), False)
    loop.advance(20)
    assert loop._physics.hold == TOUCHING
    loop.advance()
    assert [event.what for event in loop.events if event.kind == "contact"][:2] == ["crate", "cart"]
    assert loop.body.pose[1] == pytest.approx(1.0 + 0.5 * 5.0 + 0.42, abs=0.03)


def test_mover_pushes_an_obstacle_far_from_the_robot():
    carton = Obstacle("carton", Box(0.4, 0.4), Pose(4.0, 3.0), Trigger(4.0, 1.0, 3.0), 2.0)
    loop = loop_with([through()], [carton], at=(4.0, 0.6))
    loop.advance()
    assert loop.body.obstacles[1, 0] == pytest.approx(6.0 + 0.25 + 0.2, abs=0.05)
    assert next(event.kind for event in loop.events) == "spawned"


class Follows(ReactiveMover):
    """Goes toward the robot at 1 m/s, and stops a meter before it."""

    def begin(self):
        return 1.0, 3.0, 0.0

    def step(self, sight, dt_s):
        x_m, y_m, yaw_rad = sight.own
        return (x_m + dt_s if sight.robot[0] - x_m > 1.0 + dt_s / 2 else x_m), y_m, yaw_rad


def test_body_that_reacts_sees_the_robot_and_itself_at_each_tick():
    loop = loop_with([MovingBody("dog", Disc(0.2), Follows())], timeout_s=4.0)
    loop.advance(10)
    assert loop.body.obstacles[0, 0] == pytest.approx(1.0 + 9 * TICK_S)
    loop.advance()
    loop.conclude()
    assert loop.movers.columns_at(np.array([0, 500, 4000]))["mover_x_mm/dog"].tolist() == [1000, 1500, 3000]


def test_poses_are_recorded_in_the_frame_of_a_turned_map():
    turned = OccupancyMap(np.zeros((120, 160), dtype=np.int8), 0.05, (1.0, -2.0), 0.6)
    loop = loop_with([through()], timeout_s=1.0, occupancy=turned)
    loop.advance()
    found = loop.movers.columns_at(np.array([0, 1000]))
    assert [found[f"mover_{part}/cart"].tolist() for part in ("x_mm", "y_mm", "yaw_mrad")] == [
        [2000, 2500],
        [3000, 3000],
        [0, 0],
    ]
    x_m, y_m = turned.frame.to_map(*loop.body.obstacles[0, :2])
    assert (x_m, y_m) == (pytest.approx(2.475), pytest.approx(3.0))


@each_row(
    ("loop", "t_s", "place"),
    [
        ("once", 0.0, (0.0, 0.0, 0.0)),
        ("once", 0.5, (0.0, 0.0, 0.0)),
        ("once", 2.0, (1.5, 0.0, 0.0)),
        ("once", 2.75, (2.0, 0.0, math.pi / 8)),
        ("once", 3.5, (2.0, 0.0, math.pi / 2)),
        ("once", 4.5, (2.0, 1.0, math.pi / 2)),
        ("once", 99.0, (2.0, 1.0, math.pi / 2)),
        ("back_and_forth", 5.5, (2.0, 1.0, math.pi / 2)),
        ("back_and_forth", 6.0, (2.0, 0.5, math.pi / 2)),
        ("back_and_forth", 8.5, (1.0, 0.0, 0.0)),
        ("back_and_forth", 10.5 + 1.0, (1.0, 0.0, 0.0)),
        ("around", 5.5 + math.sqrt(5) / 2, (1.0, 0.5, math.atan2(-1, -2))),
    ],
)
def test_waypoints_are_passed_at_their_times(loop, t_s, place):
    # 2 m and 1 m at 1 m/s from 0.5 s on, a second's pause at each: turns in the pause, and goes back backwards.
    rule = Waypoints(waypoints=((0.0, 0.0), (2.0, 0.0), (2.0, 1.0)), loop=loop, pause_s=1.0, start_s=0.5)
    found = rule.pose_at(t_s)
    assert found[:2] == pytest.approx(place[:2], abs=1e-9)
    assert math.remainder(found[2] - place[2], math.tau) == pytest.approx(0.0, abs=1e-9)


def test_waypoint_rules_conform():
    for loop in ("once", "back_and_forth", "around"):
        check_mover(Waypoints(waypoints=((0.0, 0.0), (2.0, 0.0), (2.0, 1.0)), loop=loop, pause_s=0.7, start_s=0.5))


class Jumps(Waypoints):
    def pose_at(self, t_s):
        return 1000.0 * (t_s > 3.0), 0.0, 0.0


class Counts(Waypoints):
    def pose_at(self, t_s):
        return 1e-3 * len(COUNTED.setdefault("asked", []).__iadd__([t_s])), 0.0, 0.0


COUNTED = {}


def test_round_that_ends_where_it_begins_has_no_further_leg():
    points = ((0.0, 0.0), (1.0, 0.0), (1.0, 1.0), (0.0, 1e-200))
    assert Waypoints(waypoints=points, loop="around").pose_at(2.0 + math.sqrt(2.0)) == (0.0, 0.0, 0.0)


@pytest.mark.parametrize("place", [(2.2e6, 0.0, 0.0), (0.0, -1e300, 0.0), (math.nan, 0.0, 0.0), (0.0, 0.0, math.inf)])
def test_rule_that_leaves_the_world_ends_the_run_with_its_name_and_time(place):
    class Leaves(Mover):
        def pose_at(self, t_s):
            return place if t_s >= 1.0 else (0.0, 0.0, 0.0)

    poses = MoverPoses((MovingBody("far", Disc(0.2), Leaves()),), FLOOR.frame, 40, WALLS)
    with pytest.raises(ScenarioError, match=r"mover 'far': expected x, y, and yaw at 1 s, got .* within 10000 m, got"):
        poses.look_ahead(0, Pose(0.0, 0.0))


def test_mover_named_as_an_obstacle_is_refused(two_rooms):
    post = {"entity_name": "cart", "model": "cylinder", "spawn_pose": {"x": 5.0, "y": 5.0}}
    given = scenario_in(two_rooms, static_objects=[post])
    with pytest.raises(ScenarioError, match="movers: expected names that no obstacle has, got 'cart'"):
        checked_of(given)


class Nowhere(Waypoints):
    def pose_at(self, t_s):
        return math.nan, 0.0, 0.0


@each_row(
    ("kind", "message"),
    [
        (Jumps, r"Jumps must not jump, got 1e\+03 m at 3.05 s"),
        (Counts, "Counts must give equal poses at equal times"),
        (Nowhere, r"Nowhere must give x, y, and yaw, got \(nan"),
    ],
)
def test_conformance_finds_wrong_movers(kind, message):
    with pytest.raises(AssertionError, match=message):
        check_mover(kind(waypoints=((0.0, 0.0), (1.0, 0.0))))


def test_rule_without_a_pose_ends_the_run_with_its_name_and_time():
    body = MovingBody("ghost", Disc(0.2), Nowhere(waypoints=((0.0, 0.0), (1.0, 0.0))))
    with pytest.raises(ScenarioError, match=r"mover 'ghost': expected x, y, and yaw at 0 s, got ValueError"):
        loop_with([body])


@each_row(
    ("change", "message"),
    [
        ({"name": ""}, r"movers\[0\].name: expected letters, digits, .*, got ''"),
        ({"name": "a/b"}, r"movers\[0\].name: expected letters"),
        (
            {"shape": {"radius_m": 0}},
            r"movers\[0\].shape: expected \{radius_m: …\} or \{length_m: …, width_m: …\} above 0",
        ),
        ({"shape": {"radius_m": 0.2, "width_m": 0.2}}, r"movers\[0\].shape: expected"),
        ({"shape": {"length_m": 0.2}}, r"movers\[0\].shape: expected"),
        ({"waypoints": [[1, 2]]}, r"movers\[0\].waypoints: expected 2 items or more"),
        (
            {"waypoints": [[1, 2], [1, 2]]},
            r"movers\[0\].waypoints: expected waypoints that differ .* got \[1.0, 2.0\] again",
        ),
        (
            {"waypoints": [[1, 2], [1, 2 + 1e-9]]},
            r"waypoints: expected waypoints that differ from the one before, got \[1.0, 2.0.*\] again at index 1",
        ),
        (
            {"waypoints": [[1, 2], [1, -10_001]]},
            r"waypoints: expected waypoints within 10000 m of the origin, got \[1.0, -10001.0\] at index 1",
        ),
        ({"waypoints": [[float(k), 0.0] for k in range(100_000)]}, r"waypoints: expected .{,200}$"),
        ({"name": "wall"}, r"movers\[0\].name: expected a name that no wall or obstacle has in a report, got 'wall'"),
        ({"name": str(Disc(0.2))}, r"no wall or obstacle has in a report, got 'cylinder 0.4 m'"),
        ({"name": str(Box(0.25, 1e-5))}, r"no wall or obstacle has in a report, got 'box 0.25 x 1e-05 m'"),
        ({"waypoints": [[1, 2], [1, "far"]]}, r"movers\[0\].waypoints: expected a number at index 1"),
        ({"speed_m_s": 0}, r"movers\[0\].speed_m_s: expected a number in \[0.001, 100\], got 0"),
        ({"loop": "forth"}, r"movers\[0\].loop: expected 'once', 'back_and_forth' or 'around', got 'forth'"),
        ({"pause": 1}, r"movers\[0\].pause: unknown key; did you mean 'pause_s'"),
        ({"waypoints": None}, r"movers\[0\].waypoints: expected"),
        ({"rule": "waypoint"}, r"movers\[0\].rule: unknown mover 'waypoint'; did you mean 'waypoints'"),
        (
            {"rule": "own.py:Pacer"},
            r"movers\[0\].rule: unknown mover 'own.py:Pacer'; expected one of .*waypoints, or file.py:Class",
        ),
    ],
)
def test_wrong_mover_is_refused_with_its_place(change, message):
    with pytest.raises(ScenarioError, match=message):
        movers_of({"movers": [{**CROSSING, **change}]})


def test_list_of_movers_is_checked_as_a_whole():
    with pytest.raises(ScenarioError, match=r"movers\[1\].name: expected a name of its own, got 'cart' again"):
        movers_of({"movers": [CROSSING, CROSSING]})
    for wrong in (3, "cart", {"name": "cart"}):
        with pytest.raises(ScenarioError, match="movers: expected a list of movers, got"):
            movers_of({"movers": wrong})
    with pytest.raises(ScenarioError, match=r"movers\[0\]: expected a mapping with name, shape, and waypoints, got 3"):
        movers_of({"movers": [3]})
    without = {key: value for key, value in CROSSING.items() if key != "waypoints"}
    with pytest.raises(ScenarioError, match=r"movers\[0\].waypoints: expected a value, got none"):
        movers_of({"movers": [without]})


PACER = """
from vastflow.plugins import Mover, parameter


class Pacer(Mover):
    x_m: float
    speed_m_s: float = parameter(0.5, 0.0, 10.0)

    def pose_at(self, t_s):
        return self.x_m + self.speed_m_s * t_s, 3.0, 0.0
"""
CAMPAIGN = """
version: 1
configuration:
  - name: room
    parameters:
      - map_file: {map_file}
      - start_pose: {{x: 1.5, y: 2.0}}
      - goal_pose: {{x: 7.0, y: 4.0}}
      - movers:
          - {{name: pacer, shape: {{radius_m: 0.2}}, rule: "pacer.py:Pacer", x_m: 1.0{more}}}
"""


@pytest.fixture
def campaign_with(tmp_path, two_rooms):
    def write(more=""):
        (tmp_path / "pacer.py").write_text(PACER)
        (tmp_path / "moving.vast").write_text(CAMPAIGN.format(map_file=two_rooms.path, more=more))
        return load_campaign(tmp_path / "moving.vast")

    return write


def test_campaign_has_a_mover_of_its_own_file_in_the_environment(campaign_with):
    (configuration,) = instantiate(campaign_with(", speed_m_s: 0.25")).configurations
    (body,) = movers_of(configuration.scenario.environment)
    check_mover(body.rule)
    assert (body.name, body.shape, body.rule.pose_at(4.0)) == ("pacer", Disc(0.2), (2.0, 3.0, 0.0))
    found = run(replace(configuration.scenario, timeout_s=2.0), 0).columns
    assert found["mover_x_mm/pacer"].tolist() == [1000 + 25 * k for k in range(21)]


def test_campaign_refuses_a_wrong_mover_at_its_place(campaign_with):
    with pytest.raises(
        FileError,
        match=r"moving.vast:10:11: .*parameters\[3\].movers: movers\[0\].speed_m_s: expected a number in \[0, 10\], got 11",
    ):
        campaign_with(", speed_m_s: 11")
