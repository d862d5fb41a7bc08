"""Poses as campaign files write them, and the frame of a map's grid."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from table import each_row

from vastflow.sim.model.pose import GridFrame, Pose, pose_of, written_pose_of

METERS = st.floats(-1e3, 1e3)
FRAMES = st.builds(GridFrame, st.tuples(METERS, METERS), st.floats(-math.pi / 4, math.pi / 4))


@given(METERS, METERS, METERS)
def test_pose_is_read_back_from_its_value(x, y, yaw):
    assert pose_of(Pose(x, y, yaw).value()) == Pose(x, y, yaw)


@each_row(
    ("value", "pose"),
    [
        ({"x": 1, "y": 2.5}, Pose(1.0, 2.5, 0.0)),
        ({"x": "1", "y": "2.5", "yaw": "1e-1"}, Pose(1.0, 2.5, 0.1)),
        ({"x": 1, "y": 2, "yaw": 7.0}, Pose(1.0, 2.0, 7.0)),
        ({"position": {"x": 1, "y": 2}, "orientation": {}}, Pose(1.0, 2.0, 0.0)),
        ({"position": {"x": 1, "y": 2, "z": 3}, "orientation": {"roll": 0.1, "yaw": 1}}, Pose(1.0, 2.0, 1.0)),
    ],
)
def test_pose_may_be_short_without_a_yaw_or_of_numbers_in_quotes(value, pose):
    assert pose_of(value) == pose


@each_row(
    ("value", "message"),
    [
        *(
            (value, "expected a pose, {x, y, yaw} or {position: {x, y}")
            for value in (None, "1, 2", [1, 2], {}, {"x": 1})
        ),
        *(({"x": x, "y": 1.0}, f"got {{'x': {x!r}") for x in (None, True, "east", "", "nan", [1], float("inf"))),
        ({"position": 3}, "got {'position': 3}"),
        (
            {"position": {"x": 1, "y": 2}, "orientation": {"z": 0.7, "w": 0.7}},
            "yaw, in meters and radians, got 'orientation.z'",
        ),
        ({"x": 1, "y": 2, "theta": 1.5}, "got 'theta'"),
        ({"position": {"x": 1, "y": 2, "yaw": 1.5}}, "got 'position.yaw'"),
        ({"x": 1, "y": 2, "yaw": 90}, "expected radians, one turn (6.2832) at most, got yaw 90"),
    ],
)
def test_invalid_pose_is_refused_with_place(value, message):
    with pytest.raises(ValueError, match=r"^goal_pose: ") as caught:
        written_pose_of(value, "goal_pose")
    assert message in str(caught.value)


@given(FRAMES, METERS, METERS, st.floats(-3, 3))
def test_pose_returns_from_grid_frame_to_nanometer(frame, x, y, yaw):
    back = frame.pose_to_map(frame.pose_to_grid(Pose(x, y, yaw)))
    assert (back.x_m, back.y_m, back.yaw_rad) == pytest.approx((x, y, yaw), abs=2e-9)


@given(METERS, METERS, st.tuples(METERS, METERS), st.floats(-3, 3))
def test_unrotated_frame_keeps_numbers(x, y, corner, yaw):
    frame, points = GridFrame(corner), np.array([[x, y]])
    assert frame.pose_to_grid(Pose(x, y, yaw)) == frame.pose_to_map(Pose(x, y, yaw)) == Pose(x, y, yaw)
    assert frame.points_to_grid(points) is frame.points_to_map(points) is points


@given(FRAMES, st.lists(st.tuples(METERS, METERS), min_size=1, max_size=5))
def test_points_are_turned_as_one_by_one(frame, points):
    xy_m = np.array(points)
    np.testing.assert_allclose(frame.points_to_grid(xy_m), [frame.to_grid(*point) for point in points], atol=2e-9)
    np.testing.assert_allclose(frame.points_to_map(xy_m), [frame.to_map(*point) for point in points], atol=1e-9)


@given(FRAMES, st.floats(0, 1), st.floats(0, 1))
def test_covariance_returns_from_grid_frame(frame, xx, yy):
    a, b, d = frame.covariance_to_grid(xx, yy)
    c, s = math.cos(frame.yaw_rad), math.sin(frame.yaw_rad)
    turn = np.array([[c, -s], [s, c]])
    np.testing.assert_allclose(turn @ [[a, b], [b, d]] @ turn.T, [[xx, 0], [0, yy]], atol=1e-12)
    assert frame.covariance_to_map(a, b, d) == pytest.approx((xx, 0.0, yy), abs=1e-12)
