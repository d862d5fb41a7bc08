"""Pure pursuit of the straight line to the goal, once for each scan."""

import math
from contextlib import suppress

import rclpy
from geometry_msgs.msg import PoseStamped, PoseWithCovarianceStamped, TwistStamped
from nav_msgs.msg import Odometry
from rclpy.executors import ExternalShutdownException
from rclpy.node import Node
from rclpy.qos import qos_profile_sensor_data
from sensor_msgs.msg import LaserScan

SPEED_MPS = 0.3
YAW_RATE_RADPS = 1.0
TOLERANCE_M = 0.15


def planar(pose):
    q = pose.orientation
    return pose.position.x, pose.position.y, math.atan2(2 * (q.w * q.z + q.x * q.y), 1 - 2 * (q.y**2 + q.z**2))


def seconds(stamp):
    return stamp.sec + stamp.nanosec * 1e-9


class Follower(Node):
    def __init__(self):
        super().__init__("follower")
        self.start = self.goal = self.odometry = self.scan_stamp = None
        self.create_subscription(PoseWithCovarianceStamped, "initialpose", self.set_start, 10)
        self.create_subscription(PoseStamped, "goal_pose", self.set_goal, 10)
        self.create_subscription(Odometry, "odom", self.set_odometry, 10)
        self.create_subscription(LaserScan, "scan", self.set_scan, qos_profile_sensor_data)
        self.command = self.create_publisher(TwistStamped, "cmd_vel_raw", 10)

    def set_start(self, message):
        self.start = planar(message.pose.pose)

    def set_goal(self, message):
        self.goal = planar(message.pose)

    def set_odometry(self, message):
        self.odometry = seconds(message.header.stamp), planar(message.pose.pose)
        self.follow()

    def set_scan(self, message):
        self.scan_stamp = message.header.stamp
        self.follow()

    def follow(self):
        """Answer a scan by the odometry after it, whichever of the two comes first."""
        if self.scan_stamp is None or self.odometry is None or self.odometry[0] <= seconds(self.scan_stamp):
            return
        answer = TwistStamped()
        answer.header.stamp, self.scan_stamp = self.scan_stamp, None
        if self.start is not None and self.goal is not None:
            x0, y0, yaw0 = self.start
            x, y, yaw = self.odometry[1]
            here_x = x0 + math.cos(yaw0) * x - math.sin(yaw0) * y
            here_y = y0 + math.sin(yaw0) * x + math.cos(yaw0) * y
            dx, dy = self.goal[0] - here_x, self.goal[1] - here_y
            off = math.remainder(math.atan2(dy, dx) - yaw0 - yaw, 2 * math.pi)
            if math.hypot(dx, dy) > TOLERANCE_M:
                answer.twist.angular.z = max(-YAW_RATE_RADPS, min(YAW_RATE_RADPS, 2 * off))
                answer.twist.linear.x = SPEED_MPS if abs(off) < 0.4 else 0.0
        self.command.publish(answer)


def main():
    rclpy.init()
    with suppress(KeyboardInterrupt, ExternalShutdownException):  # the end of the run
        rclpy.spin(Follower())


if __name__ == "__main__":
    main()
