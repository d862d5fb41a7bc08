"""The bridge: a node of ROS 2 between the simulated robot and the nodes under test.

Executed as a file by the Python of a ROS 2 installation, `bridge.py SOCKET`, on this machine or in a container: it imports the standard library,
rclpy, and the file beside it. It connects to a UNIX socket, on which each message is its length (4 bytes, big-endian), a JSON object, and as many raw bytes as
the object's `bytes` says. It gets the setup, then a message for each tick of the simulation, and answers each: it publishes, lets nodes
answer, and tells what they published.
"""

import array
import math
import socket
import sys
import time
from collections.abc import Callable
from typing import Any

from bridge_messages import Problem, imported, is_there, place, receive, send, yaw_of

MOST_CALLBACKS = 2000
"""Callbacks in a tick of the simulation, so that a topic that is flooded holds nobody up."""
MOST_RECORDED_BYTES = 16 << 20
"""Bytes that are recorded in a tick."""
QUIET_S = 0.5
"""Time without a change of the graph after which nodes have found each other."""


class Bridge:
    """Publishers, subscriptions, and action clients of the node, as the setup asks for them."""

    def __init__(self, setup: dict[str, Any], map_cells: bytes) -> None:
        import rclpy
        from rclpy.executors import SingleThreadedExecutor
        from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy

        self.setup = setup
        self.topics, self.frames = setup["topics"], setup["frames"]
        rclpy.init(args=None)
        self.node = rclpy.create_node("vastflow_bridge")
        self.executor = SingleThreadedExecutor()
        self.executor.add_node(self.node)
        self.callbacks = 0
        self.now_ns = 0
        self.command: list[float] | None = None
        self.commands = self.answers = 0
        self.estimate: list[float] | None = None
        self.covariance: list[float] | None = None
        self.updates = 0
        self.map_odom: list[float] | None = None
        self.log: list[list[Any]] = []
        self.recorded: list[tuple[int, str, str, bytes]] = []
        self.recorded_bytes = self.dropped = 0
        self.mission: dict[str, Any] = {"state": "", "code": 0, "message": "", "recoveries": 0, "missed": 0}
        self.goal_handle: Any = None
        self.clients: dict[str, Any] = {}

        def qos(depth: int, *, best_effort: bool = False, latched: bool = False) -> Any:
            return QoSProfile(
                depth=depth,
                reliability=ReliabilityPolicy.BEST_EFFORT if best_effort else ReliabilityPolicy.RELIABLE,
                durability=DurabilityPolicy.TRANSIENT_LOCAL if latched else DurabilityPolicy.VOLATILE,
            )

        def publisher(role: str, kind: str, profile: Any) -> Any:
            return self.node.create_publisher(imported(kind), self.topics[role], profile)

        self.latched = qos(1, latched=True)
        self.clock = publisher("clock", "rosgraph_msgs/msg/Clock", qos(1, best_effort=True))
        self.odometry = publisher("odom", "nav_msgs/msg/Odometry", qos(10))
        self.scan = publisher("scan", "sensor_msgs/msg/LaserScan", qos(5, best_effort=True))
        self.initial = publisher("initialpose", "geometry_msgs/msg/PoseWithCovarianceStamped", qos(10))
        self.goal = publisher("goal", "geometry_msgs/msg/PoseStamped", qos(10))
        self.has_tf = is_there("tf2_msgs/msg/TFMessage")
        if self.has_tf:
            self.tf = publisher("tf", "tf2_msgs/msg/TFMessage", qos(100))
            self.tf_static = publisher("tf_static", "tf2_msgs/msg/TFMessage", self.latched)
            self._hear("tf", "tf2_msgs/msg/TFMessage", self._heard_tf, qos(100))
            self._publish_mount()
        if setup["map"]:
            self.map = publisher("map", "nav_msgs/msg/OccupancyGrid", self.latched)
            self._publish_map(map_cells)
        kind = "geometry_msgs/msg/TwistStamped" if setup["stamped"] else "geometry_msgs/msg/Twist"
        self._hear("cmd_vel", kind, self._heard_command, qos(10))
        self._hear("amcl_pose", "geometry_msgs/msg/PoseWithCovarianceStamped", self._heard_estimate, self.latched)
        self._hear("rosout", "rcl_interfaces/msg/Log", self._heard_log, qos(1000))
        self._watched: dict[str, Any] = {}
        self.ticks = self.scans = 0
        self.is_in_step = False

    def _hear(self, role: str, kind: str, callback: Callable[[Any], None], profile: Any) -> None:
        def heard(message: Any) -> None:
            self.callbacks += 1
            callback(message)

        self.node.create_subscription(imported(kind), self.topics[role], heard, profile)

    def _heard_command(self, message: Any) -> None:
        twist = getattr(message, "twist", message)
        self.command = [twist.linear.x, twist.linear.y, twist.angular.z]
        self.commands += 1
        self._answered(self.topics["cmd_vel"])

    def _answered(self, topic: str) -> None:
        if topic == self.setup["answer"]:
            self.answers += 1

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
        if level >= 30 and message.name != self.node.get_name():
            self.log.append([level, message.name, message.msg])

    def watch(self) -> None:
        """Record the topics that nodes publish by now, as far as they are asked for."""
        from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy

        kinds = {name: each[0] for name, each in self.node.get_topic_names_and_types()}
        for topic in self.setup["record"]:
            is_new = topic in kinds and topic not in self._watched
            offers = self.node.get_publishers_info_by_topic(topic) if is_new else ()
            if not offers or not is_there(kinds[topic]):
                continue
            reliable = all(each.qos_profile.reliability == ReliabilityPolicy.RELIABLE for each in offers)
            latched = all(each.qos_profile.durability == DurabilityPolicy.TRANSIENT_LOCAL for each in offers)
            profile = QoSProfile(
                depth=10,
                reliability=ReliabilityPolicy.RELIABLE if reliable else ReliabilityPolicy.BEST_EFFORT,
                durability=DurabilityPolicy.TRANSIENT_LOCAL if latched else DurabilityPolicy.VOLATILE,
            )

            def heard(content: bytes, topic: str = topic, kind: str = kinds[topic]) -> None:
                self.callbacks += 1
                if topic != self.topics["cmd_vel"]:  # which is heard as a command already
                    self._answered(topic)
                if self.recorded_bytes + len(content) > MOST_RECORDED_BYTES:
                    self.dropped += 1
                    return
                self.recorded_bytes += len(content)
                self.recorded.append((self.now_ns, topic, kind, content))

            self._watched[topic] = self.node.create_subscription(
                imported(kinds[topic]), topic, heard, profile, raw=True
            )

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

    def _publish_mount(self) -> None:
        mount = self._transform(self.frames["base"], self.frames["laser"], *self.setup["mount"])
        self.tf_static.publish(imported("tf2_msgs/msg/TFMessage")(transforms=[mount]))

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
        """Send a mission by its action, or its goals by the topic, as the setup says."""
        self.is_in_step = False
        self.mission = {"state": "running", "code": 0, "message": "", "recoveries": 0, "missed": 0}
        poses = [self._pose_stamped(pose) for pose in mission["goals"]]
        if self.setup["mission"] == "topic":
            self.goal.publish(poses[-1])
            return
        name = "".join(map(str.title, mission["kind"].split("_")))
        kind = imported(f"nav2_msgs/action/{name}")
        client = self._client(mission["kind"], kind)
        if not self._until(client.server_is_ready, wait_s):
            raise Problem(f"no action server {self.setup['actions'][mission['kind']]} within {wait_s:g} s")
        goal = kind.Goal()
        if name == "NavigateToPose":
            goal.pose = poses[0]
        elif hasattr(goal.poses, "goals"):  # nav_msgs/Goals since Kilted
            goal.poses.goals = poses
        else:
            goal.poses = poses
        if name == "FollowWaypoints":
            goal.number_of_loops = mission["loops"]
        future = client.send_goal_async(goal, feedback_callback=self._heard_feedback)
        if not self._until(future.done, wait_s):
            raise Problem(f"{self.setup['actions'][mission['kind']]} did not answer the goal within {wait_s:g} s")
        self.goal_handle = future.result()
        if not self.goal_handle.accepted:
            self.mission |= {"state": "rejected", "message": "the action server rejected the goal"}
            return
        sent = self.goal_handle
        self.goal_handle.get_result_async().add_done_callback(lambda done: self._ended(sent, done.result()))

    def _client(self, kind: str, action: Any) -> Any:
        from rclpy.action import ActionClient

        if kind not in self.clients:
            self.clients[kind] = ActionClient(self.node, action, self.setup["actions"][kind])
        return self.clients[kind]

    def _heard_feedback(self, message: Any) -> None:
        self.callbacks += 1
        told = getattr(message.feedback, "number_of_recoveries", 0)
        self.mission["recoveries"] = max(self.mission["recoveries"], told)

    def _ended(self, sent: Any, answer: Any) -> None:
        self.callbacks += 1
        if sent is not self.goal_handle:
            return
        result = answer.result
        self.mission |= {
            "state": {4: "succeeded", 5: "canceled", 6: "aborted"}.get(answer.status, "aborted"),
            "code": int(getattr(result, "error_code", 0)),
            "message": str(getattr(result, "error_msg", "")),
            "missed": len(getattr(result, "missed_waypoints", ())),
        }

    def cancel(self) -> None:
        if self.goal_handle is not None and self.mission["state"] == "running":
            self.goal_handle.cancel_goal_async()
        self.goal_handle, self.mission["state"] = None, ""

    def _until(self, is_met: Callable[[], bool], wait_s: float) -> bool:
        """Let callbacks run until a condition is met; return False after `wait_s` of host time."""
        until_s = time.monotonic() + wait_s
        while not is_met():
            left_s = until_s - time.monotonic()
            if left_s <= 0.0:
                return False
            self.executor.spin_once(timeout_sec=min(left_s, 0.1))
        return True

    def drain(self) -> None:
        """Run the callbacks that are due."""
        for _ in range(MOST_CALLBACKS):
            before = self.callbacks
            self.executor.spin_once(timeout_sec=0)
            if self.callbacks == before:
                return

    def tick(self, message: dict[str, Any], ranges: bytes) -> bool:
        self.now_ns = message["t_ns"]
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
        if message.get("mission"):
            self.go(message["mission"], message["wait_s"])
        if message.get("cancel"):
            self.cancel()
        if ranges:
            self._publish_scan(message, ranges)
        self.ticks += 1
        if self.ticks % 20 == 1 and len(self._watched) < len(self.setup["record"]):
            self.watch()
        self.drain()
        answered = True
        if ranges and message["await"]:
            answered = self._await_answer(message, ranges)
            self.drain()
        return answered

    def _await_answer(self, message: dict[str, Any], ranges: bytes) -> bool:
        """Wait for the answer to a scan, and return whether it came.

        The first one of a mission is sent again each second, as nodes may have found the bridge and not yet each other. Answers to
        repetitions, and to scans that nobody awaited, are waited for too: a late one would stand for the next one's.
        """

        def is_over() -> bool:
            return self.answers >= self.scans or self.mission["state"] != "running"

        if self.is_in_step:
            return self._until(is_over, message["wait_s"])
        until_s, before = time.monotonic() + message["wait_s"], self.answers
        while not self._until(
            lambda: self.answers > before or is_over(), min(1.0, max(0.0, until_s - time.monotonic()))
        ):
            if time.monotonic() >= until_s:
                return False
            self._publish_scan(message, ranges)
        self._until(is_over, QUIET_S)
        self.is_in_step, self.scans = True, self.answers
        return True

    def _publish_scan(self, message: dict[str, Any], ranges: bytes) -> None:
        self.scans += 1
        about, scan = self.setup["lidar"], imported("sensor_msgs/msg/LaserScan")()
        self.now_ns = message["scan_ns"]
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
        own = (self.clock, self.odometry, self.scan, self.initial, self.goal)
        while time.monotonic() < until_s:
            self.drain()
            topics = [name for name, _ in self.node.get_topic_names_and_types()]
            now = {name: (self.node.count_publishers(name), self.node.count_subscribers(name)) for name in topics}
            matched = all(each.get_subscription_count() == self.node.count_subscribers(each.topic_name) for each in own)
            if now != before or not matched:
                before, quiet_since_s = now, time.monotonic()
            elif time.monotonic() - quiet_since_s >= QUIET_S:
                return
            time.sleep(0.02)
        raise Problem(f"nodes did not find each other within {wait_s:g} s")

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
            "mission": self.mission,
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
