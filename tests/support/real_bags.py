"""Bags of a robot that vastflow did not drive: its own room, beams, motion, and noise, written with rosbags."""

from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import yaml
from PIL import Image
from rosbags.rosbag1 import Writer as Ros1Writer
from rosbags.rosbag2 import CompressionFormat, CompressionMode, StoragePlugin, Writer
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

STORE = get_typestore(Stores.ROS2_JAZZY)
WIDTH_M, HEIGHT_M, CELL_M = 8.0, 6.0, 0.05
PILLARS = ((2.5, 3.0, 0.3), (5.5, 3.2, 0.25))
"""Center x, y, and radius (m)."""
MOUNT = (0.1, 0.0, 0.4)
WALL_S = 1_790_000_000.0


def drawn_map(folder):
    """Write the map of the room, whose walls are the outermost cells, and return its YAML file."""
    folder.mkdir(parents=True, exist_ok=True)
    columns, rows = (round(side / CELL_M) + 2 for side in (WIDTH_M, HEIGHT_M))
    gray = np.full((rows, columns), 254, dtype=np.uint8)
    gray[[0, -1], :] = gray[:, [0, -1]] = 0
    y, x = (np.indices((rows, columns)) - 0.5) * CELL_M
    for px, py, radius in PILLARS:
        gray[np.hypot(x - px, y - py) <= radius] = 0
    Image.fromarray(gray[::-1]).save(folder / "room.pgm")
    (folder / "room.yaml").write_text(
        f"{{image: room.pgm, resolution: {CELL_M}, origin: [{-CELL_M}, {-CELL_M}, 0.0], negate: 0, "
        "occupied_thresh: 0.65, free_thresh: 0.196}\n"
    )
    return folder / "room.yaml"


def ranges_from(x, y, bearings):
    """Distances (B,) to the walls and pillars."""
    c, s = np.cos(bearings), np.sin(bearings)
    with np.errstate(divide="ignore", invalid="ignore"):
        far = np.minimum(
            np.where(c > 0, (WIDTH_M - x) / c, np.where(c < 0, -x / c, np.inf)),
            np.where(s > 0, (HEIGHT_M - y) / s, np.where(s < 0, -y / s, np.inf)),
        )
    for px, py, radius in PILLARS:
        along = (px - x) * c + (py - y) * s
        across2 = (px - x) ** 2 + (py - y) ** 2 - along**2
        hit = (along > 0) & (across2 < radius**2)
        far = np.where(hit, np.minimum(far, along - np.sqrt(np.maximum(radius**2 - across2, 0.0))), far)
    return far


@dataclass
class Driven:
    """The motion of a robot, each hundredth of a second."""

    t_s: np.ndarray
    command: np.ndarray
    motion: np.ndarray
    true: np.ndarray
    odometry: np.ndarray


def driven(seed=0, *, lengths_m=(5.0, 3.6) * 2, dead_s=0.0, lag_s=0.0, slip=0.0, start=(1.5, 1.2, 0.0)):
    """Drive around the pillars in a rectangle, turning on the spot, with a rest after each leg.

    Args:
        dead_s, lag_s: Delay of commands, and time constant of the wheels.
        slip: Standard deviation of odometry after 1 m (m) and after 1 rad (rad), in Laplace steps.
    """
    rng = np.random.default_rng(seed)
    step_s, rest = 0.01, np.zeros((100, 2))
    legs = [rest]
    for length_m in lengths_m:
        speed = rng.uniform(0.35, 0.5)
        go = np.tile([speed, 0.0], (round(length_m / speed / step_s), 1))
        turn_rate = rng.uniform(0.6, 0.9)
        turn = np.tile([0.0, turn_rate], (round(np.pi / 2 / turn_rate / step_s), 1))
        legs += [go, rest, turn, rest]
    command = np.concatenate(legs)
    command = command[np.arange(len(command)) // 5 * 5]  # as the messages tell it, 20 times a second
    delayed = np.roll(command, round(dead_s / step_s), axis=0)
    motion, gain = np.zeros_like(command), 1.0 if lag_s == 0 else 1 - np.exp(-step_s / lag_s)
    for k in range(1, len(command)):
        motion[k] = motion[k - 1] + gain * (delayed[k - 1] - motion[k - 1])
    gone = motion * step_s
    scale = slip * np.sqrt(np.abs(gone) / 2)  # a Laplace variable of scale b has the variance 2 b²
    counted = gone + rng.laplace(0.0, 1.0, gone.shape) * scale
    t_s = np.arange(len(command)) * step_s
    return Driven(t_s, command, motion, integrated(gone, start), integrated(counted, (0.0, 0.0, 0.0)))


def integrated(steps, start):
    yaw = start[2] + np.cumsum(steps[:, 1])
    middle = yaw - steps[:, 1] / 2
    x, y = (start[k] + np.cumsum(steps[:, 0] * turn(middle)) for k, turn in enumerate((np.cos, np.sin)))
    return np.column_stack([x, y, yaw])


@dataclass
class Recorder:
    """Properties of a bag, all that real ones differ in.

    Attributes:
        scan_noise_m, dropout: Of the scanner.
        estimate_off_m: Constant error of the robot's estimate.
        log: Time of the log from that of stamps.
    """

    namespace: str = ""
    base: str = "base_link"
    map_frame: bool = True
    amcl: bool = True
    truth: str = ""
    static: bool = True
    odometry_hz: float = 50.0
    scan_hz: float = 10.0
    beams: int = 360
    scans: bool = True
    scan_noise_m: float = 0.0
    dropout: float = 0.0
    estimate_off_m: float = 0.05
    epoch_s: float = 0.0
    log_s: float = 0.0
    status: bool = True
    goal: bool = True
    stamped: bool = True
    plugin: StoragePlugin = StoragePlugin.MCAP
    compression: CompressionMode = CompressionMode.NONE
    dropped_s: tuple = ()
    jump_s: tuple = ()
    seed: int = 0
    extra: dict = field(default_factory=dict)

    def messages(self, drive):
        """Yield log time, topic, type, and message."""
        rng = np.random.default_rng(self.seed + 1)
        p = f"/{self.namespace}" if self.namespace else ""
        n = f"{self.namespace}/" if self.namespace else ""
        off = np.array([self.estimate_off_m, 0.0, 0.0])
        end_s = drive.t_s[-1]
        if self.static:
            yield 0.0, f"{p}/tf_static", self.transform(f"{n}{self.base}", f"{n}laser", MOUNT, 0.0)
        if self.goal:
            gx, gy, gyaw = drive.true[-1]
            yield (
                0.05,
                f"{p}/goal_pose",
                made("geometry_msgs/msg/PoseStamped", header=self.header("map", 0.05), pose=pose_of(gx, gy, gyaw)),
            )
        if self.status:
            yield 0.06, f"{p}/navigate_to_pose/_action/status", status(2)
            yield end_s, f"{p}/navigate_to_pose/_action/status", status(4)
        for k in range(0, len(drive.t_s), round(100 / self.odometry_hz)):
            t_s = drive.t_s[k]
            if any(a <= t_s < b for a, b in self.dropped_s):
                continue
            yield t_s, f"{p}/tf", self.transform(f"{n}odom", f"{n}{self.base}", drive.odometry[k], t_s)
            v, w = drive.motion[k]
            yield (
                t_s,
                f"{p}/odom",
                made(
                    "nav_msgs/msg/Odometry",
                    header=self.header(f"{n}odom", t_s),
                    child_frame_id=f"{n}{self.base}",
                    pose=made(
                        "geometry_msgs/msg/PoseWithCovariance",
                        pose=pose_of(*drive.odometry[k]),
                        covariance=np.zeros(36),
                    ),
                    twist=made("geometry_msgs/msg/TwistWithCovariance", twist=twist(v, w), covariance=np.zeros(36)),
                ),
            )
            if self.truth:
                yield t_s, f"{p}/tf", self.transform("map", f"{n}{self.truth}", drive.true[k], t_s)
        for k in range(0, len(drive.t_s), 20):
            t_s, estimate = drive.t_s[k], drive.true[k] + off
            on_map = beyond(estimate, drive.odometry[k])
            if self.map_frame:
                yield t_s, f"{p}/tf", self.transform("map", f"{n}odom", on_map, t_s + 1.0, log_s=t_s)
            if self.amcl and k % 100 == 0:
                yield (
                    t_s,
                    f"{p}/amcl_pose",
                    made(
                        "geometry_msgs/msg/PoseWithCovarianceStamped",
                        header=self.header("map", t_s),
                        pose=made(
                            "geometry_msgs/msg/PoseWithCovariance", pose=pose_of(*estimate), covariance=np.zeros(36)
                        ),
                    ),
                )
        for k in range(0, len(drive.t_s), 5):
            command = twist(*drive.command[k])
            if self.stamped:
                command = made(
                    "geometry_msgs/msg/TwistStamped", header=self.header("base_link", drive.t_s[k]), twist=command
                )
            yield drive.t_s[k], f"{p}/cmd_vel", command
        bearings = np.linspace(-np.pi, np.pi, self.beams, endpoint=False)
        for k in range(0, len(drive.t_s), round(100 / self.scan_hz)) if self.scans else ():
            x, y, yaw = drive.true[k]
            c, s = np.cos(yaw), np.sin(yaw)
            sx, sy = x + c * MOUNT[0] - s * MOUNT[1], y + s * MOUNT[0] + c * MOUNT[1]
            ranges = self.ranges_from(sx, sy, bearings + yaw + MOUNT[2])
            ranges = ranges + self.scan_noise_m * rng.standard_normal(self.beams)
            ranges[rng.random(self.beams) < self.dropout] = np.inf
            yield (
                drive.t_s[k],
                f"{p}/scan",
                made(
                    "sensor_msgs/msg/LaserScan",
                    header=self.header(f"{n}laser", drive.t_s[k]),
                    angle_min=-np.pi,
                    angle_max=float(bearings[-1]),
                    angle_increment=float(bearings[1] - bearings[0]),
                    time_increment=0.0,
                    scan_time=1 / self.scan_hz,
                    range_min=0.1,
                    range_max=20.0,
                    ranges=ranges.astype(np.float32),
                    intensities=np.empty(0, dtype=np.float32),
                ),
            )

    def ranges_from(self, x, y, bearings):
        return ranges_from(x, y, bearings)

    def header(self, frame, t_s):
        for at_s, by_s in self.jump_s:
            t_s = t_s + by_s * (t_s >= at_s)
        return made("std_msgs/msg/Header", stamp=time_of(t_s + self.epoch_s), frame_id=frame)

    def transform(self, parent, child, pose, t_s, log_s=None):
        x, y, yaw = pose
        quaternion = made(
            "geometry_msgs/msg/Quaternion", x=0.0, y=0.0, z=float(np.sin(yaw / 2)), w=float(np.cos(yaw / 2))
        )
        moved = made("geometry_msgs/msg/Transform", translation=vector(x, y), rotation=quaternion)
        each = made(
            "geometry_msgs/msg/TransformStamped", header=self.header(parent, t_s), child_frame_id=child, transform=moved
        )
        return made("tf2_msgs/msg/TFMessage", transforms=[each])

    def write(self, path: Path, drive):
        """Write the bag and return its path."""
        rows = sorted(self.messages(drive), key=lambda row: row[0])
        if path.suffix == ".bag":
            return self._write_ros1(path, rows)
        writer = Writer(path, version=9, storage_plugin=self.plugin)
        if self.compression != CompressionMode.NONE:
            writer.set_compression(self.compression, CompressionFormat.ZSTD)
        with writer:
            connections = {}
            for log_s, topic, message in rows:
                kind = message.__msgtype__
                if topic not in connections:
                    connections[topic] = writer.add_connection(topic, kind, typestore=STORE)
                raw = STORE.serialize_cdr(message, kind)
                writer.write(connections[topic], round((log_s + self.epoch_s + self.log_s) * 1e9), raw)
        return path

    def _write_ros1(self, path, rows):
        """Write a bag of ROS 1, which has no actions and no time 0."""
        store = get_typestore(Stores.ROS1_NOETIC)
        tf = "tf2_msgs/msg/TFMessage"
        store.register(get_types_from_msg("geometry_msgs/TransformStamped[] transforms", tf))
        with Ros1Writer(path) as writer:
            connections = {}
            for log_s, topic, message in rows:
                kind = message.__msgtype__
                if kind not in store.fielddefs:
                    continue
                if topic not in connections:
                    connections[topic] = writer.add_connection(topic, kind, typestore=store)
                raw = store.serialize_ros1(of_ros1(message, store), kind)
                writer.write(connections[topic], round((log_s + self.epoch_s + self.log_s) * 1e9), raw)
        return path


def of_ros1(value, store):
    """The same message with the types of ROS 1, whose headers count."""
    if isinstance(value, list):
        return [of_ros1(each, store) for each in value]
    if not hasattr(value, "__msgtype__"):
        return value
    fields = {name: of_ros1(each, store) for name, each in vars(value).items()}
    if value.__msgtype__ == "std_msgs/msg/Header":
        fields["seq"] = 0
    return store.types[value.__msgtype__](**fields)


def split(path, recorder, drive):
    """Write a bag of two files, as a recorder with a limit of size does."""
    whole = recorder.write(path, drive)
    halves = []
    for k in range(2):

        class Half(Recorder):
            def messages(self, drive, k=k):
                middle_s = drive.t_s[-1] / 2
                return (row for row in super().messages(drive) if (row[0] < middle_s) == (k == 0))

        halves.append(Half(**vars(recorder)).write(path.parent / f"half{k}", drive))
    (whole / f"{path.name}.mcap").unlink()
    names = [f"{path.name}_{k}.mcap" for k in range(2)]
    for half, name in zip(halves, names, strict=True):
        (half / f"{half.name}.mcap").rename(whole / name)
    about = yaml.safe_load((whole / "metadata.yaml").read_text())
    inner = about["rosbag2_bagfile_information"]
    inner["relative_file_paths"] = names
    inner["files"] = [{**inner["files"][0], "path": name} for name in names]
    (whole / "metadata.yaml").write_text(yaml.safe_dump(about))
    return whole


def made(kind, **fields):
    return STORE.types[kind](**fields)


def time_of(t_s):
    ns = max(0, round(float(t_s) * 1e9))
    return made("builtin_interfaces/msg/Time", sec=ns // 10**9, nanosec=ns % 10**9)


def vector(x, y, z=0.0):
    return made("geometry_msgs/msg/Vector3", x=float(x), y=float(y), z=float(z))


def pose_of(x, y, yaw):
    quaternion = made("geometry_msgs/msg/Quaternion", x=0.0, y=0.0, z=float(np.sin(yaw / 2)), w=float(np.cos(yaw / 2)))
    return made(
        "geometry_msgs/msg/Pose",
        position=made("geometry_msgs/msg/Point", x=float(x), y=float(y), z=0.0),
        orientation=quaternion,
    )


def twist(v, w):
    return made("geometry_msgs/msg/Twist", linear=vector(v, 0.0), angular=vector(0.0, 0.0, w))


def status(code):
    uuid = made("unique_identifier_msgs/msg/UUID", uuid=np.zeros(16, dtype=np.uint8))
    info = made("action_msgs/msg/GoalInfo", goal_id=uuid, stamp=time_of(0.0))
    return made(
        "action_msgs/msg/GoalStatusArray", status_list=[made("action_msgs/msg/GoalStatus", goal_info=info, status=code)]
    )


def beyond(outer, inner):
    """Pose of the frame in which `inner` is where `outer` is."""
    yaw = outer[2] - inner[2]
    c, s = np.cos(yaw), np.sin(yaw)
    return np.array([outer[0] - (c * inner[0] - s * inner[1]), outer[1] - (s * inner[0] + c * inner[1]), yaw])
