"""The channel to the bridge: messages over a UNIX socket, see `vastflow.sim.nodes.bridge`."""

import functools
import json
import os
import socket
import struct
import time
from collections.abc import Callable, Mapping
from pathlib import Path
from types import TracebackType
from typing import Any, Final, Self

from vastflow.sim.model.faults import ScenarioError

MOST_BYTES: Final = 64 << 20
_HEAD: Final = struct.Struct(">I")
_LOOK_S: Final = 0.2
_END_S: Final = 2.0


class Channel:
    """The simulator's end of the socket.

    Args:
        path: Of the socket, which is made.
        ended: Says why the bridge ended; None while it lives.
    """

    def __init__(self, path: Path, ended: Callable[[], str | None]) -> None:
        self._ended = ended
        self._listening = socket.socket(socket.AF_UNIX)
        try:
            self._listening.bind(str(path))
        except OSError:  # a socket's path has to be short
            folder = os.open(path.parent, os.O_RDONLY)
            self._listening.bind(f"/proc/self/fd/{folder}/{path.name}")
            os.close(folder)
        self._listening.listen(1)
        self._connection: socket.socket | None = None

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        for each in (self._connection, self._listening):
            if each is not None:
                each.close()

    def ask(self, message: Mapping[str, Any], content: bytes, within_s: float) -> tuple[dict[str, Any], bytes]:
        """Send a message, and return the bridge's answer with its bytes.

        Raises:
            ScenarioError: the bridge ended, told a problem, wrote something else, or did not answer within so much host time.
        """
        connection = self._connected(within_s)
        text = json.dumps({**message, "bytes": len(content)}).encode()
        try:
            connection.sendall(_HEAD.pack(len(text)) + text + content)
            answer = json.loads(self._exactly(_HEAD.unpack(self._exactly(4, within_s))[0], within_s))
            told = self._exactly(answer.get("bytes", 0), within_s)
        except OSError as error:
            until_s = time.monotonic() + _END_S  # it ends just now
            while (why := self._ended()) is None and time.monotonic() < until_s:
                time.sleep(0.01)
            raise ScenarioError(f"the bridge to ROS 2 {why or error}") from None
        except (ValueError, AttributeError, TypeError):
            raise ScenarioError("the bridge to ROS 2 wrote something that is no message of its own") from None
        if "problem" in answer:
            raise ScenarioError(f"ROS 2: {answer['problem']}")
        return answer, told

    def _connected(self, within_s: float) -> socket.socket:
        if self._connection is None:
            self._connection = self._waited(lambda: self._listening.accept()[0], self._listening, within_s)
        return self._connection

    def _exactly(self, size: int, within_s: float) -> bytes:
        if size > MOST_BYTES:
            raise ValueError
        connection, parts = self._connected(within_s), bytearray()
        while len(parts) < size:
            most = min(size - len(parts), 1 << 20)
            part = self._waited(functools.partial(connection.recv, most), connection, within_s)
            if not part:
                raise ConnectionResetError("closed its end")
            parts += part
        return bytes(parts)

    def _waited(self, act: Callable[[], Any], on: socket.socket, within_s: float) -> Any:
        waited_s = 0.0
        while True:
            on.settimeout(_LOOK_S)
            try:
                return act()
            except TimeoutError:
                waited_s += _LOOK_S
            finally:
                on.settimeout(None)
            if (why := self._ended()) is not None:
                raise ScenarioError(f"the bridge to ROS 2 {why}")
            if waited_s >= within_s:
                raise ScenarioError(f"the bridge to ROS 2 did not answer within {within_s:g} s")
