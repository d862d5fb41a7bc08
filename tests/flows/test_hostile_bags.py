"""Bags of strangers who mean harm: read as far as they are whole, or refused in one sentence, within limits."""

import os
import struct
import time
from dataclasses import replace

import numpy as np
import pytest
import yaml
from mcap.writer import CompressionType, Writer
from real_bags import STORE, Recorder, driven
from rosbags.rosbag2 import CompressionMode, StoragePlugin
from table import each_row

from vastflow.flows.bags.bag import BagError, read_bag
from vastflow.flows.bags.drive import clock_of, drive_of
from vastflow.sim.model.faults import UserError
from vastflow.tasks.engine.child import Child

pytestmark = pytest.mark.timeout(300)
PLAIN = Recorder(scans=False, odometry_hz=25.0)
ODOMETRY, SCAN = "nav_msgs/msg/Odometry", "sensor_msgs/msg/LaserScan"
BEGIN = b"\x00\x01\x00\x00"
EMPTY_SCAN = BEGIN + struct.pack("<iII", 0, 0, 1) + b"\0" * 4 + struct.pack("<7f", 0.0, 0.0, 0.1, 0.0, 0.0, 0.0, 1.0)


def bag_of(path, topic, kind, definition, messages, compression=CompressionType.NONE):
    """Write an `.mcap` file of one topic whose definition and bytes are given."""
    with path.open("wb") as file:
        writer = Writer(file, compression=compression)
        writer.start("ros2", "stranger")
        channel = writer.register_channel(topic, "cdr", writer.register_schema(kind, "ros2msg", definition.encode()))
        for number, message in enumerate(messages):
            writer.add_message(channel, number, message, number, number)
        writer.finish()
    return path


def definition_of(kind):
    return STORE.generate_msgdef(kind, ros_version=2)[0]


def nested(depth):
    """A definition of messages within messages."""
    parts = [f"{'=' * 80}\nMSG: nav_msgs/T{k}\nT{k + 1} a" for k in range(1, depth)]
    return "\n".join(["T1 a", *parts, f"{'=' * 80}\nMSG: nav_msgs/T{depth}\nuint8 a"])


def test_scan_that_claims_a_billion_beams_is_left_out(tmp_path):
    claimed = EMPTY_SCAN + struct.pack("<I", 10**9)
    bag = read_bag(bag_of(tmp_path / "scan.mcap", "/scan", SCAN, definition_of(SCAN), [claimed] * 3), scans=True)
    assert bag.notes == ("3 left out: /scan: messages that can't be read",)
    assert len(bag.ranges_m) == 0


def test_scan_of_more_beams_than_any_lidar_is_left_out(tmp_path):
    many = EMPTY_SCAN + struct.pack("<I", 10**6) + b"\0" * 4 * 10**6 + struct.pack("<I", 0)
    bag = read_bag(bag_of(tmp_path / "scan.mcap", "/scan", SCAN, definition_of(SCAN), [many] * 3), scans=True)
    assert bag.notes == ("3 left out: /scan: messages that can't be read",)


@each_row(
    "definition",
    [
        "Odometry a\n",
        f"P[1000000000] a\n{'=' * 80}\nMSG: nav_msgs/P\nstring x\n",
        nested(2000),
        "Unknown a\n",
    ],
)
def test_topic_with_a_definition_beyond_measure_is_left_out(tmp_path, definition):
    begin_s = time.monotonic()
    bag = read_bag(bag_of(tmp_path / "odom.mcap", "/odom", ODOMETRY, definition, [BEGIN + b"\0" * 64] * 100))
    assert bag.notes == ("1 left out: topics with a definition that can't be used, /odom",)
    with pytest.raises(BagError, match="odom: expected transforms or odometry of a robot, got 0 messages"):
        clock_of(bag)
    assert time.monotonic() - begin_s < 100


def test_definition_that_is_no_definition_is_refused(tmp_path):
    with pytest.raises(BagError, match=r"odom\.mcap: can't be read: Could not parse") as error:
        read_bag(bag_of(tmp_path / "odom.mcap", "/odom", ODOMETRY, "float64 x\n= \x1b[2J\n", [BEGIN]))
    assert str(error.value).isprintable()


def test_definitions_execute_nothing(tmp_path):
    out = tmp_path / "out"
    harm = f"__import__('pathlib').Path({str(out)!r}).touch()"
    for text in (f'string A="{harm}"\nfloat64 x\n', f"string x {harm}\n", f'string A="\\"+{harm}+\\""\nint8 x\n'):
        for kind in (ODOMETRY, f"nav_msgs/msg/Odometry\n{harm}"):
            bag_of(path := tmp_path / "odom.mcap", "/odom", kind, text, [BEGIN + b"\0" * 64])
            try:
                read_bag(path)
            except BagError as error:
                assert "\n" not in str(error)
    assert not out.exists()


def test_chunk_that_unpacks_beyond_the_memory_is_refused(tmp_path):
    bomb = EMPTY_SCAN + b"\0" * (1 << 28)
    path = bag_of(tmp_path / "bomb.mcap", "/scan", SCAN, definition_of(SCAN), [bomb], CompressionType.ZSTD)
    assert path.stat().st_size < 100_000
    request = {"path": str(path), "namespace": "", "scans": True}
    child = Child("vastflow.flows.bags.reading:answer", memory_bytes=1 << 29)
    with child, pytest.raises(UserError, match=r"expected to take at most .* of memory, got more"):
        child.ask(request)


def test_file_that_unpacks_beyond_its_limit_is_refused_and_removed(tmp_path, monkeypatch):
    path = replace(PLAIN, compression=CompressionMode.FILE, plugin=StoragePlugin.SQLITE3).write(
        tmp_path / "bag", driven(lengths_m=(1.0,))
    )
    monkeypatch.setenv("TMPDIR", str(tmp_path / "unpacked"))
    (tmp_path / "unpacked").mkdir()
    request = {"path": str(path), "namespace": "", "scans": False}
    child = Child("vastflow.flows.bags.reading:answer", file_bytes=50_000)
    with child, pytest.raises(UserError, match=r"can't be read: .*File too large"):
        child.ask(request)
    assert [*(tmp_path / "unpacked").iterdir()] == []


@each_row("name", ["../../etc/passwd", "/etc/passwd", "..", "."])
def test_bag_reads_no_file_beside_its_folder(tmp_path, name):
    path = PLAIN.write(tmp_path / "bag", driven(lengths_m=(1.0,)))
    about = yaml.safe_load((path / "metadata.yaml").read_text())
    about["rosbag2_bagfile_information"]["relative_file_paths"] = [name]
    (path / "metadata.yaml").write_text(yaml.safe_dump(about))
    with pytest.raises(BagError, match=r"bag: can't be read: .") as error:
        read_bag(path)
    assert "root:" not in str(error.value) and "\n" not in str(error.value)


def test_bag_with_a_pipe_is_refused_at_once(tmp_path):
    path = PLAIN.write(tmp_path / "bag", driven(lengths_m=(1.0,)))
    (path / "bag.mcap").unlink()
    os.mkfifo(path / "bag.mcap")
    for each in (path, path / "bag.mcap"):
        with pytest.raises(BagError, match=r"can't be read: expected regular files, got bag\.mcap"):
            read_bag(each)


def test_bag_whose_clocks_both_jump_by_years_is_refused(tmp_path):
    class Jumping(Recorder):
        def messages(self, drive):
            return ((log_s + 1.7e9 * (log_s > 3.0), *rest) for log_s, *rest in super().messages(drive))

    bag = read_bag(
        Jumping(**{**vars(PLAIN), "jump_s": ((3.0, 1.7e9),)}).write(tmp_path / "bag", driven(lengths_m=(1.5,)))
    )
    with pytest.raises(
        BagError, match=r"bag: expected a mission of a day at most, got 17000000.. s, as if both clocks had"
    ):
        drive_of(bag, clock_of(bag)[0])


def test_bag_of_nothing_but_nan_is_refused(tmp_path):
    drive = driven(lengths_m=(1.0,))
    for values in (drive.true, drive.odometry, drive.motion, drive.command):
        values[:] = np.nan
    bag = read_bag(replace(PLAIN, scans=True).write(tmp_path / "bag", drive), scans=True)
    assert all("not finite" in note for note in bag.notes) and bag.notes
    with pytest.raises(BagError, match="bag: expected transforms or odometry of a robot, got 0 messages"):
        clock_of(bag)


def test_frame_names_move_no_cursor(tmp_path):
    bag = read_bag(
        replace(PLAIN, base="base_link", namespace="\x1b[2J").write(tmp_path / "bag", driven(lengths_m=(1.0,)))
    )
    assert {name for edge in bag.edges for name in edge} == {"map", "?[2J/odom", "?[2J/base_link"}
