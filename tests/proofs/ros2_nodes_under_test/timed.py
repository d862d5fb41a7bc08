"""Drive to the goal by a control timer of 20 Hz: `timed.py CLOCK COMPUTES_S`.

Warnings tell where it missed its rate. CLOCK is `sim` for a timer of simulated time, else the timer is of the host's. COMPUTES_S is the CPU time of a control loop.
"""

import sys
import time
from contextlib import suppress

import rclpy
from geometry_msgs.msg import PoseStamped, Twist, Vector3
from nav_msgs.msg import Odometry
from rclpy.executors import ExternalShutdownException
from rclpy.node import Node
from rclpy.parameter import Parameter

PERIOD_S = 0.05


class Timed(Node):
    def __init__(self, is_simulated, computes_s):
        super().__init__("timed", parameter_overrides=[Parameter("use_sim_time", value=is_simulated)])
        self.computes_s, self.goal, self.odometry, self.last_s = computes_s, None, None, None
        self.create_subscription(PoseStamped, "goal_pose", self.set_goal, 10)
        self.create_subscription(Odometry, "odom", self.set_odometry, 10)
        self.command = self.create_publisher(Twist, "cmd_vel", 10)
        self.create_timer(PERIOD_S, self.control)

    def set_goal(self, message):
        self.goal = message.pose.position

    def set_odometry(self, message):
        self.odometry = message.pose.pose.position

    def control(self):
        """Go straight on to the goal, along x from x = 1 m."""
        now_s = self.get_clock().now().nanoseconds * 1e-9
        if self.last_s is not None and now_s - self.last_s > 1.5 * PERIOD_S:
            self.get_logger().warning("Control loop missed its desired rate of 20 Hz")
        self.last_s = now_s
        until_s = time.thread_time() + self.computes_s
        while time.thread_time() < until_s:
            pass
        if self.goal is not None and self.odometry is not None:
            left_m = self.goal.x - 1.0 - self.odometry.x
            self.command.publish(Twist(linear=Vector3(x=0.3 if left_m > 0.1 else 0.0)))


def main():
    rclpy.init()
    with suppress(KeyboardInterrupt, ExternalShutdownException):  # the end of the run
        rclpy.spin(Timed(sys.argv[1] == "sim", float(sys.argv[2])))


if __name__ == "__main__":
    main()
