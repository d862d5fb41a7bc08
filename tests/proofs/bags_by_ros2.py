"""Read an exported run by ROS 2's own type support, and compare it with the recording.

Makes an environment of the wheels of ROS 2 Jazzy (rclpy, Fast DDS, messages; 250 MiB) outside of the checkout and deletes it again, or
uses the one that `--environment` names. The run is exported by `vastflow export --format mcap`. No wheel has `tf2_msgs` and `nav2_msgs`:
their messages are read by rosbags here, and counted.

    python tests/proofs/bags_by_ros2.py RESULTS CONFIGURATION RUN [--environment FOLDER]

Prints size, CPU seconds, and each topic's count. Exit code 1 when a count, a type, a stamp, or a pose is not the recording's.
"""

import argparse
import json
import resource
import subprocess
import sys
import tempfile
from collections import Counter
from pathlib import Path

from mcap.reader import make_reader
from rosbags.highlevel import AnyReader

from vastflow.flows.export.mcap.topics import TOPICS, typestore
from vastflow.oracles.replay.recorded import recorded_run

WHEELS = [
    "ros-jazzy-rclpy[fastrtps]",
    *(f"ros-jazzy-{name}-msgs" for name in ("geometry", "nav", "rosgraph", "sensor", "std", "visualization")),
    "ros-jazzy-rcl-interfaces",
]
ELSEWHERE = ("tf2_msgs", "nav2_msgs")
READER = """
import importlib, json, struct, sys
from rclpy.serialization import deserialize_message
told = {}
with open(sys.argv[1], "rb") as file:
    while head := file.read(16):
        kind, topic, size = struct.unpack("<IIQ", head)
        kind, topic, content = file.read(kind).decode(), file.read(topic).decode(), file.read(size)
        package, _, name = kind.split("/")
        Kind = getattr(importlib.import_module(f"{package}.msg"), name)
        message = deserialize_message(content, Kind)
        each = told.setdefault(topic, {"stamps": [], "values": [], "fields": list(Kind.get_fields_and_field_types())})
        if hasattr(message, "header"):
            each["stamps"].append(message.header.stamp.sec * 10**9 + message.header.stamp.nanosec)
        if kind == "nav_msgs/msg/Odometry":
            at = message.pose.pose.position
            each["values"].append([at.x, at.y, message.header.frame_id, message.child_frame_id])
        elif kind == "geometry_msgs/msg/Twist":
            each["values"].append([message.linear.x, message.angular.z])
        else:
            each["values"].append(None)
json.dump(told, sys.stdout)
"""


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("results", type=Path)
    parser.add_argument("configuration")
    parser.add_argument("run", type=int)
    parser.add_argument("--environment", type=Path, help="one that this proof made before, or is to make and keep")
    asked = parser.parse_args()
    with tempfile.TemporaryDirectory(prefix="vastflow-ros2-") as temporary:
        python = environment(asked.environment or Path(temporary, "environment"))
        bag = exported(asked.results, asked.configuration, asked.run, Path(temporary))
        wrong = differences(bag, python, asked.results, asked.configuration, asked.run)
    print("\n".join(wrong) or "equal to the recording, as ROS 2 reads it")
    return bool(wrong)


def environment(folder: Path) -> Path:
    """Return the interpreter of an environment with ROS 2's wheels, made where there is none."""
    python = folder / "bin" / "python"
    if not python.exists():
        subprocess.run(["uv", "venv", "-q", "--python", "3.11", folder], check=True)
        subprocess.run(["uv", "pip", "install", "-q", "--python", python, *WHEELS], check=True)
    return python


def exported(results: Path, configuration: str, run: int, folder: Path) -> Path:
    """Return the bag of a run, and print what it took."""
    place = folder / "exported"
    command = [sys.executable, "-m", "vastflow.flows.cli", "export", results, place, "--format", "mcap"]
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    subprocess.run([*command, "--only", f"{configuration}/{run}"], check=True)
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    bag = place / configuration / str(run) / "rosbag2"
    cpu_s = after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
    print(f"{(bag / 'rosbag2.mcap').stat().st_size:,} bytes, {cpu_s:.1f} CPU-s with the start of the command")
    return bag


def differences(bag: Path, python: Path, results: Path, configuration: str, run: int) -> list[str]:
    """Return in sentences what ROS 2 reads otherwise than the recording has it."""
    wrong, counts, kinds = [], Counter[str](), {}
    given = bag / "messages.bin"
    with (bag / "rosbag2.mcap").open("rb") as file, given.open("wb") as out:
        last_ns = 0
        for schema, channel, message in make_reader(file).iter_messages(log_time_order=False):
            counts[channel.topic] += 1
            kinds[channel.topic] = schema.name
            if message.log_time < last_ns:
                wrong.append(f"{channel.topic}: {message.log_time} ns comes after {last_ns} ns")
            last_ns = message.log_time
            if not schema.name.startswith(ELSEWHERE):
                parts = schema.name.encode(), channel.topic.encode(), message.data
                out.write(b"".join(len(part).to_bytes(8 if k == 2 else 4, "little") for k, part in enumerate(parts)))
                out.write(b"".join(parts))
    read = subprocess.run([python, "-c", READER, given], check=True, capture_output=True, text=True)
    told = json.loads(read.stdout)
    columns = recorded_run(results, configuration, run).recording.columns
    for topic, count in sorted(counts.items()):
        kind = kinds[topic]
        if kind != TOPICS[topic].kind:
            wrong.append(f"{topic}: expected {TOPICS[topic].kind}, got {kind}")
        reader = "rosbags" if kind.startswith(ELSEWHERE) else "ROS 2"
        print(f"{count:6} {topic} {kind} by {reader}")
        if reader == "ROS 2":
            each = told[topic]
            own = [name for name, _ in typestore().fielddefs[kind][1]]
            if each["fields"] != own:
                wrong.append(f"{topic}: ROS 2 has fields {each['fields']}, the bag {own}")
            if len(each["values"]) != count or each["stamps"] != sorted(each["stamps"]):
                wrong.append(f"{topic}: {len(each['values'])} of {count} messages were read, or stamps go back")
    truth = told["/ground_truth/odom"]
    rows = zip(columns["t_ms"].tolist(), columns["x_mm"].tolist(), columns["y_mm"].tolist(), strict=True)
    expected = [[t * 10**6, x / 1e3, y / 1e3, "map", "base_link_true"] for t, x, y in rows]
    found = [[stamp, *value] for stamp, value in zip(truth["stamps"], truth["values"], strict=True)]
    if not close(found, expected):
        wrong.append("/ground_truth/odom has other poses than the recording")
    sent = zip(columns["sent_speed_mmps"].tolist(), columns["sent_yaw_rate_mradps"].tolist(), strict=True)
    if not close(told["/cmd_vel"]["values"], [[v / 1e3, w / 1e3] for v, w in sent]):
        wrong.append("/cmd_vel has other commands than the recording")
    if counts["/amcl_pose"] != int(columns["localized"].sum()):
        wrong.append(f"/amcl_pose: expected {int(columns['localized'].sum())} messages, got {counts['/amcl_pose']}")
    return [*wrong, *disconnected(bag)]


def close(found: list[list[object]], expected: list[list[object]]) -> bool:
    """Whether rows have the same texts, and numbers to a millionth."""
    return len(found) == len(expected) and all(
        a == b or (isinstance(a, float) and isinstance(b, float) and abs(a - b) < 1e-6)
        for mine, theirs in zip(found, expected, strict=True)
        for a, b in zip(mine, theirs, strict=True)
    )


def disconnected(bag: Path) -> list[str]:
    """Return the times at which frames don't form a tree below the map."""
    parents, wrong = {}, []
    with AnyReader([bag], default_typestore=typestore()) as reader:
        for static in (True, False):
            topic = "/tf_static" if static else "/tf"
            for connection, t_ns, raw in reader.messages(c for c in reader.connections if c.topic == topic):
                now = {each.child_frame_id: each.header.frame_id for each in
                       reader.deserialize(raw, connection.msgtype).transforms}  # fmt: skip
                if any(parents.get(child, parent) != parent for child, parent in now.items()):
                    wrong.append(f"{t_ns} ns: a frame has two parents")
                parents |= now
                if not static and {root(child, parents) for child in parents} != {"map"}:
                    wrong.append(f"{t_ns} ns: the frames {sorted(parents)} don't all hang from the map")
    return wrong


def root(frame: str, parents: dict[str, str]) -> str:
    """Return the frame that a frame hangs from at last."""
    for _ in parents:
        frame = parents.get(frame, frame)
    return frame


if __name__ == "__main__":
    sys.exit(main())
