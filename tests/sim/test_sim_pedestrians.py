"""Pedestrians by the social force model: its laws, what they keep off, and their runs."""

import hashlib
import math
import os
import pickle
import subprocess
import sys
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from shapely.geometry import Point

from vastflow.sim.model.blocks import write_recordings
from vastflow.sim.model.obstacle import Obstacle
from vastflow.sim.model.pose import Pose
from vastflow.sim.model.scenario import Scenario
from vastflow.sim.model.shape import Box, Disc
from vastflow.sim.run import run
from vastflow.sim.world.crowd import Crowd, Pedestrian
from vastflow.sim.world.mover import MovingBody, drawn_movers
from vastflow.sim.world.obstacle_rows import obstacle_rows
from vastflow.sim.world.occupancy import OccupancyMap
from vastflow.sim.world.skip_table import skip_table_of
from vastflow.sim.world.social_force import BIAS, FASTEST, People, Walls, interaction, walk

PLAIN = OccupancyMap(np.zeros((400, 400), dtype=np.int8), 0.05, (-10.0, -10.0))
"""20 × 20 m without a wall about (0, 0)."""
NOBODY = Pose(1e3, 1e3)


def walls_of(occupancy, *obstacles):
    corner_m = occupancy.origin_xy_m
    return Walls(skip_table_of(occupancy.occupied), occupancy.resolution_m, *corner_m, obstacle_rows(obstacles))


OPEN = walls_of(PLAIN)


def people_at(xy_m, v_mps, desired_mps=1.29, goals_m=None):
    """Each walks to a goal; without goals each stands where it is."""
    xy_m, count = np.array(xy_m, dtype=float), len(xy_m)
    indices = np.arange(count)
    return People(
        xy_m,
        np.array(v_mps, dtype=float),
        np.zeros(count),
        indices.copy(),
        np.array(xy_m if goals_m is None else goals_m, dtype=float),
        np.column_stack((indices, indices)),
        np.zeros(count, dtype=np.bool_),
        np.full(count, desired_mps),
        np.full(count, 0.25),
        np.zeros(count, dtype=np.bool_),
    )


def walked(people, ticks, bias=BIAS, walls=OPEN):
    poses = np.empty((ticks, len(people.xy_m), 3))
    walk(people, walls, np.zeros(4), bias, poses)
    return poses


coordinates = st.tuples(st.floats(-4.0, 4.0), st.floats(-4.0, 4.0))
velocities = st.tuples(st.floats(-2.0, 2.0), st.floats(-2.0, 2.0))


@given(coordinates.filter(lambda d: math.hypot(*d) > 0.05), velocities, st.sampled_from([0.0, BIAS]))
def test_force_is_opposite_for_the_other(d_m, dv_mps, bias):
    force = interaction(*d_m, *dv_mps, bias)
    assert interaction(-d_m[0], -d_m[1], -dv_mps[0], -dv_mps[1], bias) == pytest.approx(
        (-force[0], -force[1]), abs=1e-12
    )


def force_of_the_paper(d_m, dv_mps):
    """The formulas of Moussaïd and others (2009), in complex numbers."""
    d, dv = complex(*d_m), complex(*dv_mps)
    e = d / abs(d)
    vector = 2.0 * dv + e
    t = vector / abs(vector)
    reach = 0.35 * abs(vector)
    theta = math.atan2((e / t).imag, (e / t).real) + 0.005 * reach
    braking = -4.5 * math.exp(-abs(d) / reach - (3.0 * reach * theta) ** 2)
    turning = -4.5 * math.copysign(1.0, theta) * math.exp(-abs(d) / reach - (2.0 * reach * theta) ** 2)
    force = braking * t + turning * (1j * t)
    return force.real, force.imag


@given(coordinates.filter(lambda d: math.hypot(*d) > 0.05), velocities)
def test_force_is_the_papers(d_m, dv_mps):
    if abs(2.0 * complex(*dv_mps) + complex(*d_m) / math.hypot(*d_m)) > 1e-3:
        assert interaction(*d_m, *dv_mps, BIAS) == pytest.approx(force_of_the_paper(d_m, dv_mps), abs=1e-9)


@given(st.lists(st.tuples(coordinates, velocities), min_size=2, max_size=8))
@settings(max_examples=50)
def test_forces_between_people_leave_their_momentum(members):
    """Without goals only the relaxation slows them: the mean velocity shrinks by dt/τ a tick."""
    xy_m, v_mps = (np.array([member[k] for member in members]) for k in (0, 1))
    people = people_at(xy_m, v_mps, desired_mps=1e3)
    # Waypoints where each is: the drive is the relaxation alone for a tick.
    walked(people, 1)
    np.testing.assert_allclose(people.v_mps.mean(axis=0), v_mps.mean(axis=0) * (1 - 0.05 / 0.54), atol=1e-9)


@given(st.integers(2, 12), st.integers(0, 1000))
@settings(max_examples=30)
def test_people_at_rest_do_not_overlap(count, seed):
    """People who start within two meters stand apart at the end."""
    xy_m = np.random.default_rng(seed).uniform(-1.0, 1.0, (count, 2))
    people = people_at(xy_m, np.zeros((count, 2)), goals_m=xy_m)
    # Nobody goes back: the place that each one reached is its goal.
    for _ in range(400):
        people.points[:] = people.xy_m
        walked(people, 1)
    apart_m = np.hypot(*(people.xy_m[:, None] - people.xy_m[None]).transpose(2, 0, 1)) + 9.0 * np.eye(count)
    assert apart_m.min() > 2 * 0.25


@given(st.floats(-0.6, 0.6), st.floats(0.5, 1.6))
@settings(max_examples=30)
def test_symmetric_pair_mirrors_itself(offset_m, desired_mps):
    def pair(mirror):
        s = -1.0 if mirror else 1.0
        starts, goals = [(-4.0, s * offset_m), (4.0, -s * offset_m)], [(8.0, s * offset_m), (-8.0, -s * offset_m)]
        return people_at(starts, np.zeros((2, 2)), desired_mps, goals)

    poses = walked(pair(False), 120)
    # Half a turn takes one to the other; without the preference of a side, so does the pair's mirror image.
    np.testing.assert_allclose(poses[:, 1, :2], -poses[:, 0, :2], atol=1e-9)
    one, other = walked(pair(False), 120, 0.0), walked(pair(True), 120, 0.0)
    np.testing.assert_allclose(one[:, :, 0], other[:, :, 0], atol=1e-9)
    np.testing.assert_allclose(one[:, :, 1], -other[:, :, 1], atol=1e-9)


def test_people_who_meet_head_on_pass_on_the_right_without_a_touch():
    poses = walked(people_at([(-4.0, 0.0), (4.0, 0.0)], np.zeros((2, 2)), goals_m=[(8.0, 0.0), (-8.0, 0.0)]), 120)
    apart_m = np.hypot(*(poses[:, 0, :2] - poses[:, 1, :2]).T)
    assert 0.5 < apart_m.min() < 1.5
    # The first walks along x: on its right y is negative.
    assert poses[apart_m.argmin(), 0, 1] < -0.2
    assert poses[-1, 0, 0] > 2.0 > -2.0 > poses[-1, 1, 0]


def test_person_reaches_the_desired_speed_within_the_relaxation_time():
    people = people_at([(-5.0, 0.0)], [(0.0, 0.0)], 1.0, [(9.0, 0.0)])
    speed = np.gradient(walked(people, 100)[:, 0, 0], 0.05)
    assert speed[10] == pytest.approx(1 - math.exp(-0.55 / 0.54), abs=0.04)
    assert speed[95] == pytest.approx(1.0, abs=1e-3)


def test_person_looks_where_it_walks():
    people = people_at([(-5.0, 0.0)], [(0.0, 0.0)], goals_m=[(-2.0, 6.0)])
    assert walked(people, 40)[-1, 0, 2] == pytest.approx(math.atan2(6.0, 3.0), abs=1e-6)


def test_people_walk_no_faster_than_the_limit():
    people = people_at([(0.0, 0.0), (-1.0, 0.1)], [(3.0, 0.0), (0.0, 0.0)], 1.0, [(9.0, 0.0), (-9.0, 0.0)])
    walked(people, 1)
    assert math.hypot(*people.v_mps[0]) == pytest.approx(FASTEST * 1.0)
    assert people.xy_m[0, 0] == pytest.approx(0.05 * FASTEST, abs=1e-3)


def test_person_keeps_off_a_wall_that_its_goal_lies_behind():
    cells = np.zeros((400, 400), dtype=np.int8)
    cells[:, 260:264] = 100  # x from 3 to 3.2 m
    people = people_at([(0.0, 0.3)], [(0.0, 0.0)], goals_m=[(8.0, 0.3)])
    x_m = walked(people, 400, walls=walls_of(OccupancyMap(cells, 0.05, (-10.0, -10.0))))[:, 0, 0]
    assert 3.0 - 0.25 - 0.2 < x_m[-1] < 3.0 - 0.25
    assert x_m.max() < 3.0 - 0.25 + 1e-9  # at full speed too


@pytest.mark.parametrize("speed_mps", [0.5, 1.29, 10.0])
@pytest.mark.parametrize("shape", [Disc(0.4), Box(0.6, 1.4)])
@pytest.mark.parametrize("yaw_rad", [0.0, 0.5, 2.0])
def test_person_keeps_off_an_obstacle_that_stands(shape, yaw_rad, speed_mps):
    box = Obstacle("thing", shape, Pose(2.0, 0.1, yaw_rad))
    people = people_at([(-3.0, 0.0)], [(0.0, 0.0)], speed_mps, goals_m=[(7.0, 0.0)])
    poses = walked(people, 600, walls=walls_of(PLAIN, box))[:, 0, :2]
    footprint = box.footprint()
    least_m = min(footprint.distance(Point(*place)) for place in poses.tolist())
    assert 0.25 - 0.01 < least_m < 0.25 + 0.3  # a polygon stands for a disc here
    if isinstance(shape, Disc):
        assert poses[-1] == pytest.approx((7.0, 0.0), abs=0.31)


def crowd_of(*rules, frame=PLAIN.frame, radius_m=0.25):
    bodies = [MovingBody(f"person {k}", Disc(radius_m), rule) for k, rule in enumerate(rules)]
    return Crowd(bodies, frame, OPEN)


def test_person_avoids_the_robot_only_as_asked():
    robot, least_m = Pose(0.0, 0.02), {}
    for avoids in (False, True):
        rule = Pedestrian(waypoints=((-4.0, 0.0), (4.0, 0.0)), loop="once", avoids_robot=avoids)
        crowd = crowd_of(rule)
        poses = np.concatenate([crowd.walk(1, robot, k == 0) for k in range(160)])[:, 0]
        least_m[avoids] = float(np.hypot(poses[:, 0], poses[:, 1] - 0.02).min())
        assert poses[-1, :2] == pytest.approx((4.0, 0.0), abs=0.4)
    assert least_m[False] == pytest.approx(0.02, abs=0.01)
    assert least_m[True] > 0.25 + 0.17


def test_person_avoids_a_robot_that_comes_by_its_velocity():
    crowd = crowd_of(Pedestrian(waypoints=((0.0, 0.0),)))
    crowd.walk(1, Pose(1.05, 0.06), True)
    crowd.walk(1, Pose(1.0, 0.1), False)
    # It stands where it wants to, and the robot comes at (-1, 0.8) m/s.
    assert crowd._people.v_mps[0] == pytest.approx(np.multiply(0.05, interaction(1.0, 0.1, 1.0, -0.8, BIAS)), rel=1e-6)


@pytest.mark.parametrize(
    ("loop", "ahead_m", "place", "toward"),
    [
        ("once", 0.0, (0.0, 0.0), 1),
        ("once", 2.5, (2.0, 0.5), 2),
        ("once", 9.0, (2.0, 1.0), 2),
        ("back_and_forth", 2.5, (2.0, 0.5), 2),
        ("back_and_forth", 3.5, (2.0, 0.5), 3),
        ("back_and_forth", 5.5, (0.5, 0.0), 0),
        ("back_and_forth", 6.5, (0.5, 0.0), 1),
        ("around", 3.0 + math.sqrt(5) / 2, (1.0, 0.5), 0),
    ],
)
def test_person_begins_ahead_on_its_round(loop, ahead_m, place, toward):
    rule = Pedestrian(waypoints=((0.0, 0.0), (2.0, 0.0), (2.0, 1.0)), loop=loop, speed_m_s=1.0, phase_s=ahead_m)
    found, target = rule.begin()
    assert (found, target) == (pytest.approx(place), toward)


def test_person_with_one_waypoint_stands_and_comes_back():
    crowd = crowd_of(Pedestrian(waypoints=((1.0, 2.0),), loop="around", avoids_robot=False))
    crowd._people.v_mps[:] = 1.2, 0.0
    poses = crowd.walk(300, NOBODY, True)[:, 0]
    assert poses[0, :2] == pytest.approx((1.0, 2.0))
    assert 1.3 < poses[:, 0].max() < 1.9
    assert poses[-1, :2] == pytest.approx((1.0, 2.0), abs=0.31)


def test_turned_grid_changes_no_walk():
    rules = [Pedestrian(waypoints=((0.0, k), (6.0, 3.0 - k))) for k in (0.0, 1.0, 2.0)]
    turned = OccupancyMap(PLAIN.cells, 0.05, (-10.0, -10.0), 0.6).frame
    straight, other = (crowd_of(*rules, frame=frame).walk(200, NOBODY, True) for frame in (PLAIN.frame, turned))
    found = np.array([turned.points_to_map(np.ascontiguousarray(tick[:, :2])) for tick in other])
    np.testing.assert_allclose(found, straight[..., :2], atol=1e-6)


def test_speed_and_phase_are_drawn_for_each_run():
    bodies = [MovingBody(str(k), Disc(0.25), Pedestrian(waypoints=((0, 0), (9, 0)), phase_s=5.0)) for k in range(400)]
    one, again, other = (drawn_movers(bodies, entropy) for entropy in ([1, 2, 3], [1, 2, 3], [1, 2, 4]))
    assert one == again
    speeds, others = (np.array([body.rule.speed_m_s for body in each]) for each in (one, other))
    assert (speeds.mean(), speeds.std()) == (pytest.approx(1.29, abs=0.03), pytest.approx(0.19, abs=0.02))
    assert not np.any(speeds == others)
    phases = [body.rule.phase_s for body in one]
    assert 0.0 <= min(phases) < 0.2 and 4.8 < max(phases) < 5.0


def people_in(map_file, count=5, timeout_s=8.0, **more):
    movers = [
        {
            "name": f"person {k}",
            "shape": {"radius_m": 0.25},
            "rule": "pedestrian",
            "waypoints": [[5.5, 1.0 + 0.7 * k], [7.4, 4.0 - 0.6 * k]],
            "phase_s": 3.0,
            **more,
        }
        for k in range(count)
    ]
    task = {"start_pose": {"x": 1.5, "y": 2.0}, "goal_pose": {"x": 7.0, "y": 4.0, "yaw": 0.5}}
    return Scenario("builtin:navigate_to_pose", timeout_s, {"map_file": map_file, "movers": movers}, task, {})


AGAIN = """
import hashlib, pickle, sys
from vastflow.sim.model.blocks import write_recordings
from vastflow.sim.run import run
scenario = pickle.load(open(sys.argv[1], "rb"))
print(hashlib.sha256(write_recordings([run(scenario, i, 7) for i in range(3)])).hexdigest())
"""


@pytest.mark.parametrize("avoids", [True, False])
def test_run_with_people_has_equal_bytes_alone_batched_and_elsewhere(two_rooms, tmp_path, avoids):
    scenario = people_in(two_rooms, avoids_robot=avoids)
    batch = [run(scenario, index, 7) for index in (2, 1, 0)][::-1]
    assert run(scenario, 1, 7).digest == batch[1].digest
    assert len({each.digest for each in batch}) == 3
    (tmp_path / "scenario").write_bytes(pickle.dumps(scenario))
    command = [sys.executable, "-c", AGAIN, str(tmp_path / "scenario")]
    there = subprocess.run(command, capture_output=True, text=True, env=os.environ, check=True, timeout=300).stdout
    assert there.strip() == hashlib.sha256(write_recordings(batch)).hexdigest()


def test_people_are_where_they_are_whatever_the_robot_does_unless_they_avoid_it(two_rooms):
    def places(**more):
        scenario = people_in(two_rooms, **more)
        slow = replace(scenario, system={"FollowPath.vx_max": 0.2})
        found = [run(each, 0, 7).columns for each in (scenario, slow)]
        return [np.column_stack([c[f"mover_x_mm/person {k}"][:70] for k in range(5)]) for c in found]

    one, other = places(avoids_robot=False)
    assert np.array_equal(one, other)
    assert not np.array_equal(*places(avoids_robot=True, count=5))


def test_person_walks_round_a_cylinder_that_stands(two_rooms):
    scenario = people_in(two_rooms, count=1, waypoints=[[5.5, 2.5], [7.4, 2.5]], avoids_robot=False)
    cylinder = {"model": "cylinder", "spawn_pose": {"x": 6.4, "y": 2.4}, "xacro_arguments": "radius:=0.2"}
    columns = run(replace(scenario, environment={**scenario.environment, "static_objects": [cylinder]}), 0, 7).columns
    x_m, y_m = (columns[f"mover_{axis}_mm/person 0"] * 1e-3 for axis in "xy")
    assert x_m.min() < 5.8 and x_m.max() > 7.0
    assert 0.44 < np.hypot(x_m - 6.4, y_m - 2.4).min() < 0.6
