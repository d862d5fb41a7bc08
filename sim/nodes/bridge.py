"""The bridge: a node of ROS 2 between the simulated robot and the nodes under test.

Executed as a file by the Python of a ROS 2 installation, `bridge.py SOCKET`, on this machine or in a container: it imports the standard library,
rclpy, and the files beside it. It connects to a UNIX socket, on which each message is its length (4 bytes, big-endian), a JSON object, and as many raw bytes as
the object's `bytes` says. It gets the setup, then a message for each tick of the simulation, and answers each: it publishes, lets nodes
answer, and tells what they published.
"""

import array
import math
import socket
import struct
import sys
import time
from collections.abc import Callable
from typing import Any

from bridge_messages import Problem, imported, is_there, place, receive, send, yaw_of
from bridge_missions import Missions
from bridge_wheels import Wheels

MOST_CALLBACKS = 2000
"""Callbacks in a tick of the simulation, so that a topic that is flooded holds nobody up."""
MOST_RECORDED_BYTES = 16 << 20
"""Bytes that are recorded in a tick."""
QUIET_S = 0.5
"""Time without a change of the graph after which nodes have found each other, and without an answer after which late ones have come."""
REPEAT_S = 1.0
MOST_DOUBTFUL = 10
AT_ONCE_S = 1e-6
"""An executor that waits for no time at all ends after one message of each topic, as if that were all."""


class Bridge:
    """Publishers and subscriptions of the node, as the setup asks for them."""

    def __init__(self, setup: dict[str, Any], map_cells: bytes) -> None:
        import rclpy
        from rclpy.executors import SingleThreadedExecutor
        from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy

        self.setup = setup
        self.topics, self.frames = setup["topics"], setup["frames"]
        rclpy.init(args=None)
        self.node = rclpy.create_node("vastflow_bridge", enable_rosout=False, start_parameter_services=False)
        self.executor = SingleThreadedExecutor()
        self.executor.add_node(self.node)
        self.now_ns = self.scan_ns = 0
        self.command: list[float] | None = None
        self.commands = self.answers = 0
        self.estimate: list[float] | None = None
        self.covariance: list[float] | None = None
        self.updates = 0
        self.map_odom: list[float] | None = None
        self.log: list[list[Any]] = []
        self.recorded: list[tuple[int, str, str, bytes]] = []
        self.recorded_bytes = self.dropped = 0
        self.missions = Missions(self.node, setup["actions"], self._until)

        def qos(depth: int, *, best_effort: bool = False, latched: bool = False) -> Any:
            return QoSProfile(
                depth=depth,
                reliability=ReliabilityPolicy.BEST_EFFORT if best_effort else ReliabilityPolicy.RELIABLE,
                durability=DurabilityPolicy.TRANSIENT_LOCAL if latched else DurabilityPolicy.VOLATILE,
            )

        def publisher(role: str, kind: str, profile: Any) -> Any:
            made = self.node.create_publisher(imported(kind), self.topics[role], profile)
            self.published.append(made)
            return made

        self.published: list[Any] = []
        self.watched: dict[str, Any] = {}
        latched = qos(1, latched=True)
        self.clock = publisher("clock", "rosgraph_msgs/msg/Clock", qos(1, best_effort=True))
        self.odometry = publisher("odom", "nav_msgs/msg/Odometry", qos(10))
        self.scan = publisher("scan", "sensor_msgs/msg/LaserScan", qos(5, best_effort=True))
        self.initial = publisher("initialpose", "geometry_msgs/msg/PoseWithCovarianceStamped", qos(1))
        self.goal = publisher("goal", "geometry_msgs/msg/PoseStamped", qos(1))
        self.has_tf = is_there("tf2_msgs/msg/TFMessage")
        if self.has_tf:
            self.tf = publisher("tf", "tf2_msgs/msg/TFMessage", qos(100))
            self.tf_static = publisher("tf_static", "tf2_msgs/msg/TFMessage", latched)
            self._subscribe(self.topics["tf"], "tf2_msgs/msg/TFMessage", qos(100), self._heard_tf)
            mount = self._transform(self.frames["base"], self.frames["laser"], *setup["mount"])
            self.tf_static.publish(imported("tf2_msgs/msg/TFMessage")(transforms=[mount]))
        if setup["joints"]:
            self.wheels = Wheels(setup["joints"])
            self.joints = publisher("joint_states", "sensor_msgs/msg/JointState", qos(10))
        if setup["map"]:
            self.map = publisher("map", "nav_msgs/msg/OccupancyGrid", latched)
            self._publish_map(map_cells)
        kind = "geometry_msgs/msg/TwistStamped" if setup["stamped"] else "geometry_msgs/msg/Twist"
        self._subscribe(self.topics["cmd_vel"], kind, qos(10), self._heard_command)
        kind = "geometry_msgs/msg/PoseWithCovarianceStamped"
        self._subscribe(self.topics["amcl_pose"], kind, qos(10), self._heard_estimate)
        self._subscribe(self.topics["rosout"], "rcl_interfaces/msg/Log", qos(1000), self._heard_log)
        self.ticks = self.scans = 0
        self.late: set[int] = set()
        self.doubtful = 0

    def _subscribe(self, topic: str, kind: str, profile: Any, callback: Callable[[Any], None] | None = None) -> None:
        """Have messages of a topic heard by a callback, recorded where that is asked for, and counted as answers."""
        from rclpy.serialization import deserialize_message

        read = imported(kind)
        is_answer, is_recorded = topic == self.setup["answer"], topic in self.setup["record"]
        has_stamp = next(iter(read.get_fields_and_field_types().values()), "") == "std_msgs/Header"

        def heard(content: bytes) -> None:
            if callback is not None:
                callback(deserialize_message(content, read))
            if is_answer:
                byte_order = "<" if content[1] else ">"
                seconds, rest_ns = struct.unpack_from(f"{byte_order}iI", content, 4) if has_stamp else (0, 0)
                self._answered(seconds * 10**9 + rest_ns)
            if not is_recorded:
                return
            if self.recorded_bytes + len(content) > MOST_RECORDED_BYTES:
                self.dropped += 1
                return
            self.recorded_bytes += len(content)
            self.recorded.append((self.now_ns, topic, kind, content))

        self.watched[topic] = self.node.create_subscription(read, topic, heard, profile, raw=True)

    def _heard_command(self, message: Any) -> None:
        twist = getattr(message, "twist", message)
        self.command = [twist.linear.x, twist.linear.y, twist.angular.z]
        self.commands += 1

    def _answered(self, stamp_ns: int) -> None:
        """Count an answer, unless its stamp is that of an earlier scan without one."""
        if stamp_ns == 0 or stamp_ns not in self.late:  # 0 may be an empty stamp
            self.answers += 1
            self.answered_s = time.monotonic()

    def _heard_estimate(self, message: Any) -> None:
        pose, cells = message.pose.pose, message.pose.covariance
        self.estimate = [pose.position.x, pose.position.y, yaw_of(pose.orientation)]
        self.covariance = [float(cells[k]) for k in (0, 1, 7, 35)]
        self.updates += 1

    def _heard_tf(self, message: Any) -> None:
        for each in message.transforms:
            frames = each.header.frame_id.strip("/"), each.child_frame_id.strip("/")
            if frames == (self.frames["map"], self.frames["odom"]):
                at = each.transform.translation
                self.map_odom = [at.x, at.y, yaw_of(each.transform.rotation)]

    def _heard_log(self, message: Any) -> None:
        level = int.from_bytes(message.level, "big") if isinstance(message.level, bytes) else message.level
        if level >= 30:
            self.log.append([level, message.name, message.msg])

    def watch(self) -> None:
        """Record the topics that nodes publish by now, as far as they are asked for."""
        from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy

        kinds = {name: each[0] for name, each in self.node.get_topic_names_and_types()}
        for topic in sorted({*self.setup["record"], self.setup["answer"]} - {*self.watched}):
            offers = self.node.get_publishers_info_by_topic(topic) if topic in kinds else ()
            if not offers or not is_there(kinds[topic]):
                continue
            reliable = all(each.qos_profile.reliability == ReliabilityPolicy.RELIABLE for each in offers)
            latched = all(each.qos_profile.durability == DurabilityPolicy.TRANSIENT_LOCAL for each in offers)
            profile = QoSProfile(
                depth=10,
                reliability=ReliabilityPolicy.RELIABLE if reliable else ReliabilityPolicy.BEST_EFFORT,
                durability=DurabilityPolicy.TRANSIENT_LOCAL if latched else DurabilityPolicy.VOLATILE,
            )
            self._subscribe(topic, kinds[topic], profile)

    def _stamp(self, header: Any, frame: str) -> None:
        header.stamp.sec, header.stamp.nanosec = divmod(self.now_ns, 10**9)
        header.frame_id = frame

    def _transform(self, parent: str, child: str, x: float, y: float, yaw: float) -> Any:
        message = imported("geometry_msgs/msg/TransformStamped")()
        self._stamp(message.header, parent)
        message.child_frame_id = child
        message.transform.translation.x, message.transform.translation.y = x, y
        message.transform.rotation.z, message.transform.rotation.w = math.sin(yaw / 2.0), math.cos(yaw / 2.0)
        return message

    def _publish_map(self, cells: bytes) -> None:
        about, message = self.setup["map"], imported("nav_msgs/msg/OccupancyGrid")()
        self._stamp(message.header, self.frames["map"])
        message.info.resolution, message.info.width, message.info.height = (
            about["resolution"],
            about["width"],
            about["height"],
        )
        place(message.info.origin, *about["origin"])
        message.data = array.array("b", cells)
        self.map.publish(message)

    def _pose_stamped(self, pose: list[float]) -> Any:
        message = imported("geometry_msgs/msg/PoseStamped")()
        self._stamp(message.header, self.frames["map"])
        place(message.pose, *pose)
        return message

    def localize(self, pose: list[float]) -> None:
        message = imported("geometry_msgs/msg/PoseWithCovarianceStamped")()
        self._stamp(message.header, self.frames["map"])
        place(message.pose.pose, *pose)
        for cell, variance in ((0, 0.25), (7, 0.25), (35, 0.0685)):  # as RViz does
            message.pose.covariance[cell] = variance
        self.initial.publish(message)

    def go(self, mission: dict[str, Any], wait_s: float) -> None:
        """Send a mission by its action, or its goal by the topic, when answers to earlier scans have come."""
        self._hear_late_answers(QUIET_S)
        self.doubtful = MOST_DOUBTFUL
        poses = [self._pose_stamped(pose) for pose in mission["goals"]]
        if self.setup["mission"] == "topic":
            self.missions.begin()
            self.goal.publish(poses[-1])
        else:
            self.missions.send(mission["kind"], poses, mission["loops"], wait_s)
        self._deliver(wait_s)

    def _deliver(self, wait_s: float) -> None:
        """Wait until nodes have received start, goal, and map, so that no later scan overtakes them."""
        from rclpy.duration import Duration

        for each in self.published:
            if each.qos_profile.depth == 1:  # Fast DDS asks for others' receipts every 3 s
                each.wait_for_all_acked(Duration(seconds=wait_s))

    def _until(self, is_met: Callable[[], bool], wait_s: float) -> bool:
        """Let callbacks run until a condition is met; return False after `wait_s` of host time."""
        until_s = time.monotonic() + wait_s
        while not is_met():
            if time.monotonic() >= until_s:
                return False
            self._run(0.1)
        return True

    def _run(self, within_s: float) -> bool:
        """Run the next callback that is due, and return whether there was one in time."""
        from rclpy.executors import TimeoutException

        try:
            handler, *_ = self.executor.wait_for_ready_callbacks(timeout_sec=within_s)
        except TimeoutException:
            return False
        handler()
        handler.result()  # raises what the callback raised
        return True

    def drain(self) -> None:
        """Run the callbacks that are due."""
        for _ in range(MOST_CALLBACKS):
            if not self._run(AT_ONCE_S):
                return

    def tick(self, message: dict[str, Any], ranges: bytes) -> bool:
        """Publish a state of the simulation, and return whether nodes answered its scan where that is awaited."""
        if ranges:
            self.drain()  # what came before is no answer to the scan
            if self.answers < self.scans:
                self.late.add(self.scan_ns)
            if message["await"] and self.doubtful in (0, MOST_DOUBTFUL):
                self.scans = self.answers
        self.now_ns = message["t_ns"]
        if message.get("cancel"):
            self.missions.cancel()
        if message.get("localize"):
            self.localize(message["localize"])
        x, y, yaw, v, vy, w = message["odom"]
        clock = imported("rosgraph_msgs/msg/Clock")()
        clock.clock.sec, clock.clock.nanosec = divmod(self.now_ns, 10**9)
        self.clock.publish(clock)
        if self.has_tf:
            transforms = [self._transform(self.frames["odom"], self.frames["base"], x, y, yaw)]
            if message.get("map_odom"):
                transforms.insert(0, self._transform(self.frames["map"], self.frames["odom"], *message["map_odom"]))
            self.tf.publish(imported("tf2_msgs/msg/TFMessage")(transforms=transforms))
        odometry = imported("nav_msgs/msg/Odometry")()
        self._stamp(odometry.header, self.frames["odom"])
        odometry.child_frame_id = self.frames["base"]
        place(odometry.pose.pose, x, y, yaw)
        odometry.twist.twist.linear.x, odometry.twist.twist.linear.y, odometry.twist.twist.angular.z = v, vy, w
        self.odometry.publish(odometry)
        if self.setup["joints"]:
            self.joints.publish(self.wheels.turn(self.now_ns, v, w))
        if message.get("mission"):
            self.go(message["mission"], message["wait_s"])
        if ranges:
            self._publish_scan(message, ranges)
        self.ticks += 1
        if self.ticks % 20 == 1:
            self.watch()
        answered = not message["await"] or self._await_answer(message, ranges)
        self.drain()
        return answered

    def _await_answer(self, message: dict[str, Any], ranges: bytes) -> bool:
        """Wait for the answer to a scan, and return whether it came.

        The first one of a mission is sent again each second, as nodes may have found the bridge and not yet each other. While fewer
        answers than scans have come, more are waited for after each of the next scans: a late one may have stood for its own.
        """
        began_s, before = time.monotonic(), self.answers
        look_s = REPEAT_S if self.doubtful == MOST_DOUBTFUL else message["wait_s"]
        while not self._until(lambda: self.answers > before or self.missions.told["state"] != "running", look_s):
            if time.monotonic() >= began_s + message["wait_s"]:
                return False
            self._publish_scan(message, ranges)
        if self.doubtful:
            self._hear_late_answers(max(QUIET_S, 2.0 * (time.monotonic() - began_s)))
            self.doubtful = self.doubtful - 1 if self.answers < self.scans else 0
        return True

    def _hear_late_answers(self, quiet_s: float) -> None:
        """Wait until as many answers came as scans were sent, or none for a while."""
        self.answered_s = time.monotonic()
        self._until(lambda: self.answers >= self.scans or time.monotonic() > self.answered_s + quiet_s, math.inf)

    def _publish_scan(self, message: dict[str, Any], ranges: bytes) -> None:
        self.scans += bool(self.setup["answer"])
        about, scan = self.setup["lidar"], imported("sensor_msgs/msg/LaserScan")()
        self.now_ns = self.scan_ns = message["scan_ns"]
        self._stamp(scan.header, self.frames["laser"])
        self.now_ns = message["t_ns"]
        scan.angle_min, scan.angle_max = about["angle_min"], about["angle_max"]
        scan.angle_increment = about["angle_increment"]
        scan.range_min, scan.range_max = about["range_min"], about["range_max"]
        scan.scan_time, scan.time_increment = about["scan_time"], about["time_increment"]
        scan.ranges = array.array("f", ranges)
        self.scan.publish(scan)

    def graph(self) -> dict[str, Any]:
        """Return what nodes offer by now: topics that others publish with their types, action servers, and nodes."""
        me = self.node.get_name()
        topics = {}
        for name, kinds in self.node.get_topic_names_and_types(no_demangle=False):
            others = [each for each in self.node.get_publishers_info_by_topic(name) if each.node_name != me]
            if others:
                topics[name] = kinds[0]
        services = {name for name, _ in self.node.get_service_names_and_types()}
        actions = sorted(
            name.removesuffix("/_action/send_goal") for name in services if name.endswith("/_action/send_goal")
        )
        return {
            "topics": topics,
            "actions": actions,
            "nodes": sorted(name for name in self.node.get_node_names() if name != me),
        }

    def settle(self, wait_s: float) -> None:
        """Wait until nodes have found each other: nothing of the graph changed for a while, and each subscription is matched.

        Until then messages to a subscription that does not ask for their repetition would be lost.
        """
        until_s, quiet_since_s, before = time.monotonic() + wait_s, time.monotonic(), None
        alone: list[str] = []
        while time.monotonic() < until_s:
            self.drain()
            self.watch()
            topics = [name for name, _ in self.node.get_topic_names_and_types()]
            now = {name: (self.node.count_publishers(name), self.node.count_subscribers(name)) for name in topics}
            alone = [
                each.topic_name
                for each in self.published
                if each.get_subscription_count() != self.node.count_subscribers(each.topic_name)
            ]
            if now != before or alone:
                before, quiet_since_s = now, time.monotonic()
            elif time.monotonic() - quiet_since_s >= QUIET_S:
                self._deliver(wait_s)
                return
            time.sleep(0.02)
        why = f": the QoS of {', '.join(alone)} is not what a subscription asks for" if alone else ""
        raise Problem(f"nodes did not find each other within {wait_s:g} s{why}")

    def told(self) -> tuple[dict[str, Any], bytes]:
        """Return what nodes did since the last call, and the recorded messages' bytes."""
        content = b"".join(each[3] for each in self.recorded)
        answer = {
            "command": self.command,
            "commands": self.commands,
            "estimate": self.estimate,
            "covariance": self.covariance,
            "updates": self.updates,
            "map_odom": self.map_odom,
            "mission": self.missions.told,
            "log": self.log[-1000:],
            "recorded": [[t_ns, topic, kind, len(each)] for t_ns, topic, kind, each in self.recorded],
            "dropped": self.dropped,
        }
        self.command, self.log, self.recorded, self.recorded_bytes = None, [], [], 0
        return answer, content


def main() -> int:
    connection = socket.socket(socket.AF_UNIX)
    connection.connect(sys.argv[1])
    try:
        setup, cells = receive(connection)
        bridge = Bridge(setup, cells)
        send(connection, {"python": sys.version.split()[0], "tf": bridge.has_tf})
        while True:
            message, content = receive(connection)
            if message["do"] == "settle":
                bridge.settle(message["wait_s"])
                send(connection, {})
                continue
            if message["do"] == "graph":
                bridge.drain()
                send(connection, bridge.graph())
                continue
            answered = bridge.tick(message, content)
            answer, recorded = bridge.told()
            send(connection, {**answer, "answered": answered}, recorded)
    except (EOFError, BrokenPipeError, ConnectionResetError):
        return 0
    except ImportError as error:
        send(connection, {"problem": f"rclpy can't be imported ({error}): give execution.ros2.python or a pre_command"})
    except Problem as problem:
        send(connection, {"problem": str(problem)})
    return 1


if __name__ == "__main__":
    sys.exit(main())
