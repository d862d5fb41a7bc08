"""Missions of the bridge as goals of Nav2's actions; the file lies beside the executed bridge."""

from collections.abc import Callable
from typing import Any

from bridge_messages import Problem, imported


class Missions:
    """The mission that nodes have, one at a time.

    Args:
        actions: Kind of mission to its action's name.
        until: Lets callbacks run until a condition is met; False after so many seconds.

    Attributes:
        told: What nodes told of it.
    """

    def __init__(self, node: Any, actions: dict[str, str], until: Callable[[Callable[[], bool], float], bool]) -> None:
        self._node, self._actions, self._until = node, actions, until
        self._clients: dict[str, Any] = {}
        self._sent: Any = None
        self.begin("")

    def begin(self, state: str = "running") -> None:
        """Begin another mission; later words on the one before don't count."""
        self.told: dict[str, Any] = {"state": state, "code": 0, "message": "", "recoveries": 0, "missed": 0}

    def send(self, kind: str, poses: list[Any], loops: int, wait_s: float) -> None:
        """Send a mission to its action server; raises `Problem` if that does not answer in time."""
        self.begin()
        told, action = self.told, self._actions[kind]
        name = "".join(map(str.title, kind.split("_")))
        offered = imported(f"nav2_msgs/action/{name}")
        client = self._client(kind, offered)
        if not self._until(client.server_is_ready, wait_s):
            raise Problem(f"no action server {action} within {wait_s:g} s")
        goal = offered.Goal()
        if name == "NavigateToPose":
            goal.pose = poses[0]
        elif hasattr(goal.poses, "goals"):  # nav_msgs/Goals since Kilted
            goal.poses.goals = poses
        else:
            goal.poses = poses
        if name == "FollowWaypoints":
            goal.number_of_loops = loops

        def progress(message: Any) -> None:
            told["recoveries"] = max(told["recoveries"], getattr(message.feedback, "number_of_recoveries", 0))

        future = client.send_goal_async(goal, feedback_callback=progress)
        if not self._until(future.done, wait_s):
            raise Problem(f"{action} did not answer the goal within {wait_s:g} s")
        self._sent = future.result()
        if not self._sent.accepted:
            told |= {"state": "rejected", "message": "the action server rejected the goal"}
            return
        self._sent.get_result_async().add_done_callback(lambda done: _end(told, done.result()))

    def cancel(self) -> None:
        if self._sent is not None and self.told["state"] == "running":
            self._sent.cancel_goal_async()
        self._sent = None
        self.begin("")

    def _client(self, kind: str, action: Any) -> Any:
        from rclpy.action import ActionClient

        if kind not in self._clients:
            self._clients[kind] = ActionClient(self._node, action, self._actions[kind])
        return self._clients[kind]


def _end(told: dict[str, Any], answer: Any) -> None:
    result = answer.result
    told |= {
        "state": {4: "succeeded", 5: "canceled", 6: "aborted"}.get(answer.status, "aborted"),
        "code": int(getattr(result, "error_code", 0)),
        "message": str(getattr(result, "error_msg", "")),
        "missed": len(getattr(result, "missed_waypoints", ())),
    }
