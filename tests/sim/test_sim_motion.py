"""Actuators, arcs, and free motion."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from shapely.geometry import Point
from table import each_row

from vastflow.sim.model.obstacle import Obstacle, Trigger
from vastflow.sim.model.pose import Pose
from vastflow.sim.model.shape import Box, Disc
from vastflow.sim.world import motion
from vastflow.sim.world.motion import FREE, MARGIN_M, MOVING, TOUCHING, Body, arc, limited, moved, wrapped
from vastflow.sim.world.obstacle_rows import obstacle_rows, trigger_rows
from vastflow.sim.world.occupancy import OccupancyMap
from vastflow.sim.world.physics import Physics, WallIndex
from vastflow.sim.world.robot_model import Robot
from vastflow.sim.world.skip_table import skip_table_of

DT_S = 0.01
STILL = np.zeros((2, 0, 3))
"""Poses of no movers."""
ROBOT = Robot()
RESOLUTION_M = 0.05
ORIGIN = (-1.0, 2.0)
GRIDS = arrays(np.int8, (40, 44), elements=st.sampled_from([0] * 60 + [100]), fill=st.sampled_from([0, 0, 0, 100]))
STEPS = st.lists(st.tuples(st.floats(-0.5, 0.5), st.floats(-2, 2), st.floats(-0.5, 0.5)), min_size=5, max_size=5).map(
    np.array
)
POSES = st.tuples(st.floats(-1.2, 1.4), st.floats(1.8, 4.2), st.floats(-4, 4))


def free_motion(occupancy, pose, velocities, obstacles=(), hold=FREE):
    """Whether the kernel moves the body, and where it then is."""
    body = Body(
        np.array(pose, dtype=np.float64), ROBOT.radius_m, obstacle_rows(obstacles), trigger_rows(obstacles), STILL
    )
    skips = skip_table_of(occupancy.occupied)
    free = motion.move_freely(skips, occupancy.resolution_m, *occupancy.origin_xy_m, body, velocities, DT_S, hold, 0)
    return free, body.pose


def ends(pose, velocities):
    """The body's center after each step."""
    for v, w, vy in velocities:
        pose = moved(*pose, v, w, vy, DT_S)
        yield pose[:2]


def away_from_walls(occupancy, pose, velocities):
    """The least distance of a step's end to an occupied cell's square."""
    low = np.argwhere(occupancy.occupied)[:, ::-1] * RESOLUTION_M + ORIGIN
    beyond = [np.maximum(np.maximum(low - at, at - low - RESOLUTION_M), 0.0) for at in ends(pose, velocities)]
    return np.min([np.hypot(*b.T) for b in beyond], initial=math.inf)


@given(GRIDS, POSES, STEPS)
@settings(max_examples=100, deadline=None)
def test_body_moves_freely_beyond_a_millimeter_from_walls_as_in_the_engine(grid, pose, velocities):
    occupancy = OccupancyMap(grid, RESOLUTION_M, ORIGIN)
    free, after = free_motion(occupancy, pose, velocities)
    away = away_from_walls(occupancy, pose, velocities)
    if abs(away - ROBOT.radius_m - MARGIN_M) > 1e-9:
        assert free == (away > ROBOT.radius_m + MARGIN_M)
    if free:
        world, driven = Physics(ROBOT, WallIndex(occupancy), (), STILL), np.array(pose)
        world.drive(driven, velocities.tolist(), DT_S, 0.0)
        assert driven == pytest.approx(after, abs=1e-12)
        assert not world.events
    else:
        assert after.tolist() == list(pose)


OBSTACLES = st.tuples(st.booleans(), POSES, st.floats(0.02, 1.0), st.floats(0.02, 1.0)).map(
    lambda o: Obstacle("it", Disc(o[2] / 2) if o[0] else Box(o[2], o[3]), Pose(*o[1]))
)


@given(OBSTACLES, POSES, STEPS)
@settings(max_examples=60, deadline=None)
def test_body_moves_freely_beyond_a_millimeter_from_obstacles(obstacle, pose, velocities):
    empty = OccupancyMap(np.zeros((40, 44), dtype=np.int8), RESOLUTION_M, ORIGIN)
    free, _ = free_motion(empty, pose, velocities, (obstacle,))
    away = min(obstacle.footprint().distance(Point(*at)) for at in ends(pose, velocities))
    tolerance = 2e-3 if isinstance(obstacle.shape, Disc) else 1e-9  # a footprint's cylinder has 64 corners
    if abs(away - ROBOT.radius_m - MARGIN_M) > tolerance:
        assert free == (away > ROBOT.radius_m + MARGIN_M)


@each_row(("beside_m", "free"), [(-1e-6, False), (1e-6, True)])
@pytest.mark.parametrize("what", ["wall", Box(0.1, 0.1), Disc(0.05)])
def test_body_is_free_from_its_radius_and_a_millimeter_on(what, beside_m, free):
    grid = np.zeros((40, 44), dtype=np.int8)
    grid[:, 0] = 100 * (what == "wall")  # as all of them, up to x = -0.95 m
    obstacles = () if what == "wall" else (Obstacle("it", what, Pose(-1.0, 3.0)),)
    at = (-0.95 + ROBOT.radius_m + MARGIN_M + beside_m, 3.0, 0.0)
    assert free_motion(OccupancyMap(grid, RESOLUTION_M, ORIGIN), at, np.zeros((5, 3)), obstacles)[0] == free


WAITING = Obstacle("it", Box(0.5, 0.5), Pose(0.0, 3.0), Trigger(0.0, 3.0, 1.0))


@each_row(
    ("cell", "at", "v_mps", "given", "free"),
    [
        *((100, at, 0.0, {}, False) for at in ((0.0, 3.0), (0.0, 2.0), (-1.0, 2.0))),  # deep in a wall
        (0, (0.0, 3.0), 0.1, {"obstacles": (WAITING,)}, True),  # which has not appeared
        (0, (0.0, 3.0), 0.1, {"hold": FREE}, True),
        (0, (0.0, 3.0), 0.1, {"hold": TOUCHING}, False),
        (0, (0.0, 3.0), 0.0, {"hold": TOUCHING}, True),
        (0, (0.0, 3.0), 0.0, {"hold": MOVING}, False),
    ],
)
def test_body_is_free_away_from_walls_and_in_contact_only_at_rest(cell, at, v_mps, given, free):
    occupancy = OccupancyMap(np.full((40, 44), cell, dtype=np.int8), RESOLUTION_M, ORIGIN)
    assert free_motion(occupancy, (*at, 0.0), np.full((5, 3), v_mps), **given)[0] == free


SPEEDS = st.floats(-3.0, 3.0)


@given(SPEEDS, SPEEDS, st.floats(0.1, 2.0), st.floats(0.1, 5.0), st.floats(0.001, 0.1))
@settings(deadline=None)
def test_limited_command_is_the_nearest_within_both_limits(command, previous, limit, acceleration, dt_s):
    previous = min(max(previous, -limit), limit)
    found = limited(command, previous, limit, acceleration, dt_s)
    assert abs(found) <= limit
    assert abs(found - previous) <= acceleration * dt_s + 1e-12
    within = min(max(command, -limit), limit)
    assert found == pytest.approx(within) or abs(found - previous) == pytest.approx(acceleration * dt_s)
    assert min(previous, within) - 1e-12 <= found <= max(previous, within) + 1e-12


@given(st.floats(-9, 9), st.floats(-9, 9), st.floats(-4, 4), SPEEDS, SPEEDS, st.floats(0.001, 1.0))
@settings(deadline=None)
def test_arc_is_the_formula_of_the_circle(x, y, yaw, v, w, dt_s):
    new_x, new_y, new_yaw = arc(x, y, yaw, v, w, dt_s)
    assert new_yaw == pytest.approx(yaw + w * dt_s)
    if abs(w) > 1e-3:
        assert new_x == pytest.approx(x + v / w * (math.sin(yaw + w * dt_s) - math.sin(yaw)), abs=1e-9)
        assert new_y == pytest.approx(y - v / w * (math.cos(yaw + w * dt_s) - math.cos(yaw)), abs=1e-9)
    straight = x + v * dt_s * math.cos(yaw), y + v * dt_s * math.sin(yaw), yaw
    assert arc(x, y, yaw, v, 0.0, dt_s) == pytest.approx(straight)
    assert arc(*arc(x, y, yaw, v, w, dt_s), v, w, dt_s) == pytest.approx(arc(x, y, yaw, v, w, 2 * dt_s), abs=1e-9)


@given(st.floats(-50, 50))
@settings(deadline=None)
def test_wrapped_angle_is_the_same_direction_between_minus_pi_and_pi(angle):
    found = wrapped(angle)
    assert -math.pi <= found < math.pi
    assert math.cos(found - angle) == pytest.approx(1.0)
