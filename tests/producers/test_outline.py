"""Outlines of obstacles answer as their polygons do."""

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st
from shapely.geometry import Point

from vastflow.producers.places.ground import ground_of
from vastflow.producers.places.placement import ObstacleOutline, covered_cells
from vastflow.sim.model.obstacle import Obstacle
from vastflow.sim.model.pose import Pose

near = st.floats(-1.5, 1.5).map(lambda value: round(value, 6))
sizes = st.sampled_from([0.1, 0.3, 0.5, 0.8])
poses = st.builds(Pose, near, near, st.floats(-math.pi, math.pi).map(lambda value: round(value, 6)))
boxes = st.builds(lambda pose, length, width: Obstacle("o", "box", pose, length, width), poses, sizes, sizes)
cylinders = st.builds(lambda pose, diameter: Obstacle("o", "cylinder", pose, diameter, diameter), poses, sizes)
obstacles = boxes | cylinders
distances = st.sampled_from([0.05, 0.225, 0.4])


@given(obstacles, near, near, distances)
def test_outline_is_as_near_to_a_point_as_its_polygon(obstacle, x, y, distance):
    found = ObstacleOutline(obstacle).nearer_to((x, y), distance)
    assert found == (obstacle.footprint().distance(Point(x, y)) < distance)


@given(obstacles, obstacles, distances)
def test_outlines_are_as_near_as_their_polygons(one, other, distance):
    found = ObstacleOutline(one).nearer_than(distance, ObstacleOutline(other))
    assert found == (one.footprint().distance(other.footprint()) < distance)


@pytest.fixture(scope="module")
def ground(drawn_map):
    """A room of 2 m x 2 m round the origin with walls in it and an unknown corner."""
    rows = ["." * 40] * 10 + ["." * 20 + "#" * 3 + "." * 17] * 20 + ["." * 30 + "?" * 10] * 10
    return ground_of(drawn_map(*rows), 0.2)


@given(obstacles)
def test_outline_leaves_free_cells_only_if_its_polygon_does(ground, obstacle):
    moved = Obstacle(
        "o",
        obstacle.shape,
        Pose(obstacle.pose.x_m, obstacle.pose.y_m - 1.0, obstacle.pose.yaw_rad),
        obstacle.length_m,
        obstacle.width_m,
    )
    if ObstacleOutline(moved).leaves(ground.occupancy):
        assert covered_cells(ground, moved.footprint()) is None
