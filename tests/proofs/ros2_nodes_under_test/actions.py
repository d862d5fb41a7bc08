"""Serves Nav2's three actions: it turns to each goal and drives there, or aborts where the goal is behind `ABORT_BEYOND_M`."""

import math
import threading
import time

import rclpy
from geometry_msgs.msg import PoseWithCovarianceStamped, Twist
from nav2_msgs.action import FollowWaypoints, NavigateThroughPoses, NavigateToPose
from nav_msgs.msg import Odometry
from rclpy.action import ActionServer, CancelResponse
from rclpy.callback_groups import ReentrantCallbackGroup
from rclpy.executors import MultiThreadedExecutor
from rclpy.node import Node
from rclpy.qos import qos_profile_sensor_data
from sensor_msgs.msg import LaserScan

ABORT_BEYOND_M = 6.0


def planar(pose):
    q = pose.orientation
    return pose.position.x, pose.position.y, 2 * math.atan2(q.z, q.w)


class Navigator(Node):
    def __init__(self):
        super().__init__("navigator")
        group = ReentrantCallbackGroup()
        self.start, self.odometry, self.goals = (0.0, 0.0, 0.0), (0.0, 0.0, 0.0), []
        self.create_subscription(PoseWithCovarianceStamped, "initialpose", self.set_start, 10, callback_group=group)
        self.create_subscription(Odometry, "odom", self.set_odometry, 10, callback_group=group)
        self.create_subscription(LaserScan, "scan", self.answer, qos_profile_sensor_data, callback_group=group)
        self.command = self.create_publisher(Twist, "cmd_vel", 10)
        for kind, name in (
            (NavigateToPose, "navigate_to_pose"),
            (NavigateThroughPoses, "navigate_through_poses"),
            (FollowWaypoints, "follow_waypoints"),
        ):
            cancel = lambda _: CancelResponse.ACCEPT
            ActionServer(self, kind, name, self.execute, callback_group=group, cancel_callback=cancel)

    def set_start(self, message):
        self.start = planar(message.pose.pose)

    def set_odometry(self, message):
        self.odometry = planar(message.pose.pose)

    def here(self):
        (x0, y0, yaw0), (x, y, yaw) = self.start, self.odometry
        c, s = math.cos(yaw0), math.sin(yaw0)
        return x0 + c * x - s * y, y0 + s * x + c * y, yaw0 + yaw

    def answer(self, _):
        command = Twist()
        if self.goals:
            x, y, yaw = self.here()
            gx, gy, _ = self.goals[0]
            off = math.remainder(math.atan2(gy - y, gx - x) - yaw, 2 * math.pi)
            if math.hypot(gx - x, gy - y) < 0.2:
                self.goals.pop(0)
            else:
                command.angular.z = max(-1.0, min(1.0, 2 * off))
                command.linear.x = 0.3 if abs(off) < 0.4 else 0.0
        self.command.publish(command)

    def execute(self, handle):
        request, kind = handle.request, type(handle.request).__name__
        poses = [request.pose] if hasattr(request, "pose") else request.poses
        goals = [planar(each.pose) for each in poses] * (getattr(request, "number_of_loops", 0) + 1)
        result = next(
            each for each in (NavigateToPose, NavigateThroughPoses, FollowWaypoints) if each.__name__ in kind
        ).Result()
        x, y, _ = self.here()
        if math.hypot(goals[0][0] - x, goals[0][1] - y) > ABORT_BEYOND_M:
            result.error_code, result.error_msg = 105, "too far for me"
            handle.abort()
            return result
        self.goals = goals
        while self.goals and not handle.is_cancel_requested:
            time.sleep(0.005)
        self.goals = []
        handle.canceled() if handle.is_cancel_requested else handle.succeed()
        return result


def main():
    rclpy.init()
    executor = MultiThreadedExecutor(4)
    executor.add_node(Navigator())
    threading.Thread(target=executor.spin, daemon=True).start()
    threading.Event().wait()


if __name__ == "__main__":
    main()
