"""A stand-in for rclpy on a clock of its own: tests say when nodes answer what the bridge publishes."""

import pickle
import struct
import sys
from collections.abc import Callable
from types import ModuleType, SimpleNamespace
from typing import Any

HEAD = struct.Struct("<4xiI")


class Message:
    """Has every attribute, and takes every element."""

    def __init__(self, **given: Any) -> None:
        self.__dict__.update(given)

    def __getattr__(self, name: str) -> Any:
        if name.startswith("__") or (name == "twist" and type(self).__name__ == "Twist"):
            raise AttributeError(name)
        self.__dict__[name] = value = Message()
        return value

    def __setitem__(self, index: int, value: float) -> None:
        pass

    @classmethod
    def get_fields_and_field_types(cls) -> dict[str, str]:
        return {"header": "std_msgs/Header"} if cls.__name__.endswith("Stamped") else {"data": "double"}


class TimeoutException(Exception):
    pass


class Network:
    """Messages on their way, and all that the bridge published.

    Attributes:
        now_s: Time of the clock, which goes on when somebody waits.
        sent: (time, topic, message) of the bridge.
        heard_by: Topic to the function that is called with its messages; it may `publish`.
        waited: Topics whose delivery the bridge waited for.
    """

    def __init__(self) -> None:
        self.now_s = 0.0
        self.sent: list[tuple[float, str, Message]] = []
        self.heard_by: dict[str, Callable[[Message], None]] = {}
        self.waited: list[str] = []
        self._subscribed: dict[str, Callable[[bytes], None]] = {}
        self._coming: list[tuple[float, int, str, bytes]] = []

    def publish(self, topic: str, message: Message, delay_s: float = 0.001, stamp_ns: int = 0) -> None:
        content = HEAD.pack(*divmod(stamp_ns, 10**9)) + pickle.dumps(message.__dict__)
        content = b"\0\1" + content[2:]
        self._coming.append((self.now_s + delay_s, len(self._coming), topic, content))

    def monotonic(self) -> float:
        return self.now_s

    def wait_for_ready_callbacks(self, timeout_sec: float) -> tuple[Any, ...]:
        first = min(self._coming, default=None)
        if first is None or first[0] > self.now_s + timeout_sec:
            self.now_s += timeout_sec
            raise TimeoutException
        self._coming.remove(first)
        self.now_s = max(self.now_s, first[0])
        return _Handler(lambda: self._subscribed.get(first[2], lambda _: None)(first[3])), None, None

    def create_publisher(self, kind: type, topic: str, profile: Any) -> Any:
        def publish(message: Message) -> None:
            self.sent.append((self.now_s, topic, message))
            if topic in self.heard_by:
                self.heard_by[topic](message)

        made = {"publish": publish, "topic_name": topic, "qos_profile": profile}
        return SimpleNamespace(**made, wait_for_all_acked=lambda _: self.waited.append(topic))

    def create_subscription(self, kind: type, topic: str, heard: Any, profile: Any, raw: bool) -> None:
        self._subscribed[topic] = heard

    def get_topic_names_and_types(self) -> list[tuple[str, list[str]]]:
        return []


class _Handler:
    def __init__(self, act: Callable[[], None]) -> None:
        self._act = act

    def __call__(self) -> None:
        self._act()

    def result(self) -> None:
        return None


def installed(monkeypatch: Any, kinds: list[str]) -> Network:
    """Install rclpy and types of messages for one test, and return their network."""
    network = Network()
    executor = SimpleNamespace(add_node=lambda _: None, wait_for_ready_callbacks=network.wait_for_ready_callbacks)
    policy = SimpleNamespace(BEST_EFFORT=1, RELIABLE=2, TRANSIENT_LOCAL=3, VOLATILE=4)
    modules: dict[str, dict[str, Any]] = {
        "rclpy": {"init": lambda args: None, "create_node": lambda name, **_: network},
        "rclpy.executors": {"SingleThreadedExecutor": lambda: executor, "TimeoutException": TimeoutException},
        "rclpy.qos": {"DurabilityPolicy": policy, "ReliabilityPolicy": policy, "QoSProfile": SimpleNamespace},
        "rclpy.serialization": {
            "deserialize_message": lambda content, kind: kind(**pickle.loads(content[HEAD.size :]))
        },
        "rclpy.duration": {"Duration": SimpleNamespace},
    }
    for kind in kinds:
        package, part, name = kind.split("/")
        modules.setdefault(f"{package}.{part}", {})[name] = type(name, (Message,), {})
        modules.setdefault(package, {})
    for name, content in modules.items():
        module = ModuleType(name)
        module.__dict__.update(content)
        monkeypatch.setitem(sys.modules, name, module)
    return network
