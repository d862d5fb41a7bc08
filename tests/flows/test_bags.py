"""Bags that vastflow did not write, as drives and recordings."""

from dataclasses import replace

import numpy as np
import pytest
from real_bags import Recorder, beyond, driven, split
from rosbags.rosbag2 import CompressionMode, StoragePlugin
from table import each_row

from vastflow.flows.bags.bag import BagError, read_bag
from vastflow.flows.bags.drive import clock_of, drive_of, inverse, joined
from vastflow.flows.bags.reading import topics_of
from vastflow.flows.bags.recorded import recording_of
from vastflow.sim.model.pose import Pose
from vastflow.sim.model.recording import si

pytestmark = pytest.mark.timeout(300)
WALL_S = 1_790_000_000.0
PLAIN = Recorder(scans=False, odometry_hz=25.0)


@pytest.fixture(scope="module")
def drive():
    return driven(lengths_m=(2.0,), slip=0.01)


def imported(path, namespace="", start=None, goal=None):
    bag = read_bag(path, namespace)
    clock, notes = clock_of(bag)
    found = drive_of(bag, clock, start, goal)
    return bag, found, recording_of(bag, clock, found), (*notes, *found.notes)


def off_m(found, drive, estimate_off_m):
    """Greatest distance of the imported estimate from that of the robot."""
    t_s = 0.06 + found.t_s - found.t_s[0]  # the action's begin
    true = np.column_stack([np.interp(t_s, drive.t_s, drive.true[:, k]) for k in (0, 1)])
    return np.hypot(*(found.estimate[:, :2] - true - (estimate_off_m, 0.0)).T).max()


CHAIN = "map → odom → base_link"


@each_row(
    "recorder, namespace, origin, note",
    [
        (PLAIN, "", CHAIN, ""),
        (replace(PLAIN, plugin=StoragePlugin.SQLITE3), "", CHAIN, ""),
        (replace(PLAIN, compression=CompressionMode.MESSAGE, plugin=StoragePlugin.SQLITE3), "", CHAIN, ""),
        (replace(PLAIN, compression=CompressionMode.FILE, plugin=StoragePlugin.SQLITE3), "", CHAIN, ""),
        (replace(PLAIN, compression=CompressionMode.STORAGE), "", CHAIN, ""),
        (replace(PLAIN, namespace="robot1"), "robot1", "map → robot1/odom → robot1/base_link", ""),
        (replace(PLAIN, namespace="robot1"), "", "map → robot1/odom → robot1/base_link", ""),
        (replace(PLAIN, base="base_footprint"), "", "map → odom → base_footprint", ""),
        (replace(PLAIN, map_frame=False), "", "/amcl_pose and odom → base_link", ""),
        (replace(PLAIN, odometry_hz=10.0), "", CHAIN, ""),
        (replace(PLAIN, epoch_s=WALL_S), "", CHAIN, ""),
        (replace(PLAIN, log_s=WALL_S), "", CHAIN, ""),
        (replace(PLAIN, stamped=False), "", CHAIN, ""),
        (replace(PLAIN, jump_s=((4.0, 500.0),)), "", CHAIN, "stamps jump by 500 s; times are the log's"),
        (replace(PLAIN, jump_s=((4.0, -500.0),), epoch_s=WALL_S), "", CHAIN, "stamps jump back; times are the log's"),
        (replace(PLAIN, dropped_s=((3.0, 4.2),)), "", CHAIN, "no pose for 1.2 s; poses between are interpolated"),
    ],
)
def test_bag_gives_the_robots_estimate(tmp_path, drive, recorder, namespace, origin, note):
    _, found, recording, notes = imported(recorder.write(tmp_path / "bag", drive), namespace)
    assert found.origin == recording.run.estimated_by == origin
    assert found.truth is None and found.outcome == "succeeded"
    assert off_m(found, drive, recorder.estimate_off_m) < 0.03
    assert (found.goal.x_m, found.goal.y_m) == pytest.approx(drive.true[-1, :2].tolist())
    assert ([note] if note else []) == [*notes]
    assert recording.run.simulated_s == pytest.approx(drive.t_s[-1] - 0.06, abs=0.11)
    assert si(recording.columns["sent_speed_mmps"]).max() == pytest.approx(drive.command[:, 0].max(), abs=1e-3)
    assert recording.columns["t_ms"].tolist() == [100 * k for k in range(len(found.t_s))]


@each_row("plugin, suffix", [(StoragePlugin.MCAP, "*.mcap"), (StoragePlugin.SQLITE3, "*.db3")])
def test_bag_is_read_from_its_file_alone(tmp_path, drive, plugin, suffix):
    (file,) = replace(PLAIN, plugin=plugin).write(tmp_path / "bag", drive).glob(suffix)
    (tmp_path / f"alone{file.suffix}").write_bytes(file.read_bytes())
    _, found, _, notes = imported(tmp_path / f"alone{file.suffix}")
    assert notes == () and off_m(found, drive, 0.05) < 0.03


def test_bag_of_two_files_is_one_drive(tmp_path, drive):
    whole = imported(PLAIN.write(tmp_path / "whole", drive))
    halved = imported(split(tmp_path / "split", PLAIN, drive))
    assert halved[3] == whole[3] == ()
    assert {name: column.tolist() for name, column in halved[2].columns.items()} == {
        name: column.tolist() for name, column in whole[2].columns.items()
    }


def test_bag_of_ros_1_is_read_without_actions(tmp_path, drive):
    unstamped = replace(PLAIN, stamped=False, epoch_s=WALL_S)
    _, found, recording, notes = imported(unstamped.write(tmp_path / "old.bag", drive))
    assert found.origin == CHAIN and found.goal_from == "the first message of /goal_pose"
    assert notes == ("no action tells the outcome; it follows from the distance to the goal",)
    assert off_m(found, drive, 0.05) < 0.03
    assert recording.columns["sent_speed_mmps"].any()


@pytest.mark.parametrize("frame", ["base_link_true", "turtlebot4_base_link_gt"])
def test_bag_with_a_true_frame_gives_the_true_pose(tmp_path, drive, frame):
    _, found, recording, _ = imported(replace(PLAIN, truth=frame).write(tmp_path / "bag", drive))
    t_s = 0.06 + found.t_s - found.t_s[0]
    assert recording.run.estimated_by == ""
    assert found.truth[:, 0] == pytest.approx(np.interp(t_s, drive.t_s, drive.true[:, 0]), abs=0.01)
    apart_mm = recording.columns["estimated_x_mm"] - recording.columns["x_mm"]
    assert np.median(apart_mm) == pytest.approx(50, abs=3)


def test_bag_without_any_place_on_the_map_takes_a_start(tmp_path, drive):
    bare = replace(PLAIN, map_frame=False, amcl=False).write(tmp_path / "bag", drive)
    with pytest.raises(
        BagError, match=r"bag: expected a map frame, /amcl_pose, /initialpose, or --start X,Y,YAW, got fr"
    ):
        imported(bare)
    _, found, _, _ = imported(bare, start=Pose(*drive.true[0].tolist()))
    assert found.origin == "odom → base_link from --start"
    assert off_m(found, drive, 0.0) < 0.1  # by odometry alone


def test_bag_without_action_and_goal_ends_where_the_robot_stands(tmp_path, drive):
    bare = replace(PLAIN, status=False, goal=False).write(tmp_path / "bag", drive)
    _, found, _, notes = imported(bare)
    assert found.goal_from == "where the robot ended, as nothing in the bag names one"
    assert notes == ("no action tells the outcome; it follows from the distance to the goal",)
    assert found.outcome == "succeeded"
    _, missed, recording, _ = imported(bare, goal=Pose(7.0, 5.0))
    assert (missed.outcome, missed.reason) == ("failed", recording.run.reason)
    assert missed.reason.startswith("the bag ended 5.")


def test_bag_of_two_robots_asks_for_one(tmp_path):
    topics = {f"/robot{k}/odom": "nav_msgs/msg/Odometry" for k in (1, 2)}
    with pytest.raises(ValueError, match="expected --namespace, one of robot1, robot2, for odom of several robots"):
        topics_of(topics)
    assert topics_of(topics, "robot2") == {"odometry": "/robot2/odom"}
    with pytest.raises(ValueError, match="--namespace: expected the beginning of a topic, got 'robot3'"):
        topics_of(topics, "robot3")


def test_topics_below_ground_truth_are_the_true_pose_and_contacts():
    topics = {
        "/ground_truth/odom": "nav_msgs/msg/Odometry",
        "/ground_truth/contacts": "visualization_msgs/msg/MarkerArray",
    }
    assert topics_of(topics) == {"truth": "/ground_truth/odom", "contact": "/ground_truth/contacts"}


def test_reading_imports_nothing_from_the_working_directory(drive, tmp_path, monkeypatch):
    for name in ("numpy", "rosbags"):
        (tmp_path / f"{name}.py").write_text("raise SystemExit('code of the folder')\n")
    bag = PLAIN.write(tmp_path / "bag", drive)
    monkeypatch.chdir(tmp_path)
    assert len(read_bag(bag).roles["odometry"])


def test_bag_drops_poses_beyond_any_map(tmp_path, drive):
    wild = replace(drive, odometry=drive.odometry.copy())
    wild.odometry[400] = np.nan
    wild.odometry[600] = 1e9
    _, found, _, notes = imported(PLAIN.write(tmp_path / "bag", wild))
    assert np.isfinite(found.estimate).all()
    assert [note for note in notes if "left out" in note] == [
        "4 left out: transforms that are not finite or beyond 100 km",
        "2 left out: messages of odometry that are not finite or beyond 100 km",
    ]


def corrupted(path, change):
    (file,) = (each for each in path.iterdir() if each.suffix in (".mcap", ".db3"))
    file.write_bytes(change(file.read_bytes()))


@each_row(
    "change",
    [
        lambda raw: raw[: len(raw) // 3],
        lambda raw: b"not a bag" * 100,
        lambda raw: raw[:8] + b"\x01" + b"\xff" * 8 + raw[17:],  # an endless header
    ],
)
def test_broken_bag_is_refused_in_one_sentence(tmp_path, drive, change):
    path = PLAIN.write(tmp_path / "bag", drive)
    corrupted(path, change)
    with pytest.raises(BagError, match=r"bag: can't be read: .") as error:
        imported(path)
    assert "\n" not in str(error.value)


def test_missing_bag_is_named(tmp_path):
    with pytest.raises(BagError, match="none: expected a bag, got no such file or folder"):
        read_bag(tmp_path / "none")


def test_estimate_of_a_turned_odometry_is_on_the_map():
    pose, odometry = np.array([3.0, 2.0, 1.0]), np.array([1.0, -0.5, 0.4])
    outer = beyond(pose, odometry)
    assert joined(outer, odometry) == pytest.approx(pose)
    assert joined(inverse(outer), pose) == pytest.approx(odometry)
