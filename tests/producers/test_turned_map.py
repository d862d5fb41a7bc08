"""Producers on a map whose origin is turned draw the same, turned."""

import math
from pathlib import Path

import numpy as np
import pytest
import shapely

from vastflow.producers.catalog.obstacle import ObstacleVariation
from vastflow.producers.catalog.path import PathVariationRandom
from vastflow.producers.catalog.rasterized_path import PathVariationRasterized
from vastflow.producers.model.configuration import Fragment
from vastflow.producers.model.producer import Draws
from vastflow.sim.model.obstacle import obstacle_of
from vastflow.sim.model.pose import GridFrame, pose_of
from vastflow.sim.world.map_file import load_map
from vastflow.sim.world.world import map_content

YAW_RAD = 0.5
FRAME = GridFrame((-1.0, -2.0), YAW_RAD)


@pytest.fixture
def maps(drawn_map, tmp_path):
    """Two rooms with a door, and the same map with a yaw in its origin."""
    plain = drawn_map("##########", "#....#...#", "#........#", "#....#...#", "#....#...#", "##########", cells=20)
    text = Path(plain.path).read_text()
    (tmp_path / "turned.yaml").write_text(
        text.replace("-2.0, 0.0]", f"-2.0, {YAW_RAD}]").replace("map.pgm", plain.path.replace("map.yaml", "map.pgm"))
    )
    return plain, map_content(tmp_path / "turned.yaml")


def produced(kind, inputs, **parameters):
    made = kind(kind.Parameters.model_validate(parameters))
    return [item.values for item in made.produce(inputs, Draws(0, "ab")) if isinstance(item, Fragment)]


def assert_turned(pose, other, *, yaw=True):
    assert (other.x_m, other.y_m) == pytest.approx(FRAME.to_map(pose.x_m, pose.y_m), abs=1.1e-6)
    if yaw:
        assert math.remainder(other.yaw_rad - pose.yaw_rad - YAW_RAD, math.tau) == pytest.approx(0.0, abs=1e-6)


def test_random_paths_are_turned(maps):
    asked = {"path_length": 4.0, "num_paths": 5, "robot_diameter": 0.4, "num_goal_poses": 2}
    plain, turned = (produced(PathVariationRandom, {"map_file": found}, **asked) for found in maps)
    assert len(plain) == len(turned) == 5
    for one, other in zip(plain, turned, strict=True):
        assert_turned(pose_of(one["start_pose"]), pose_of(other["start_pose"]), yaw=False)  # the start's is drawn
        for goal, other_goal in zip(one["goal_poses"], other["goal_poses"], strict=True):
            assert_turned(pose_of(goal), pose_of(other_goal))
        np.testing.assert_allclose(other["_path"], FRAME.points_to_map(np.array(one["_path"])), atol=1.1e-6)
        assert other["_path_length"] == one["_path_length"]


def test_raster_is_turned(maps):
    asked = {"path_length": 3.0, "raster_size": 1.0, "robot_diameter": 0.4}
    plain, turned = (produced(PathVariationRasterized, {"map_file": found}, **asked) for found in maps)
    assert len(plain) == len(turned) > 10
    for one, other in zip(plain, turned, strict=True):
        assert_turned(pose_of(one["goal_pose"]), pose_of(other["goal_pose"]), yaw=False)


def test_obstacles_stand_on_free_cells_of_a_turned_map(maps):
    _, turned = maps
    (path,) = produced(PathVariationRandom, {"map_file": turned}, path_length=4.0, robot_diameter=0.4)
    config = {"amount": 3, "max_distance": 0.6, "args": "width:=0.3, length:=0.3"}
    inputs = {"map_file": turned, **path}
    (placed,) = produced(ObstacleVariation, inputs, name="static_objects", obstacle_configs=[config], seed=3)
    occupancy = load_map(turned.path)
    footprints = [obstacle_of(entry).footprint() for entry in placed["static_objects"]]
    assert len(footprints) == 3
    for footprint in footprints:
        for share in np.linspace(0.0, 1.0, 40):
            point = footprint.exterior.interpolate(share * 0.999, normalized=True)
            assert occupancy.free[occupancy.cell_of(point.x, point.y)]
    cells = np.argwhere(~occupancy.free)
    walls = shapely.points(occupancy.centers_of(cells))
    assert shapely.distance(shapely.union_all(footprints), walls).min() > 0.0
