"""Wheels of the bridge's robot, a differential drive, as joints; the file lies beside the executed bridge."""

from typing import Any

from bridge_messages import imported


class Wheels:
    """The wheels that a setup's `joints` describes, at angle 0 when time begins."""

    def __init__(self, joints: dict[str, Any]) -> None:
        self._joints, self._angles_rad, self._at_ns = joints, [0.0, 0.0], 0

    def turn(self, now_ns: int, speed_mps: float, yaw_rate_radps: float) -> Any:
        """Return the message of their angles and rates after they turned until now."""
        sides_m = (-self._joints["track"] / 2.0, self._joints["track"] / 2.0)
        rates_radps = [(speed_mps + yaw_rate_radps * side_m) / self._joints["wheel_radius"] for side_m in sides_m]
        passed_s, self._at_ns = (now_ns - self._at_ns) / 1e9, now_ns
        turned = zip(self._angles_rad, rates_radps, strict=True)
        self._angles_rad = [angle_rad + rate_radps * passed_s for angle_rad, rate_radps in turned]
        message = imported("sensor_msgs/msg/JointState")()
        message.header.stamp.sec, message.header.stamp.nanosec = divmod(now_ns, 10**9)
        message.name = [self._joints["left"], self._joints["right"]]
        message.position, message.velocity = self._angles_rad, rates_radps
        return message
