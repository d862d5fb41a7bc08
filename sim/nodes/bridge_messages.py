"""Messages of the bridge, on its socket and of ROS 2; the file lies beside the executed bridge."""

import importlib
import json
import math
import socket
import struct
from typing import Any


class Problem(Exception):
    """A problem that a user has to mend, in one sentence."""


def receive(connection: socket.socket) -> tuple[dict[str, Any], bytes]:
    """Return the next message and its bytes; EOFError at the end."""

    def exactly(size: int) -> bytes:
        parts = bytearray()
        while len(parts) < size:
            part = connection.recv(min(size - len(parts), 1 << 20))
            if not part:
                raise EOFError
            parts += part
        return bytes(parts)

    message = json.loads(exactly(struct.unpack(">I", exactly(4))[0]))
    return message, exactly(message.get("bytes", 0))


def send(connection: socket.socket, message: dict[str, Any], content: bytes = b"") -> None:
    text = json.dumps({**message, "bytes": len(content)}).encode()
    connection.sendall(struct.pack(">I", len(text)) + text + content)


def imported(kind: str) -> Any:
    """Return the class of a type such as `nav_msgs/msg/Path`; raises `Problem` without its package."""
    package, part, name = kind.split("/")
    try:
        return getattr(importlib.import_module(f"{package}.{part}"), name)
    except (ImportError, AttributeError) as error:
        raise Problem(f"{kind} is missing in this installation of ROS 2 ({error})") from None


def is_there(kind: str) -> bool:
    try:
        return bool(imported(kind))
    except Problem:
        return False


def yaw_of(turn: Any) -> float:
    return math.atan2(2.0 * (turn.w * turn.z + turn.x * turn.y), 1.0 - 2.0 * (turn.y * turn.y + turn.z * turn.z))


def place(pose: Any, x: float, y: float, yaw: float) -> None:
    """Write a planar pose into a message."""
    pose.position.x, pose.position.y = x, y
    pose.orientation.z, pose.orientation.w = math.sin(yaw / 2.0), math.cos(yaw / 2.0)
