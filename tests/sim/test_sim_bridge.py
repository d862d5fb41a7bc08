"""The bridge in lock step, with a stand-in for rclpy: which message answers which scan, however late nodes are."""

import importlib
from pathlib import Path

import false_rclpy
import pytest
from false_rclpy import Message

from vastflow.sim.model.nodes import ACTIONS, FRAMES, TOPICS
from vastflow.sim.nodes import starting

KINDS = [
    *(f"geometry_msgs/msg/{name}" for name in ("Twist", "TwistStamped", "PoseStamped", "PoseWithCovarianceStamped")),
    *("rosgraph_msgs/msg/Clock", "nav_msgs/msg/Odometry", "sensor_msgs/msg/LaserScan", "sensor_msgs/msg/JointState"),
    "rcl_interfaces/msg/Log",
]
LIDAR = dict.fromkeys(
    ("angle_min", "angle_max", "angle_increment", "range_min", "range_max", "scan_time", "time_increment"), 0.0
)


@pytest.fixture
def network(monkeypatch):
    return false_rclpy.installed(monkeypatch, KINDS)


@pytest.fixture
def bridge(monkeypatch, network):
    """Returns a bridge in lock step, with the setup that the test says."""
    monkeypatch.syspath_prepend(str(Path(starting.__file__).parent))
    module = importlib.import_module("bridge")
    monkeypatch.setattr(module, "time", network)

    def made(**setup):
        names = {"topics": dict(TOPICS), "frames": dict(FRAMES), "actions": dict(ACTIONS)}
        given = {
            "stamped": False,
            "answer": "/cmd_vel",
            "mission": "topic",
            "record": [],
            "joints": None,
            "lidar": LIDAR,
            "map": None,
        }
        return Drives(module.Bridge({**names, **given, **setup}, b""), network)

    return made


class Drives:
    """Ticks a bridge as the simulator does: a scan in every second tick."""

    def __init__(self, bridge, network):
        self.bridge, self.network, self.tick_number = bridge, network, 0

    def send(self):
        mission = {"kind": "navigate_to_pose", "goals": [[3.0, 1.0, 0.0]], "loops": 0}
        self._tick(b"", mission=mission)

    def tick(self, awaited=True):
        """Returns what was commanded in the tick; fails where a scan was not answered."""
        self.tick_number += 1
        return self._tick(b"\0\0\0\0" if self.tick_number % 2 else b"", awaited=awaited)

    def _tick(self, ranges, awaited=True, **more):
        t_ns = self.tick_number * 50_000_000
        message = {"t_ns": t_ns, "scan_ns": t_ns - 50_000_000, "odom": [0.0] * 6, "wait_s": 10.0, **more}
        assert self.bridge.tick({**message, "await": awaited and bool(ranges)}, ranges)
        command = self.bridge.told()[0]["command"]
        return None if command is None else command[0]


def commanded(network, delays_s, stamped=False):
    """Has a node command the number of each scan that it gets, after a delay (None: never)."""
    numbers, seen = iter(delays_s), []

    def answer(scan):
        seen.append(scan)
        if (delay_s := next(numbers, 0.01)) is not None:
            stamp_ns = scan.header.stamp.sec * 10**9 + scan.header.stamp.nanosec
            twist = Message(linear=Message(x=len(seen), y=0.0), angular=Message(z=0.0))
            network.publish("/cmd_vel", Message(twist=twist) if stamped else twist, delay_s, stamp_ns if stamped else 0)

    network.heard_by["/scan"] = answer


def test_command_of_a_tick_is_the_answer_to_its_scan(bridge, network):
    commanded(network, [0.3, 0.001, 2.0])
    robot = bridge()
    robot.send()
    assert [robot.tick() for _ in range(6)] == [1, None, 2, None, 3, None]


def test_scan_without_an_answer_is_told_after_its_time(bridge, network):
    commanded(network, [0.01, None])
    robot = bridge()
    robot.send()
    assert robot.tick() == 1 and robot.tick() is None
    began_s = network.now_s
    with pytest.raises(AssertionError, match="assert False"):
        robot.tick()
    assert network.now_s - began_s == pytest.approx(10.0, abs=0.11)


def test_first_scan_of_a_mission_is_repeated_until_nodes_have_found_each_other(bridge, network):
    commanded(network, [None, None, 0.01])
    robot = bridge()
    robot.send()
    assert [robot.tick() for _ in range(4)] == [3, None, 4, None]


def test_answers_to_repetitions_are_none_to_the_next_scan(bridge, network):
    commanded(network, [2.5, 2.8, 2.6])  # of a node that is slow at first: at 2.5, 3.8, and 4.6 s
    robot = bridge()
    robot.send()
    assert [robot.tick() for _ in range(4)] == [3, None, 4, None]


def test_answer_to_a_repetition_that_comes_very_late_moves_no_later_one(bridge, network):
    commanded(network, [1.2, 4.0, 1.7, 0.2, 0.2])  # at 1.2 s and, when the next scan is awaited, at 5.0 s
    robot = bridge()
    robot.send()
    assert [robot.tick() for _ in range(6)] == [1, None, 3, None, 4, None]


def test_surplus_answer_lets_no_later_scan_go_unanswered(bridge, network):
    commanded(network, [0.01, 0.01, 0.2, 0.2, 0.2])
    robot = bridge()
    robot.send()
    assert [robot.tick() for _ in range(2)] == [1, None]
    network.publish("/cmd_vel", Message(linear=Message(x=-1.0, y=0.0), angular=Message(z=0.0)), 0.0)
    assert [robot.tick() for _ in range(6)] == [2, None, 3, None, 4, None]


def test_late_answers_of_the_rest_before_a_mission_are_none_to_its_scans(bridge, network):
    commanded(network, [0.01, 0.3, 0.4, 0.5, 0.6])
    robot = bridge()
    robot.send()
    robot.tick()
    for _ in range(7):  # which nobody awaits
        robot.tick(awaited=False)
    robot.send()
    robot.tick_number += robot.tick_number % 2
    assert [robot.tick() for _ in range(4)] == [5, None, 6, None]


def test_stamp_of_an_earlier_scan_that_nobody_answered_answers_no_later_one(bridge, network):
    commanded(network, [0.01, 0.01, 3.0, 3.0, 2.6, 1.7, 0.8], stamped=True)
    robot = bridge(stamped=True)
    robot.send()
    assert [robot.tick() for _ in range(4)] == [1, None, 2, None]
    for _ in range(4):
        robot.tick(awaited=False)
    robot.send()
    assert [robot.tick() for _ in range(4)] == [7, None, 8, None]


def test_wheels_turn_as_the_robot_moves(bridge, network):
    joints = {"left": "left_wheel", "right": "right_wheel", "wheel_radius": 0.05, "track": 0.4}
    robot = bridge(answer="", joints=joints)
    for odometry in ([0.0, 0.0, 0.0, 0.3, 0.0, 0.0], [0.015, 0.0, 0.0, 0.3, 0.0, 0.5]):
        robot.tick_number += 1
        robot._tick(b"", odom=odometry)
    first, second = (message for _, topic, message in network.sent if topic == "/joint_states")
    assert first.velocity == pytest.approx([6.0, 6.0]) and first.position == pytest.approx([0.3, 0.3])
    assert second.velocity == pytest.approx([4.0, 8.0]) and second.position == pytest.approx([0.5, 0.7])
    assert (second.name, second.header.stamp.nanosec) == (["left_wheel", "right_wheel"], 100_000_000)


def test_goal_has_arrived_before_a_scan_follows_it(bridge, network):
    robot = bridge()
    commanded(network, [])
    robot.send()
    assert {"/goal_pose", "/initialpose"} <= {*network.waited}
    assert "/scan" not in [topic for _, topic, _ in network.sent]


def test_tick_takes_every_message_that_is_there(bridge, network):
    robot = bridge(answer="")
    for number in range(50):
        network.publish("/cmd_vel", Message(linear=Message(x=number, y=0.0), angular=Message(z=0.0)), 0.0)
    assert robot.tick(awaited=False) == 49


def test_nodes_that_answer_only_in_missions_are_waited_for_once(bridge, network):
    commanded(network, [0.01, None, None, 0.01])
    robot = bridge()
    robot.send()
    robot.tick()
    for _ in range(4):
        robot.tick(awaited=False)
    began_s = network.now_s
    robot.send()
    assert [robot.tick() for _ in range(2)] == [None, 4]
    assert network.now_s - began_s < 0.7
