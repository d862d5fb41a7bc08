"""Bodies of a world are exact: for beams, contacts, and clearances, whatever the cells of the map."""

import math
from dataclasses import replace

import numpy as np
import pytest
import shapely
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from vastflow.sim.loop.closed_loop import ClosedLoop
from vastflow.sim.model.pose import Pose
from vastflow.sim.model.shape import Box, Disc, Polygon
from vastflow.sim.nav2.navigator.prepared import prepare
from vastflow.sim.nav2.parameters.stack import NavParameters
from vastflow.sim.world.bodies import Body, distances_to, outlines_of, walls_of
from vastflow.sim.world.lidar import scan
from vastflow.sim.world.occupancy import FREE, OccupancyMap
from vastflow.sim.world.robot_model import Lidar, Robot
from vastflow.sim.world.skip_table import ranges_to_walls, skip_table_of
from vastflow.sim.world.world import World

FLOOR = OccupancyMap(np.full((120, 120), FREE, dtype=np.int8), 0.05, (-3.0, -3.0))
TURNED = OccupancyMap(FLOOR.cells, 0.05, (-2.0, -3.5), 0.3)
SIZES = st.floats(0.01, 0.8)
SHAPES = st.one_of(
    st.builds(Disc, SIZES),
    st.builds(Box, SIZES, SIZES),
    st.builds(lambda a, b: Polygon(((0.0, 0.0), (a, 0.0), (a, b), (a / 2, b / 3), (0.0, b))), SIZES, SIZES),
)
PLACES = st.builds(Pose, st.floats(-2.0, 2.0), st.floats(-2.0, 2.0), st.floats(-4.0, 4.0))
BODIES = st.lists(st.builds(Body, st.just("it"), SHAPES, PLACES), min_size=1, max_size=12)


def seen(bodies, grid, at, lidar):
    """Ranges (B,) of beams from a place on the map, all around."""
    walls = walls_of(bodies, grid)
    x_m, y_m = grid.frame.to_grid(*at)
    out = np.empty(lidar.beams)
    place = walls.resolution_m, *walls.origin_xy_m
    skips = skip_table_of(walls.occupied, outlines_of(bodies, walls))
    scan(skips, *place, np.zeros((0, 7)), np.array([x_m, y_m, 0.0]), lidar.directions(), 0.0, lidar.range_max_m, out)
    return out


def by_hand(body, x_m, y_m, dx, dy):
    """Distance along a beam to a body's circle or edges."""
    if isinstance(body.shape, Disc):
        ox, oy = body.pose.x_m - x_m, body.pose.y_m - y_m
        along, across = ox * dx + oy * dy, ox * dy - oy * dx
        inside = body.shape.radius_m**2 - across**2
        return along - math.sqrt(inside) if inside >= 0.0 and along > 0.0 else math.inf
    beam = shapely.LineString([(x_m, y_m), (x_m + 20 * dx, y_m + 20 * dy)])
    met = beam.intersection(body.outline.exterior)
    return math.inf if met.is_empty else shapely.Point(x_m, y_m).distance(met)


DISCS = st.lists(st.builds(Body, st.just("it"), st.builds(Disc, st.floats(0.01, 0.6)), PLACES), min_size=1, max_size=40)
SCANNERS = st.sampled_from([(1, 0.0, 0.0), (7, -math.pi, math.pi), (360, 0.0, 6.28), (720, -2.35619, 2.35619)])


@given(DISCS, st.floats(-4.5, 4.5), st.floats(-4.5, 4.5), st.floats(-4.0, 4.0), SCANNERS, st.sampled_from([0.0, 0.3]))
@settings(max_examples=200, deadline=None)
def test_scan_of_discs_has_the_bits_of_cell_by_cell(bodies, x_m, y_m, yaw_rad, scanner, least_m):
    """From anywhere: beside the floor and inside of discs too."""
    walls = walls_of(bodies, FLOOR)
    skips = skip_table_of(walls.occupied, outlines_of(bodies, walls))
    assert skips.discs == len(bodies)
    angles = np.linspace(scanner[1], scanner[2], scanner[0])
    directions = np.column_stack([np.cos(angles), np.sin(angles)])
    found = []
    for each in (skips, skips._replace(discs=0)):
        out = np.empty(len(angles))
        pose, place = np.array([x_m, y_m, yaw_rad]), (walls.resolution_m, *walls.origin_xy_m)
        scan(each, *place, np.zeros((0, 7)), pose, directions, least_m, 5.0, out)
        found.append(out.tobytes())
    assert found[0] == found[1]


@pytest.mark.parametrize(
    "other", [Body("box", Box(0.2, 0.2), Pose(1.0, 1.0)), Body("across", Disc(0.3), Pose(2.9, 0.0))]
)
def test_skip_table_leaves_other_bodies_and_discs_across_the_border_to_cells(other):
    bodies = [Body("disc", Disc(0.3), Pose(0.0, 0.0)), other]
    walls = walls_of(bodies, FLOOR)
    assert skip_table_of(walls.occupied, outlines_of(bodies, walls)).discs == 0
    many = [Body("disc", Disc(0.01), Pose(x, y)) for x in np.linspace(-2, 2, 40) for y in np.linspace(-2, 2, 26)]
    assert skip_table_of(walls.occupied, outlines_of(many, walls)).discs == 0


@given(BODIES, st.floats(-2.5, 2.5), st.floats(-2.5, 2.5), st.sampled_from([FLOOR, TURNED]))
@settings(max_examples=80, deadline=None)
def test_beams_end_on_the_outlines_of_bodies(bodies, x_m, y_m, grid):
    at = shapely.Point(x_m, y_m)
    assume(grid.contains(*grid.cell_of(x_m, y_m)))
    assume(all(body.outline.distance(at) > 0.06 for body in bodies))
    lidar = Lidar(beams=97, angle_increment_rad=math.tau / 97, mount_xyt=(0.0, 0.0, 0.1))
    corners = [lidar.directions() @ np.array([[math.cos(grid.yaw_rad), math.sin(grid.yaw_rad)],
                                              [-math.sin(grid.yaw_rad), math.cos(grid.yaw_rad)]])][0]  # fmt: skip
    found = seen(bodies, grid, (x_m, y_m), lidar)
    for (dx, dy), range_m in zip(corners.tolist(), found.tolist(), strict=True):
        expected = min(by_hand(body, x_m, y_m, dx, dy) for body in bodies)
        if expected < math.inf and not grid.contains(*grid.cell_of(x_m + expected * dx, y_m + expected * dy)):
            continue
        grazes = any(_grazes(body, x_m, y_m, dx, dy) for body in bodies)
        assert grazes or range_m == pytest.approx(expected, abs=1e-6)


def _grazes(body, x_m, y_m, dx, dy):
    """Whether a beam passes an outline's rim or corner by less than rounding."""
    if isinstance(body.shape, Disc):
        across = abs((body.pose.x_m - x_m) * dy - (body.pose.y_m - y_m) * dx)
        return abs(across - body.shape.radius_m) < 1e-7
    corners = np.array(body.outline.exterior.coords)
    return bool((np.abs((corners[:, 0] - x_m) * dy - (corners[:, 1] - y_m) * dx) < 1e-6).any())


@pytest.mark.timeout(60)
@pytest.mark.parametrize("flat", [-1.2246e-16, 1e-16, 0.0, -1e-12, 1e-10])
@pytest.mark.parametrize("swap", [False, True])
def test_nearly_level_beam_on_a_border_passes_bodies_at_once(flat, swap):
    shelf = Body("shelf", Box(1.0, 0.4), Pose(0.0, 0.0125 - 0.2, 0.0))  # its edge is within a row of cells
    grid = OccupancyMap(np.full((200, 200), FREE, dtype=np.int8), 0.025, (-2.5, -2.475))
    bodies = [replace(shelf, shape=Box(0.4, 1.0), pose=Pose(0.0125 - 0.2, 0.0, 0.0)) if swap else shelf]
    grid = replace(grid, origin_xy_m=(-2.475, -2.5)) if swap else grid
    walls, out = walls_of(bodies, grid), np.empty(1)
    beam = np.array([[flat, 1.0] if swap else [1.0, flat]])
    at = (100.0, 20.0) if swap else (20.0, 100.0)  # 0.025 m: the border above the shelf's row
    ranges_to_walls(skip_table_of(walls.occupied, outlines_of(bodies, walls)), *at, beam, 0.0, 400.0, out)
    assert out[0] == np.inf


def test_beam_passes_a_disc_by_a_millimeter_and_ends_on_the_one_behind():
    bodies = [Body("near", Disc(0.1), Pose(1.0, 0.101)), Body("far", Disc(0.1), Pose(2.0, 0.0))]
    lidar = Lidar(beams=1, mount_xyt=(0.0, 0.0, 0.0))
    assert seen(bodies, FLOOR, (0.0, 0.0), lidar).tolist() == [pytest.approx(1.9, abs=1e-9)]
    moved = [Body("near", Disc(0.1), Pose(1.0, 0.099)), bodies[1]]
    assert seen(moved, FLOOR, (0.0, 0.0), lidar).tolist() == [pytest.approx(1.0 - math.sqrt(0.01 - 0.099**2), abs=1e-9)]


@pytest.mark.parametrize(
    ("shape", "near_m"),
    [
        (Disc(0.0763), 0.0763),
        (Box(0.1234, 2.0), 0.0617),
        (Polygon(((0.0417, -1.0), (0.5, 0.0), (0.0417, 1.0), (0.2, 0.0))), -0.1),
    ],
)
def test_robot_drives_until_it_touches_a_body_and_no_cell(shape, near_m):
    robot = Robot(radius_m=0.2)
    body = Body("post", shape, Pose(1.0131, 0.0072))
    prepared = prepare(World(FLOOR, bodies=(body,)), Lidar(), NavParameters())
    loop = ClosedLoop(prepared, NavParameters(), Lidar(), robot, Pose(0.0, 0.0072), (), [7, 1, 0], 10.0)
    for _ in range(160):
        loop.command(0.2, 0.0)
        loop.stack.m[0]["sent_v"] = 0.2
        pose = loop.body.pose
        _drive(loop, 0.2)
    (contact, *_) = [event for event in loop.events if event.kind == "contact"]
    apart_m = body.outline.distance(shapely.Point(*pose[:2]))
    assert contact.what == "wall"
    assert apart_m == pytest.approx(0.2, abs=2e-3)


def _drive(loop, speed_mps):
    """A tick of the body alone, as the loop makes it."""
    m = loop.stack.m[0]
    m["velocities"][:] = (speed_mps, 0.0, 0.0)
    m["tick"] += 1
    loop._drive()


def test_clearance_is_to_the_outline():
    bodies = [
        Body("a", Disc(0.0763), Pose(1.0, 0.0)),
        Body("b", Box(0.5, 0.1), Pose(-1.0, 0.0, math.pi / 2)),
        Body("c", Polygon(((0.0, 0.0), (1.0, 0.0), (0.0, 1.0))), Pose(0.0, 1.0)),
    ]
    places = np.array([(0.0, 0.0), (0.9, 0.0), (1.0, 0.01), (-1.5, 0.0), (0.3, 1.2), (0.0, 0.5), (-1.0, 0.5)])
    found = distances_to(bodies, places)
    np.testing.assert_allclose(found, [0.9237, 0.0237, 0.0, 0.45, 0.0, 0.5, 0.25], atol=1e-12)
