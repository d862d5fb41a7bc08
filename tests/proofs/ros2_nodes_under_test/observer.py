"""Writes what it hears of the bridge, and what the graph says of it, to `observed.jsonl`."""

import base64
import json

import rclpy
from geometry_msgs.msg import PoseStamped
from nav_msgs.msg import OccupancyGrid, Odometry
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, QoSProfile, qos_profile_sensor_data
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import LaserScan
from tf2_msgs.msg import TFMessage

LATCHED = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)


def nanoseconds(stamp):
    return stamp.sec * 10**9 + stamp.nanosec


class Observer(Node):
    def __init__(self):
        super().__init__("observer")
        self.file = open("observed.jsonl", "w", encoding="utf-8")  # noqa: SIM115
        self.create_subscription(
            Clock, "/clock", lambda m: self.write("/clock", nanoseconds(m.clock)), qos_profile_sensor_data
        )
        self.create_subscription(Odometry, "/odom", self.odometry, 10)
        self.create_subscription(LaserScan, "/scan", self.scan, qos_profile_sensor_data)
        self.create_subscription(TFMessage, "/tf", lambda m: self.transforms("/tf", m), 100)
        self.create_subscription(TFMessage, "/tf_static", lambda m: self.transforms("/tf_static", m), LATCHED)
        self.create_subscription(OccupancyGrid, "/map", self.map, LATCHED)
        self.create_subscription(PoseStamped, "/goal_pose", self.goal, 10)

    def write(self, topic, stamp_ns, **about):
        print(json.dumps({"topic": topic, "stamp_ns": stamp_ns, **about}), file=self.file, flush=True)

    def odometry(self, message):
        at, q = message.pose.pose.position, message.pose.pose.orientation
        frames = [message.header.frame_id, message.child_frame_id]
        self.write("/odom", nanoseconds(message.header.stamp), frames=frames, at=[at.x, at.y, q.z, q.w])

    def scan(self, message):
        ranges = base64.b64encode(message.ranges.tobytes()).decode()
        about = {
            name: getattr(message, name)
            for name in ("angle_min", "angle_max", "angle_increment", "range_min", "range_max")
        }
        self.write("/scan", nanoseconds(message.header.stamp), frames=[message.header.frame_id], ranges=ranges, **about)

    def transforms(self, topic, message):
        for each in message.transforms:
            at, q = each.transform.translation, each.transform.rotation
            frames = [each.header.frame_id, each.child_frame_id]
            self.write(topic, nanoseconds(each.header.stamp), frames=frames, at=[at.x, at.y, q.z, q.w])

    def map(self, message):
        cells = base64.b64encode(message.data.tobytes()).decode()
        about = message.info
        shape = [about.height, about.width, about.resolution, about.origin.position.x, about.origin.position.y]
        self.write(
            "/map", nanoseconds(message.header.stamp), frames=[message.header.frame_id], shape=shape, cells=cells
        )

    def goal(self, message):
        """The mission begins: nodes know each other by now."""
        self.write("/goal_pose", nanoseconds(message.header.stamp), frames=[message.header.frame_id])
        for topic, kinds in self.get_topic_names_and_types():
            for offer in self.get_publishers_info_by_topic(topic):
                if offer.node_name == "vastflow_bridge":
                    qos = offer.qos_profile
                    said = [qos.reliability.name, qos.durability.name]
                    self.write(topic, -1, type=offer.topic_type, qos=said, kinds=kinds)


def main():
    rclpy.init()
    rclpy.spin(Observer())


if __name__ == "__main__":
    main()
