"""Import bags whose messages ROS 2 itself wrote and carried.

Makes an environment of the wheels of ROS 2 Jazzy (rclpy, Fast DDS, messages; 250 MiB) outside of the checkout and deletes it again, or
uses the one that `--environment` names; without the wheels the proof fails. A robot with a motion, a room, and beams of its own publishes;
a recorder with raw subscriptions keeps the bytes, their QoS, hashes, and definitions. They are written as `ros2 bag record` does: by the
`mcap` package, or as SQLite with rosbag2's tables, with metadata of version 9. No wheel has `tf2_msgs`: rosbags serializes these.

    python tests/proofs/rclpy_bags.py [--environment FOLDER] [--only VARIANT ...]

Prints a line per variant. Exit code 1 when a pose, a scan, or a verdict is not the generator's.
"""

import argparse
import os
import pickle
import sqlite3
import subprocess
import sys
import tempfile
import time
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import yaml
from backports import zstd
from mcap.writer import CompressionType, Writer

sys.path.insert(0, str(Path(__file__).parents[1] / "support"))
from bags_by_ros2 import environment
from real_bags import STORE, WALL_S, Recorder, drawn_map, driven, made, ranges_from, time_of

from vastflow.flows.bags.bag import read_bag
from vastflow.flows.bags.imported import write_import
from vastflow.flows.request.campaign_file import read_campaign
from vastflow.flows.request.configurations import distinct_configurations
from vastflow.oracles.judgment.judge import judge_block
from vastflow.oracles.judgment.registry import oracles_of
from vastflow.oracles.observation.observe import observe_block
from vastflow.producers.instantiation.instantiate import instantiate
from vastflow.sim.model.blocks import read_recordings, write_recordings
from vastflow.sim.model.recording import si
from vastflow.sim.run import execute

TF = "tf2_msgs/msg/TFMessage"
LATCHED, SENSOR = ("amcl_pose", "status"), ("scan", "clock")
ROBOT = Path(__file__).with_name("rclpy_robot.py")


@dataclass
class Variant:
    """A kind of bag.

    Attributes:
        storage: `mcap` or `sqlite3`, with the compression of rosbag2 or the writer's preset after a space.
        paced: Whether the robot drives in real time, and the log has the times of arrival.
        hits: Whether the robot drives into the first pillar, and the action is aborted.
    """

    recorder: Recorder
    storage: str = "mcap"
    paced: bool = False
    hits: bool = False


TRUE = Recorder(odometry_hz=25.0, truth="base_link_gt", scan_noise_m=0.02, dropout=0.05, stamped=False)
VARIANTS = {
    "real time": Variant(replace(TRUE, odometry_hz=20.0, scan_hz=5.0, stamped=True), paced=True),
    "mcap": Variant(TRUE),
    "mcap, zstd chunks": Variant(TRUE, "mcap zstd"),
    "mcap, no chunks": Variant(TRUE, "mcap fastwrite"),
    "mcap, zstd messages": Variant(TRUE, "mcap message"),
    "sqlite3": Variant(TRUE, "sqlite3"),
    "sqlite3, zstd file": Variant(TRUE, "sqlite3 file"),
    "sqlite3, zstd messages": Variant(TRUE, "sqlite3 message"),
    "namespace": Variant(replace(TRUE, namespace="robot1"), "sqlite3"),
    "base_footprint": Variant(replace(TRUE, base="base_footprint")),
    "no map frame": Variant(replace(TRUE, map_frame=False, truth="")),
    "no true pose": Variant(replace(TRUE, truth=""), "sqlite3"),
    "10 Hz, scans of 720 beams at 20 Hz": Variant(replace(TRUE, odometry_hz=10.0, scan_hz=20.0, beams=720)),
    "wall-clock stamps": Variant(replace(TRUE, epoch_s=WALL_S)),
    "simulated stamps, wall-clock log": Variant(replace(TRUE, log_s=WALL_S)),
    "no action": Variant(replace(TRUE, status=False)),
    "drives into a pillar": Variant(TRUE, hits=True),
    "drives into a pillar, no true pose": Variant(replace(TRUE, truth=""), hits=True),
}


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--environment", type=Path, help="one that this proof made before, or is to make and keep")
    parser.add_argument("--only", nargs="+", choices=VARIANTS, default=[*VARIANTS])
    asked = parser.parse_args()
    count = 0
    with tempfile.TemporaryDirectory(prefix="vastflow-rclpy-") as temporary:
        python = environment(asked.environment or Path(temporary, "environment"))
        for number, name in enumerate(asked.only):
            folder = Path(temporary, str(number))
            folder.mkdir()
            before_s = time.process_time()
            wrong, about = differences(VARIANTS[name], python, folder)
            print(f"{name}: {about}, {time.process_time() - before_s:.1f} CPU-s", *wrong, sep="\n  ", flush=True)
            count += len(wrong)
    print(f"{len(asked.only)} kinds of bags, {count} differences from the generator")
    return bool(count)


def differences(variant: Variant, python: Path, folder: Path) -> tuple[list[str], str]:
    """Return in sentences what is imported otherwise than the generator has it, and what the bag is."""
    recorder = variant.recorder
    start = (1.2, 3.0, 0.0) if variant.hits else (1.5, 1.2, 0.3)
    drive = driven(lengths_m=(1.2,) if variant.hits else (2.5, 2.0), start=start, dead_s=0.08, lag_s=0.12)
    clock = ((t_s, "/clock", made("rosgraph_msgs/msg/Clock", clock=time_of(t_s))) for t_s in drive.t_s[::10])
    rows = sorted([*recorder.messages(drive), *clock], key=lambda row: row[0])
    if variant.hits:
        rows[-1][2].status_list[0].status = 6
    kept, told = carried(python, rows, variant.paced)
    path = folder / "rosbag2_2026_11_29-10_00_00"
    write(path, variant.storage, recorder, kept, told)
    wrong = [] if len(kept) == len(rows) else [f"{len(rows) - len(kept)} of {len(rows)} messages did not arrive"]
    bag = read_bag(path, scans=True)
    (folder / "campaign").mkdir()
    file, (imported,) = write_import(folder / "campaign", [path], drawn_map(folder / "map"), None, runs=0)
    about = f"{len(kept):,} messages of {len(told)} topics, {sum(f.stat().st_size for f in path.iterdir()):,} bytes"
    (recording,) = read_recordings(next((folder / "campaign" / "recordings").iterdir()))
    columns = recording.columns
    t_s = imported.drive.t_s - recorder.epoch_s
    true = np.column_stack([np.interp(t_s, drive.t_s, drive.true[:, k]) for k in range(3)])
    # A transform of the estimate holds until the next, which is 0.2 s later; the true pose is between two messages.
    for prefix, off_m, most_m in (
        ("estimated_", recorder.estimate_off_m, 0.01),
        *([("", 0.0, 0.05 / recorder.odometry_hz)] if recorder.truth else []),
    ):
        x_m, y_m, yaw_rad = (si(columns[f"{prefix}{name}"]) for name in ("x_mm", "y_mm", "yaw_mrad"))
        apart_m = float(np.hypot(x_m - true[:, 0] - off_m, y_m - true[:, 1]).max())
        apart_rad = float(np.abs(np.angle(np.exp(1j * (yaw_rad - true[:, 2])))).max())
        if apart_m > most_m or apart_rad > 0.01:
            wrong.append(f"{prefix or 'true '}pose: {apart_m:.4f} m, {apart_rad:.4f} rad off")
    scans = [message.ranges for _, topic, message in rows if topic.endswith("/scan")]
    if len(scans) != len(bag.ranges_m) or not all(map(np.array_equal, scans, bag.ranges_m)):
        wrong.append(f"{len(bag.ranges_m)} scans of {len(scans)}, or other ranges")
    outcome = "aborted" if variant.hits else "succeeded"
    if recording.run.outcome != outcome:
        wrong.append(f"outcome: expected {outcome}, got {recording.run.outcome}")
    gone_m = float(np.hypot(*np.diff(true[:, :2], axis=0).T).sum())
    if abs(recording.run.distance_m - gone_m) > (0.03 if recorder.truth else 0.25):
        wrong.append(f"distance: expected {gone_m:.3f} m, got {recording.run.distance_m} m")
    return [*wrong, *misjudged(variant, file, true)], about


def misjudged(variant: Variant, file: Path, true: np.ndarray) -> list[str]:
    """Return in sentences which verdicts are not those that the generator's poses ask for."""
    campaign, _ = read_campaign(file)
    (real,) = distinct_configurations(instantiate(campaign), campaign.runs)
    block = write_recordings([execute(real.scenario, 0, 0).recording])
    oracles = oracles_of([("safety", {"fail_on_contact": "any"}), ("robustness", {}), ("navigation", {})])
    verdicts = {
        v.oracle: v for v in judge_block(real.scenario, block, observe_block(real.scenario, block), oracles).verdicts
    }
    known = bool(variant.recorder.truth)
    expected = {"success": "fail" if variant.hits else "pass", "safety": "fail" if variant.hits else "pass",
                "robustness": "pass", "navigation": "pass"}  # fmt: skip
    if not known:
        expected |= dict.fromkeys(("safety", "robustness"), "not judged")
    wrong = [
        f"{name}: expected {judgment}, got {verdicts[name].judgment} ({verdicts[name].reason})"
        for name, judgment in expected.items()
        if verdicts[name].judgment != judgment
    ]
    if not known:
        wrong += [
            f"{n}: expected the estimate named, got {v.reason!r}"
            for n, v in verdicts.items()
            if "estimate" not in v.reason
        ]
    around = np.linspace(-np.pi, np.pi, 720, endpoint=False)
    nearest_m = min(float(ranges_from(x, y, around).min()) for x, y, _ in true.tolist())
    clearance = verdicts["navigation"].metrics["minimum_clearance"].value
    if known and not variant.hits and abs(clearance - nearest_m) > 0.03:
        wrong.append(f"minimum clearance: expected {nearest_m:.3f} m, got {clearance}")
    if not known and clearance is not None:
        wrong.append(f"minimum clearance: expected none, got {clearance}")
    return wrong


def carried(python: Path, rows: list, paced: bool) -> tuple[list, dict]:
    """Return the messages that a subscriber got, and facts of their topics.

    Returns:
        Topic, log time (ns), and bytes of each; topic to type, hash, QoS, and definition.
    """
    sent, topics, kept = [], {}, []
    for log_s, topic, message in rows:
        if message.__msgtype__ != TF:
            end = topic.rpartition("/")[2]
            topics[topic] = message.__msgtype__, end in LATCHED, end in SENSOR
            sent.append((log_s, topic, plain(message)))
    alone = {**os.environ, "ROS_DOMAIN_ID": "77", "ROS_AUTOMATIC_DISCOVERY_RANGE": "LOCALHOST"}
    given = pickle.dumps((sent, topics, paced))
    ran = subprocess.run([python, ROBOT], input=given, env=alone, check=True, stdout=subprocess.PIPE)
    got, told, began_s = pickle.loads(ran.stdout)
    waiting: dict[str, list[float]] = {}
    for log_s, topic, _ in sent:
        waiting.setdefault(topic, []).append(log_s)
    for topic, at_ns, raw in got:
        log_s = waiting[topic].pop(0)
        kept.append((topic, at_ns if paced else round(log_s * 1e9), raw))
    qos = next(qos for _, qos, _ in told.values() if qos["reliability"] == "reliable")
    for log_s, topic, message in rows:
        if message.__msgtype__ == TF:
            at_s = began_s + log_s if paced else log_s
            kept.append((topic, round(at_s * 1e9), bytes(STORE.serialize_cdr(message, TF))))
            told[topic] = STORE.hash_rihs01(TF), qos, STORE.generate_msgdef(TF, ros_version=2)[0]
    kinds = {topic: message.__msgtype__ for _, topic, message in rows}
    return sorted(kept, key=lambda row: row[1]), {t: (kinds[t], *each) for t, each in told.items()}


def plain(value: object) -> object:
    """Return a message of rosbags as dictionaries, lists, and numbers."""
    if hasattr(value, "__msgtype__"):
        return {name: plain(each) for name, each in vars(value).items() if name == name.lower() != "__msgtype__"}
    if isinstance(value, np.ndarray):
        return value.tolist()
    return [plain(each) for each in value] if isinstance(value, list) else value


def write(path: Path, storage: str, recorder: Recorder, kept: list, told: dict) -> None:
    """Write a folder as `ros2 bag record` does."""
    identifier, _, mode = storage.partition(" ")
    shift_ns = round((recorder.epoch_s + recorder.log_s) * 1e9)
    rows = [(topic, at_ns + shift_ns, zstd.compress(raw) if mode == "message" else raw) for topic, at_ns, raw in kept]
    path.mkdir()
    name = f"{path.name}_0.{'mcap' if identifier == 'mcap' else 'db3'}"
    (write_mcap if identifier == "mcap" else write_sqlite)(path / name, mode, rows, told)
    if mode == "file":
        (path / f"{name}.zstd").write_bytes(zstd.compress((path / name).read_bytes()))
        (path / name).unlink()
        name += ".zstd"
    counts = {topic: sum(row[0] == topic for row in rows) for topic in told}
    first_ns, last_ns = rows[0][1], rows[-1][1]
    span = {
        "starting_time": {"nanoseconds_since_epoch": first_ns},
        "duration": {"nanoseconds": last_ns - first_ns},
        "message_count": len(rows),
    }
    topics = [
        {"topic_metadata": {"name": topic, "type": kind, "serialization_format": "cdr", "offered_qos_profiles": [qos],
                            "type_description_hash": digest}, "message_count": counts[topic]}
        for topic, (kind, digest, qos, _) in told.items()
    ]  # fmt: skip
    compression = (
        {"compression_format": "zstd", "compression_mode": mode.upper()} if mode in ("file", "message") else {}
    )
    about = {
        "version": 9,
        "storage_identifier": identifier,
        **span,
        "topics_with_message_count": topics,
        **({"compression_format": "", "compression_mode": ""} | compression),
        "relative_file_paths": [name],
        "files": [{"path": name, **span}],
        "custom_data": None,
        "ros_distro": "jazzy",
    }
    (path / "metadata.yaml").write_text(yaml.safe_dump({"rosbag2_bagfile_information": about}, sort_keys=False))


def write_mcap(file: Path, mode: str, rows: list, told: dict) -> None:
    compression = CompressionType.ZSTD if mode == "zstd" else CompressionType.NONE
    with file.open("wb") as out:
        writer = Writer(
            out, compression=compression, use_chunking=mode != "fastwrite", enable_crcs=False, chunk_size=786_432
        )
        writer.start("ros2", "libmcap 1.3.1")
        channels = {}
        for topic, (kind, digest, qos, text) in told.items():
            schema = writer.register_schema(kind, "ros2msg", text.encode())
            about = {"topic_type_hash": digest, "offered_qos_profiles": yaml.safe_dump([qos], sort_keys=False)}
            channels[topic] = writer.register_channel(topic, "cdr", schema, about)
        for number, (topic, at_ns, raw) in enumerate(rows):
            writer.add_message(channels[topic], at_ns, raw, max(0, at_ns - 100_000), number)
        writer.add_metadata("rosbag2", {"serialized_metadata": "{}"})
        writer.finish()


def write_sqlite(file: Path, mode: str, rows: list, told: dict) -> None:
    base = sqlite3.connect(file)
    base.executescript("""
        CREATE TABLE schema(schema_version INTEGER PRIMARY KEY,ros_distro TEXT NOT NULL);
        CREATE TABLE metadata(id INTEGER PRIMARY KEY,metadata_version INTEGER NOT NULL,metadata TEXT NOT NULL);
        CREATE TABLE topics(id INTEGER PRIMARY KEY,name TEXT NOT NULL,type TEXT NOT NULL,serialization_format TEXT NOT NULL,
            offered_qos_profiles TEXT NOT NULL,type_description_hash TEXT NOT NULL);
        CREATE TABLE message_definitions(id INTEGER PRIMARY KEY,topic_type TEXT NOT NULL,encoding TEXT NOT NULL,
            encoded_message_definition TEXT NOT NULL,type_description_hash TEXT NOT NULL);
        CREATE TABLE messages(id INTEGER PRIMARY KEY,topic_id INTEGER NOT NULL,timestamp INTEGER NOT NULL, data BLOB NOT NULL);
        CREATE INDEX timestamp_idx ON messages (timestamp ASC);
        INSERT INTO schema VALUES (4, 'jazzy');
    """)
    numbers = {topic: number for number, topic in enumerate(told, 1)}
    for topic, (kind, digest, qos, _) in told.items():
        row = numbers[topic], topic, kind, "cdr", yaml.safe_dump([qos], sort_keys=False), digest
        base.execute("INSERT INTO topics VALUES (?, ?, ?, ?, ?, ?)", row)
    for kind, (digest, text) in {kind: (digest, text) for kind, digest, _, text in told.values()}.items():
        base.execute("INSERT INTO message_definitions VALUES (NULL, ?, 'ros2msg', ?, ?)", (kind, text, digest))
    base.executemany(
        "INSERT INTO messages VALUES (NULL, ?, ?, ?)", ((numbers[t], at_ns, raw) for t, at_ns, raw in rows)
    )
    base.commit()
    base.close()


if __name__ == "__main__":
    sys.exit(main())
