"""Publish messages by rclpy, and write what subscriptions get: for `rclpy_bags.py`."""

import importlib
import pickle
import re
import sys
import time
from pathlib import Path

import rclpy
from rclpy.executors import SingleThreadedExecutor
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy

rows, topics, paced = pickle.load(sys.stdin.buffer)
share = Path(sys.prefix, "share")


def kind_of(name):
    package, _, kind = name.replace("/msg/", "/").replace("/", "/msg/").split("/")
    return getattr(importlib.import_module(package + ".msg"), kind)


def filled(message, values):
    types = message.get_fields_and_field_types()
    for name, value in values.items():
        if isinstance(value, dict):
            filled(getattr(message, name), value)
        elif isinstance(value, list) and value and isinstance(value[0], dict):
            inner = kind_of(re.fullmatch("sequence<(.*)>", types[name]).group(1))
            setattr(message, name, [filled(inner(), each) for each in value])
        else:
            setattr(message, name, value)
    return message


def definition(name, found):
    package, _, kind = name.split("/")
    found[name] = text = (share / package / "msg" / (kind + ".msg")).read_text()
    for line in text.splitlines():
        if inner := re.match(r"([a-z_0-9]+/)?([A-Z]\w*)(\[.*\])?\s+[a-z]", line):
            other = (inner[1] or package + "/") + "msg/" + inner[2]
            if other not in found:
                definition(other, found)
    return found


rclpy.init()
robot, recorder = rclpy.create_node("robot"), rclpy.create_node("recorder")
executor = SingleThreadedExecutor()
executor.add_node(recorder)
publishers, kept = {}, []
for topic, (kind, latched, sensor) in topics.items():
    qos = QoSProfile(
        depth=2000,
        reliability=ReliabilityPolicy.BEST_EFFORT if sensor else ReliabilityPolicy.RELIABLE,
        durability=DurabilityPolicy.TRANSIENT_LOCAL if latched else DurabilityPolicy.VOLATILE,
    )
    publishers[topic] = robot.create_publisher(kind_of(kind), topic, qos)
    keep = lambda raw, topic=topic: kept.append((topic, time.time_ns(), bytes(raw)))
    recorder.create_subscription(kind_of(kind), topic, keep, qos, raw=True)
until = time.time() + 20
while any(not each.get_subscription_count() for each in publishers.values()) and time.time() < until:
    time.sleep(0.05)
began = time.time()
for number, (log_s, topic, values) in enumerate(rows):
    publishers[topic].publish(filled(publishers[topic].msg_type(), values))
    while number + 1 - len(kept) > 50 or (paced and time.time() < began + log_s):
        before = len(kept)
        executor.spin_once(0.002)
        if len(kept) == before and not paced and number + 1 - len(kept) < 100:
            break
until = time.time() + 5
while len(kept) < len(rows) and time.time() < until:
    executor.spin_once(0.1)
told = {}
for topic in topics:
    info = robot.get_publishers_info_by_topic(topic)[0]
    qos, lasting = info.qos_profile, {"sec": 9223372036, "nsec": 854775807}
    texts = definition(topics[topic][0], {})
    first, *others = texts.items()
    told[topic] = (
        str(info.topic_type_hash),
        {
            "history": qos.history.name.lower(),
            "depth": qos.depth,
            "reliability": qos.reliability.name.lower(),
            "durability": qos.durability.name.lower(),
            "deadline": lasting,
            "lifespan": lasting,
            "liveliness": qos.liveliness.name.lower(),
            "liveliness_lease_duration": lasting,
            "avoid_ros_namespace_conventions": False,
        },
        first[1] + "".join("\n" + "=" * 80 + "\nMSG: " + n.replace("/msg/", "/") + "\n" + t for n, t in others),
    )
sys.stdout.buffer.write(pickle.dumps((kept, told, began)))
