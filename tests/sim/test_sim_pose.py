"""Poses as campaign files write them."""

import pytest
from table import each_row

from vastflow.sim.model.pose import Pose, pose_of, written_pose_of


@each_row(
    ("value", "pose"),
    [
        ({"x": 1, "y": 2.5}, Pose(1.0, 2.5, 0.0)),
        ({"x": 1, "y": 2.5, "yaw": -3}, Pose(1.0, 2.5, -3.0)),
        ({"position": {"x": 1, "y": 2, "z": 0}}, Pose(1.0, 2.0, 0.0)),
        ({"position": {"x": 1, "y": 2}, "orientation": {"yaw": 0.5}}, Pose(1.0, 2.0, 0.5)),
        ({"position": {"x": 1, "y": 2}, "orientation": {}}, Pose(1.0, 2.0, 0.0)),
        ({"position": {"x": "1.5", "y": "-2"}, "orientation": {"yaw": "1e-1"}}, Pose(1.5, -2.0, 0.1)),
    ],
)
def test_pose_may_be_short_without_a_yaw_or_of_numbers_in_quotes(value, pose):
    assert pose_of(value) == pose


@each_row("x", [None, True, "east", "", "nan", "inf", [1], float("inf"), float("nan")])
def test_what_is_no_number_makes_no_pose(x):
    with pytest.raises(ValueError, match=r"^goal_pose: found .*; a pose is \{x, y, yaw\} or"):
        pose_of({"x": x, "y": 1.0}, "goal_pose")


@each_row(
    ("pose", "unread"),
    [
        ({"position": {"x": 1, "y": 2}, "orientation": {"x": 0, "y": 0, "z": 0.7, "w": 0.7}}, "orientation.x"),
        ({"position": {"x": 1, "y": 2}, "orientation": {"z": 0.7, "w": 0.7}}, "orientation.z"),
        ({"x": 1, "y": 2, "theta": 1.5}, "theta"),
        ({"position": {"x": 1, "y": 2, "yaw": 1.5}}, "position.yaw"),
    ],
)
def test_heading_in_other_words_is_not_read_over(pose, unread):
    with pytest.raises(ValueError, match=rf"^goal_pose: found '{unread}'; a pose has x, y and yaw"):
        pose_of(pose, "goal_pose")


def test_person_s_yaw_of_90_is_not_taken_for_radians():
    with pytest.raises(ValueError, match=r"^goal_pose: expected radians, one turn \(6\.2832\) at most, got yaw 90"):
        written_pose_of({"x": 1, "y": 2, "yaw": 90}, "goal_pose")
    assert pose_of({"x": 1, "y": 2, "yaw": 7.0}).yaw_rad == 7.0
