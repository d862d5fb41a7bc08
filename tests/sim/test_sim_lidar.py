"""The laser scanner: exact ranges, the sensor's place and limits, dropout and noise."""

import math

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from shapely.affinity import affine_transform
from shapely.geometry import LineString, Point, box
from table import each_row

from vastflow.sim.kernels.streams import streams_of
from vastflow.sim.world.gaussian_dropout import perturb
from vastflow.sim.world.lidar import range_to_obstacle, scan
from vastflow.sim.world.obstacle_rows import BOX, DISC
from vastflow.sim.world.robot_model import Lidar
from vastflow.sim.world.skip_table import ranges_to_walls, skip_table_of

HAIR = 1e-7
"""Cells grown and shrunk by this bracket what a beam may do at a corner that it grazes."""

GRIDS = st.tuples(st.integers(1, 30), st.integers(1, 30)).flatmap(
    lambda shape: arrays(np.bool_, shape, elements=st.sampled_from([False] * 9 + [True]))
)
COORDINATES = st.floats(-4.0, 34.0) | st.integers(-4, 34).map(float) | st.integers(-8, 68).map(lambda k: k / 2)
ANGLES = st.floats(-math.pi, math.pi) | st.integers(-8, 8).map(lambda k: k * math.pi / 8)


def range_to_wall(skips, x, y, dx, dy, start, end):
    out = np.empty(1)
    ranges_to_walls(skips, x, y, np.array([[dx, dy]]), start, end, out)
    return out[0]


def nearest_cell(occupied, x, y, dx, dy, margin, start=0.0):
    """Distance along a beam to the nearest occupied cell grown by `margin`, by each cell's own slab test."""
    nearest = math.inf
    for row, column in np.argwhere(occupied).tolist():
        near, far = -math.inf, math.inf
        for origin, direction, low in ((x, dx, column), (y, dy, row)):
            low, high = low - margin, low + 1 + margin
            if direction == 0.0:
                if not low <= origin <= high:
                    near, far = math.inf, -math.inf
            else:
                a, b = (low - origin) / direction, (high - origin) / direction
                near, far = max(near, min(a, b)), min(far, max(a, b))
        if near <= far and far >= start:
            nearest = min(nearest, max(near, start))
    return nearest


@given(GRIDS, COORDINATES, COORDINATES, ANGLES, st.just(0.0) | st.floats(0.1, 10.0), st.floats(0.5, 30.0))
@settings(max_examples=150, deadline=None)
def test_range_is_that_to_the_first_cell_between_start_and_end(occupied, x, y, angle, start, end):
    exact = {0.0: (1.0, 0.0), math.pi / 2: (0.0, 1.0), -math.pi / 2: (0.0, -1.0), math.pi: (-1.0, 0.0)}
    dx, dy = exact.get(angle, (math.cos(angle), math.sin(angle)))
    found = range_to_wall(skip_table_of(occupied), x, y, dx, dy, start, 1e3)
    assert nearest_cell(occupied, x, y, dx, dy, HAIR, start) - 1e-6 <= found
    assert found <= nearest_cell(occupied, x, y, dx, dy, -HAIR, start) + 1e-6
    within = range_to_wall(skip_table_of(occupied), x, y, dx, dy, start, end)
    assert within == (found if found < end else math.inf)


def grid(shape, *walls):
    occupied = np.zeros(shape, dtype=np.bool_)
    for wall in walls:
        occupied[wall] = True
    return occupied


WEST = (-1.0, -1.2246467991473532e-16)
"""A direction that rounding turns off the border of two rows."""
LEAVING = (math.cos(-1.1922854594059253), math.sin(-1.1922854594059253))
"""A direction in which the point where the beam crosses the border is rounded to the inside."""


@each_row(
    ("occupied", "place", "direction", "expected"),
    [
        (grid((20, 20), np.s_[::4, 19]), (13.98679012349347, 10.456377804563067), LEAVING, [math.inf]),
        (grid((32, 12), (23, 6)), (11.0, 24.0), WEST, [pytest.approx(4.0), math.inf]),
        (grid((32, 12), (23, 6)), (0.5, 24.0), (1.0, WEST[1]), [pytest.approx(5.5), math.inf]),
        (grid((32, 4), (20, 3)), (11.0, 24.0), WEST, [math.inf]),
        (grid((1, 3), (0, 1)), (3.0, 0.5), (-1.0, 0.0), [1.0]),
    ],
)
def test_beam_along_map_border_terminates(occupied, place, direction, expected):
    assert range_to_wall(skip_table_of(occupied), *place, *direction, 0.0, 1e3) in expected


BOXES = st.tuples(st.floats(-5, 5), st.floats(-5, 5), st.floats(-4, 4), st.floats(0.01, 3.0), st.floats(0.01, 3.0))


def outline(x, y, yaw, length, width, margin):
    c, s = math.cos(yaw), math.sin(yaw)
    straight = box(-length / 2 - margin, -width / 2 - margin, length / 2 + margin, width / 2 + margin)
    return affine_transform(straight, (c, -s, s, c, x, y))


@given(BOXES, st.floats(-5, 5), st.floats(-5, 5), ANGLES)
@settings(max_examples=60, deadline=None)
def test_range_to_a_box_is_that_of_shapely(obstacle, x, y, angle):
    cx, cy, yaw, length, width = obstacle
    row = np.array([cx, cy, math.cos(yaw), math.sin(yaw), length / 2, width / 2, BOX])
    beam = LineString([(x, y), (x + 30 * math.cos(angle), y + 30 * math.sin(angle))])
    found = range_to_obstacle(row, x, y, math.cos(angle), math.sin(angle), 0.0)
    bounds = []
    for margin in (1e-6, -1e-6):
        crossing = outline(*obstacle, margin).intersection(beam)
        bounds.append(math.inf if crossing.is_empty else Point(x, y).distance(crossing))
    assert bounds[0] - 1e-5 <= found <= bounds[1] + 1e-5


@given(st.floats(-5, 5), st.floats(-5, 5), st.floats(0.01, 3.0), ANGLES)
@settings(max_examples=60, deadline=None)
def test_range_to_a_cylinder_is_where_the_beam_enters_the_circle(cx, cy, radius, angle):
    dx, dy = math.cos(angle), math.sin(angle)
    along, across = cx * dx + cy * dy, abs(cx * dy - cy * dx)
    assume(abs(math.hypot(cx, cy) - radius) > 1e-6 and abs(across - radius) > 1e-6)
    found = range_to_obstacle(np.array([cx, cy, 1.0, 0.0, radius, 0.0, DISC]), 0.0, 0.0, dx, dy, 0.0)
    if math.hypot(cx, cy) < radius:
        assert found == 0.0
    elif across > radius or along < 0.0:
        assert found == math.inf
    else:
        assert math.hypot(found * dx - cx, found * dy - cy) == pytest.approx(radius)
        assert found <= along


@pytest.fixture
def room():
    """10 m × 8 m between walls one cell of 0.1 m thick."""
    return skip_table_of(np.pad(np.zeros((78, 98), dtype=np.bool_), 1, constant_values=True))


def scanned(skips, pose, lidar=None, obstacles=(), origin=(0.0, 0.0), resolution_m=0.1):
    lidar = lidar or Lidar()
    out = np.empty(lidar.beams)
    x, y, yaw = pose
    mx, my, _ = lidar.mount_xyt
    sensor = np.array([x + math.cos(yaw) * mx - math.sin(yaw) * my, y + math.sin(yaw) * mx + math.cos(yaw) * my, yaw])
    rows = np.array(obstacles, dtype=np.float64).reshape(-1, 7)
    scan(skips, resolution_m, *origin, rows, sensor, lidar.directions(), lidar.range_min_m, lidar.range_max_m, out)
    return out


def test_beams_go_round_counter_clockwise_from_the_left_of_a_turned_robot(room):
    ranges = scanned(room, (5.0, 4.0, 0.0))
    sensor_x = 4.96
    quarter = 90
    off = quarter * 6.28 / 359 - math.pi / 2  # the increment is a little more than a degree
    directions = Lidar().directions()
    assert np.arccos(directions[0] @ directions[-1]) == pytest.approx(2 * math.pi - 6.28)
    assert ranges[0] == pytest.approx(3.9)
    assert ranges[quarter] == pytest.approx((sensor_x - 0.1) / math.cos(off))
    assert ranges[2 * quarter] == pytest.approx(3.9 / math.cos(2 * off))
    assert ranges[3 * quarter] == pytest.approx((9.9 - sensor_x) / math.cos(3 * off))
    turned = scanned(room, (5.0, 4.0, math.pi / 2))
    assert turned[0] == pytest.approx(5.0 - 0.1)  # to the robot's left, west
    assert min(turned[85:95]) == pytest.approx(4.0 - 0.04 - 0.1, abs=1e-3)  # behind it, south


@given(st.floats(-50, 50), st.floats(-50, 50))
@settings(max_examples=30, deadline=None)
def test_origin_of_the_map_shifts_the_scan_with_it(x, y):
    skips = skip_table_of(grid((80, 100), (20, 70), np.s_[60:, 10]))
    here, there = scanned(skips, (5.0, 4.0, 0.3)), scanned(skips, (5.0 + x, 4.0 + y, 0.3), origin=(x, y))
    grazed = np.isinf(here) != np.isinf(there)
    np.testing.assert_allclose(here[~grazed], there[~grazed], atol=1e-6)
    assert grazed.sum() <= 2


OBSTACLES = st.lists(
    st.tuples(st.floats(-9, 9), st.floats(-9, 9), ANGLES, st.floats(0.05, 2.0), st.just(0.0) | st.floats(0.05, 2.0)),
    max_size=6,
)


@given(OBSTACLES, ANGLES, st.sampled_from([1, 2, 7, 360]), st.floats(0.001, 1.0))
@settings(max_examples=60, deadline=None)
def test_scan_matches_single_beams(obstacles, yaw, beams, fullness):
    """Whichever beams are looked at for an obstacle: in front, behind, round the sensor, across the first beam."""
    rows = np.array([(x, y, math.cos(a), math.sin(a), *size, BOX if size[1] else DISC) for x, y, a, *size in obstacles])
    lidar = Lidar(beams=beams, angle_increment_rad=fullness * 2 * math.pi / beams)
    seen = scanned(skip_table_of(np.zeros((4, 4), dtype=np.bool_)), (0.0, 0.0, yaw), lidar, rows)
    c, s = math.cos(yaw), math.sin(yaw)
    x, y = -0.04 * c, -0.04 * s
    for (dx, dy), found in zip(lidar.directions() @ np.array([[c, s], [-s, c]]), seen, strict=True):
        each = [range_to_obstacle(row, x, y, dx, dy, lidar.range_min_m) for row in rows]
        assert found == pytest.approx(min([r for r in each if r < lidar.range_max_m], default=math.inf))


BEAM = Lidar(beams=1, mount_xyt=(0.0, 0.0, 0.0))


@each_row(
    ("lidar", "obstacles", "beam", "range_m"),
    [
        (
            BEAM,
            [(7.0, 4.0, 1.0, 0.0, 0.3, 0.3, BOX), (6.0, 4.0, 1.0, 0.0, 0.1, 0.0, DISC)],
            0,
            0.9,
        ),  # the nearest of several
        (BEAM, [(math.inf, math.inf, 1.0, 0.0, 0.25, 0.25, BOX)], 0, 4.9),  # one that is not there
        (BEAM, [(5.1, 4.0, 1.0, 0.0, 0.02, 0.5, BOX)], 0, 4.9),  # one nearer than the least range
        (Lidar(range_max_m=4.5), [], 0, 3.9),
        (Lidar(range_max_m=4.5), [], 90, math.inf),
        (Lidar(range_max_m=4.5), [(9.8, 4.0, 1.0, 0.0, 0.2, 0.0, DISC)], 270, math.inf),
    ],
)
def test_nearest_obstacle_or_wall_within_the_limits_is_seen(room, lidar, obstacles, beam, range_m):
    assert scanned(room, (5.0, 4.0, 0.0), lidar, obstacles)[beam] == pytest.approx(range_m)


def perturbed(ranges, dropout=0.0, noise_m=0.0, entropy=1):
    stream = streams_of([entropy])[0]
    out = np.array(ranges, dtype=np.float64)
    perturb(out, stream, dropout, noise_m, np.zeros(len(out), dtype=np.int64))
    return out, stream


@each_row(("dropout", "count"), [(0.0, 0), (0.002, 0), (0.1, 36), (0.5, 180), (0.999, 359), (1.0, 360)])
def test_dropout_removes_floor_of_share(dropout, count):
    assert np.isinf(perturbed(np.ones(360), dropout)[0]).sum() == count


def test_beams_are_dropped_equally_often():
    stream, dropped, order = streams_of([3])[0], np.zeros(60), np.zeros(60, dtype=np.int64)
    for _ in range(4000):
        ranges = np.ones(60)
        perturb(ranges, stream, 0.25, 0.0, order)
        dropped += np.isinf(ranges)
    # 1000 expected a beam, standard deviation 27
    assert abs(dropped - 1000).max() < 5 * math.sqrt(4000 * 0.25 * 0.75)


def test_noise_is_gaussian_of_the_given_width_and_independent():
    stream, order = streams_of([5])[0], np.zeros(360, dtype=np.int64)
    noise = np.full((1000, 360), 4.0)
    for row in noise:
        perturb(row, stream, 0.0, 0.1, order)
    noise = (noise - 4.0) / 0.1
    n = noise.size
    assert abs(noise.mean()) < 5 / math.sqrt(n)
    assert abs(noise.std() - 1.0) < 5 / math.sqrt(2 * n)
    assert abs((noise**4).mean() - 3.0) < 5 * math.sqrt(96 / n)
    assert abs((noise[:, :-1] * noise[:, 1:]).mean()) < 5 / math.sqrt(n)
    assert abs((noise[:-1] * noise[1:]).mean()) < 5 / math.sqrt(n)


def test_noise_applies_to_returns_beyond_scanner_limits():
    unchanged, stream = perturbed(np.ones(360))
    assert (unchanged == 1.0).all() and stream == streams_of([1])[0]
    ranges = np.full(361, 3.0)
    ranges[::7] = np.inf
    noisy = perturbed(ranges, noise_m=0.2)[0]
    assert np.isinf(noisy).tolist() == np.isinf(ranges).tolist()
    assert (noisy[np.isfinite(noisy)] != 3.0).all()
    assert perturbed(np.full(360, 0.164), noise_m=0.3)[0].min() < 0.0
    assert perturbed(np.full(360, 19.99), noise_m=0.3)[0].max() > 20.0
