"""The frame of a map's grid: there and back, and nothing at all where it is not turned."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from vastflow.sim.model.pose import GridFrame, Pose

meters = st.floats(-1e3, 1e3)
frames = st.builds(GridFrame, st.tuples(meters, meters), st.floats(-math.pi / 4, math.pi / 4))


@given(frames, meters, meters, st.floats(-3, 3))
def test_pose_in_the_grid_s_frame_and_back_is_the_pose_to_the_nanometer(frame, x, y, yaw):
    back = frame.pose_to_map(frame.pose_to_grid(Pose(x, y, yaw)))
    assert (back.x_m, back.y_m, back.yaw_rad) == pytest.approx((x, y, yaw), abs=2e-9)


@given(meters, meters, st.tuples(meters, meters), st.floats(-3, 3))
def test_frame_that_is_not_turned_gives_every_number_back(x, y, corner, yaw):
    frame, points = GridFrame(corner), np.array([[x, y]])
    assert frame.pose_to_grid(Pose(x, y, yaw)) == frame.pose_to_map(Pose(x, y, yaw)) == Pose(x, y, yaw)
    assert frame.points_to_grid(points) is frame.points_to_map(points) is points


@given(frames, st.lists(st.tuples(meters, meters), min_size=1, max_size=5))
def test_points_go_where_they_go_one_by_one(frame, points):
    xy_m = np.array(points)
    np.testing.assert_allclose(frame.points_to_grid(xy_m), [frame.to_grid(*point) for point in points], atol=2e-9)
    np.testing.assert_allclose(frame.points_to_map(xy_m), [frame.to_map(*point) for point in points], atol=1e-9)


@given(frames, st.floats(0, 1), st.floats(0, 1))
def test_covariance_keeps_its_extent_and_lies_along_the_map_s_axes_when_turned_back(frame, xx, yy):
    a, b, d = frame.covariance_to_grid(xx, yy)
    c, s = math.cos(frame.yaw_rad), math.sin(frame.yaw_rad)
    turn = np.array([[c, -s], [s, c]])
    np.testing.assert_allclose(turn @ [[a, b], [b, d]] @ turn.T, [[xx, 0], [0, yy]], atol=1e-12)
    assert frame.covariance_to_map(a, b, d) == pytest.approx((xx, 0.0, yy), abs=1e-12)
