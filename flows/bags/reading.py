"""Reading of a bag in a process of its own, which a stranger's bytes may end."""

import math
import pickle
import re
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from vastflow.flows.bags.bag import Bag, Messages, ScanShape
from vastflow.flows.export.mcap.topics import typestore
from vastflow.sim.model.faults import UserError

MOST_BEAMS: Final = 4096
MOST_ELEMENTS: Final = 4096
"""Elements of an array of fixed size in a definition."""
MOST_METERS: Final = 1e5
"""Coordinates beyond are no place on a map."""

ROLES: Final[Mapping[str, tuple[str, tuple[str, ...]]]] = {
    "tf": ("TFMessage", ("tf",)),
    "tf_static": ("TFMessage", ("tf_static",)),
    "scan": ("LaserScan", ("scan", "")),
    "odometry": ("Odometry", ("odom", "odometry", "odometry/filtered", "")),
    "truth": ("Odometry", ("ground_truth", "ground_truth/odom", "odom_ground_truth", "groundtruth", "odom_gt")),
    "command": ("Twist|TwistStamped", ("cmd_vel",)),
    "control": ("Twist|TwistStamped", ("cmd_vel_nav",)),
    "estimate": ("PoseWithCovarianceStamped", ("amcl_pose",)),
    "initial": ("PoseWithCovarianceStamped", ("initialpose",)),
    "goal": ("PoseStamped", ("goal_pose", "goal", "move_base_simple/goal")),
    "plan": ("Path", ("plan",)),
    "status": ("GoalStatusArray", ("navigate_to_pose/_action/status", "navigate_through_poses/_action/status")),
    "contact": ("MarkerArray", ("ground_truth/contacts",)),
    "tree": ("BehaviorTreeLog", ("behavior_tree_log",)),
}
"""What a topic is for, to its type and the ends of its name, best first; an empty end is any name, of a single topic."""
_TRUE: Final = re.compile("ground_?truth|_gt$")


def read(path: Path, namespace: str, scans: bool) -> Bag:
    from rosbags.highlevel import AnyReader

    files = [file for file in path.rglob("*") if not file.is_dir()] if path.is_dir() else [path]
    if strange := [file.name for file in files if not file.is_file()]:
        raise ValueError(f"expected regular files, got {strange[0]}")
    into = _Gathered()
    with AnyReader([path], default_typestore=typestore()) as reader:
        storage: Any = getattr(reader.readers[0], "storage", None)  # a ROS 1 bag has none
        about = getattr(getattr(storage, "metadata", None), "custom", None)
        if isinstance(about, dict) and "vastflow" in about:
            into.exported = str(about.get("outcome")), _printable(str(about.get("reason", "")))
        connections = {connection.topic: connection.msgtype for connection in reader.connections}
        topics = topics_of(connections, namespace)
        role_of = {topic: role for role, topic in topics.items() if scans or role != "scan"}
        wanted = [each for each in reader.connections if each.topic in role_of and into.has_type(reader, each)]
        for connection, log_ns, raw in reader.messages(wanted) if wanted else ():
            try:
                message = reader.deserialize(raw, connection.msgtype)
                into.take(role_of[connection.topic], message, log_ns * 1e-9)
            except MemoryError:
                raise
            except Exception:  # noqa: BLE001 - a stranger's bytes; the others may be whole
                into.dropped[f"{connection.topic}: messages that can't be read"] += 1
    return into.bag(path.stem, topics, namespace)


def topics_of(connections: Mapping[str, str], namespace: str = "") -> dict[str, str]:
    """Return the topic of each role by type and name.

    Args:
        connections: Topic to type.

    Raises:
        ValueError: topics of several robots, or none of this namespace.
    """
    prefix = f"/{namespace.strip('/')}/" if namespace.strip("/") else ""
    if prefix and not any(topic.startswith(prefix) for topic in connections):
        raise ValueError(f"--namespace: expected the beginning of a topic, got {namespace!r}")
    found: dict[str, str] = {}
    for role, (kind, ends) in ROLES.items():
        of_kind = [t for t, name in connections.items() if name.rpartition("/")[2] in kind.split("|")]
        of_kind = [t for t in of_kind if not prefix or t.startswith(prefix) or "tf" in role]
        of_kind = [
            t for t in of_kind if t not in found.values() and (role in ("truth", "contact") or not _TRUE.search(t))
        ]
        for end in ends:
            named = [t for t in of_kind if not end or t == f"/{end}" or t.endswith(f"/{end}")]
            own = [t for t in named if prefix and t.startswith(prefix)] or named
            if len(own) > 1 and end and "tf" not in role:
                robots = ", ".join(sorted(t.removesuffix(end).strip("/") or "/" for t in own))
                raise ValueError(f"expected --namespace, one of {robots}, for {end} of several robots")
            if len(own) == 1 or (own and "tf" in role):
                found[role] = own[0]
                break
    return found


class _Gathered:
    """Rows of messages by their roles."""

    def __init__(self) -> None:
        self.dropped: Counter[str] = Counter()
        self.exported: tuple[str, str] | None = None
        self._rows: dict[str, list[tuple[float, ...]]] = {role: [] for role in ROLES}
        self._edges: dict[tuple[str, str], list[tuple[float, ...]]] = {}
        self._fixed: dict[tuple[str, str], tuple[float, float, float]] = {}
        self._frames = ("", "")
        self._behaviors: list[tuple[float, str]] = []
        self._scan: ScanShape | None = None
        self._ranges: list[NDArray[np.float32]] = []

    def has_type(self, reader: Any, connection: Any) -> bool:
        """Whether the definition of a topic's type can be compiled, which takes a line per element of an array."""
        from rosbags.interfaces import Nodetype

        fields = (field for _, (_, each) in reader.typestore.fielddefs.items() for _, field in each)
        try:
            assert all(kind != Nodetype.ARRAY or what[1] <= MOST_ELEMENTS for kind, what in fields)
            reader.typestore.get_msgdef(connection.msgtype)
        except Exception:  # noqa: BLE001 - a stranger's definition; those of other topics may be whole
            self.dropped[f"topics with a definition that can't be used, {connection.topic}"] += 1
            return False
        return True

    def take(self, role: str, message: Any, log_s: float) -> None:
        stamp_s = math.nan if not hasattr(message, "header") else _seconds(message.header.stamp)
        if role in ("tf", "tf_static"):
            for each in message.transforms:
                edge = _frame(each.header.frame_id), _frame(each.child_frame_id)
                pose = _planar(each.transform.translation, each.transform.rotation)
                if not _is_place(pose):
                    self.dropped["transforms that are not finite or beyond 100 km"] += 1
                elif role == "tf_static":
                    self._fixed[edge] = pose
                else:
                    self._edges.setdefault(edge, []).append((log_s, _seconds(each.header.stamp), *pose))
            return
        if role == "tree":
            began = (each for each in message.event_log if each.current_status == "RUNNING")
            self._behaviors += [(log_s, str(each.node_name)) for each in began]
            return
        if role == "scan":
            self._take_scan(message)
            return
        if role == "odometry":
            self._frames = _frame(message.header.frame_id), _frame(message.child_frame_id)
        for row in VALUES[role](message):
            if _is_place(row):
                self._rows[role].append((log_s, stamp_s, *row))
            else:
                self.dropped[f"messages of {role} that are not finite or beyond 100 km"] += 1

    def _take_scan(self, message: Any) -> None:
        limits = message.angle_increment, message.range_min, message.range_max
        shape = ScanShape(_frame(message.header.frame_id), *map(float, limits))
        beams = len(message.ranges)
        if not 2 <= beams <= MOST_BEAMS or not all(map(math.isfinite, limits[:2])) or not limits[0]:
            raise ValueError(f"a scan of {beams} beams")
        if self._scan is None:
            self._scan = shape
        if shape.frame != self._scan.frame or (self._ranges and beams != len(self._ranges[0])):
            self.dropped["scans of another shape"] += 1
        else:
            self._ranges.append(np.array(message.ranges, dtype=np.float32))

    def bag(self, name: str, topics: Mapping[str, str], namespace: str) -> Bag:
        own = f"{namespace.strip('/')}/"

        def is_own(edge: tuple[str, str]) -> bool:
            return not namespace or any(frame.startswith(own) for frame in edge) or not any("/" in f for f in edge)

        return Bag(
            name,
            topics,
            {role: _messages(rows) for role, rows in self._rows.items()},
            self._frames,
            {edge: _messages(rows) for edge, rows in self._edges.items() if is_own(edge)},
            {edge: pose for edge, pose in self._fixed.items() if is_own(edge)},
            tuple(self._behaviors),
            self._scan,
            np.array(self._ranges, dtype=np.float32),
            self.exported,
            tuple(f"{count:,} left out: {what}" for what, count in self.dropped.items()),
        )


def _messages(rows: Sequence[tuple[float, ...]]) -> Messages:
    table = np.array(rows, dtype=np.float64).reshape(len(rows), -1) if rows else np.empty((0, 7))
    table = table[np.argsort(table[:, 0], kind="stable")]
    return Messages(table[:, 0], table[:, 1], table[:, 2:])


def _seconds(stamp: Any) -> float:
    return float(stamp.sec) + float(stamp.nanosec) * 1e-9


def _frame(name: str) -> str:
    return _printable(name).strip("/")


def _printable(text: str) -> str:
    """Return a text without what moves a terminal's cursor."""
    return "".join(each if each.isprintable() else "?" for each in text)


def _planar(position: Any, turn: Any) -> tuple[float, float, float]:
    yaw_rad = math.atan2(2.0 * (turn.w * turn.z + turn.x * turn.y), 1.0 - 2.0 * (turn.y * turn.y + turn.z * turn.z))
    return float(position.x), float(position.y), yaw_rad


def _pose(pose: Any) -> tuple[float, float, float]:
    return _planar(pose.position, pose.orientation)


def _twist(twist: Any) -> tuple[float, float]:
    return float(twist.linear.x), float(twist.angular.z)


def _is_place(values: Sequence[float]) -> bool:
    return all(abs(value) <= MOST_METERS for value in values)


VALUES: Final[Mapping[str, Callable[[Any], Sequence[tuple[float, ...]]]]] = {
    **dict.fromkeys(("odometry", "truth"), lambda m: [(*_pose(m.pose.pose), *_twist(m.twist.twist))]),
    **dict.fromkeys(("command", "control"), lambda m: [_twist(getattr(m, "twist", m))]),
    **dict.fromkeys(("estimate", "initial"), lambda m: [_pose(m.pose.pose)]),
    "goal": lambda m: [_pose(m.pose)],
    "contact": lambda m: [_pose(each.pose) for each in m.markers if each.action == 0],
    "plan": lambda m: [_pose(each.pose) for each in m.poses[-1:]],
    "status": lambda m: [(float(each.status),) for each in m.status_list[-1:]],
}
"""Role to the rows of a message."""


def answer(request: Mapping[str, Any]) -> bytes:
    """Return the pickled bag; raises `UserError` with the reason that it can't be read."""
    try:
        return pickle.dumps(read(Path(request["path"]), request["namespace"], request["scans"]))
    except MemoryError:
        raise
    except Exception as error:  # noqa: BLE001 - whatever a stranger's bytes make a reader raise
        raise UserError(
            f"can't be read: {_printable(' '.join(str(error).split())[:300]) or type(error).__name__}"
        ) from None
