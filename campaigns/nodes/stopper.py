"""Stops the robot before what the scan shows in its way, and passes other commands on."""

import math
from contextlib import suppress

import rclpy
from geometry_msgs.msg import Twist, TwistStamped
from rclpy.executors import ExternalShutdownException
from rclpy.node import Node
from rclpy.qos import qos_profile_sensor_data
from sensor_msgs.msg import LaserScan

STOP_M = 0.5
HALF_WIDTH_M = 0.25


class Stopper(Node):
    def __init__(self):
        super().__init__("stopper")
        self.scan = self.wanted = None
        self.create_subscription(LaserScan, "scan", self.set_scan, qos_profile_sensor_data)
        self.create_subscription(TwistStamped, "cmd_vel_raw", self.set_wanted, 10)
        self.command = self.create_publisher(Twist, "cmd_vel", 10)

    def set_scan(self, message):
        self.scan = message
        self.answer()

    def set_wanted(self, message):
        self.wanted = message
        self.answer()

    def answer(self):
        """Answer a scan once the command for it is there."""
        if self.scan is None or self.wanted is None or self.scan.header.stamp != self.wanted.header.stamp:
            return
        command, self.wanted = self.wanted.twist, None
        if command.linear.x > 0.0 and self.is_blocked():
            command = Twist(angular=command.angular)
        self.command.publish(command)

    def is_blocked(self):
        scan = self.scan
        angles = (scan.angle_min + k * scan.angle_increment for k in range(len(scan.ranges)))
        ahead = (
            (d * math.cos(a), d * math.sin(a)) for d, a in zip(scan.ranges, angles, strict=True) if math.isfinite(d)
        )
        return any(0.0 < x < STOP_M and abs(y) < HALF_WIDTH_M for x, y in ahead)


def main():
    rclpy.init()
    with suppress(KeyboardInterrupt, ExternalShutdownException):  # the end of the run
        rclpy.spin(Stopper())


if __name__ == "__main__":
    main()
