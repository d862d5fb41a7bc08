#!/usr/bin/env python3
"""A stand-in for the Python of a ROS 2 installation, with nodes of its own making.

`BEHAVIOR` says what its nodes do. They drive 1.4 m ahead at 0.3 m/s; a message of each tick is kept in `heard.jsonl` of the working directory.
"""

import json
import math
import os
import socket
import struct
import sys
import time


def receive(connection):
    def exactly(size):
        parts = b""
        while len(parts) < size:
            part = connection.recv(size - len(parts))
            if not part:
                sys.exit(0)
            parts += part
        return parts

    message = json.loads(exactly(struct.unpack(">I", exactly(4))[0]))
    return message, exactly(message.get("bytes", 0))


def send(connection, message, content=b""):
    text = json.dumps({**message, "bytes": len(content)}).encode()
    connection.sendall(struct.pack(">I", len(text)) + text + content)


def main():
    behavior = os.environ.get("BEHAVIOR", "")
    connection = socket.socket(socket.AF_UNIX)
    connection.connect(sys.argv[2])
    setup, cells = receive(connection)
    with open("setup.json", "w", encoding="utf-8") as file:
        json.dump({**setup, "cells": len(cells)}, file)
    send(connection, {"problem": "tf2_msgs is missing"} if behavior == "problem" else {})
    commands, state, scans, told, estimate = 0, "", 0, 0, None
    with open("heard.jsonl", "w", encoding="utf-8") as heard:
        while True:
            message, content = receive(connection)
            if message["do"] == "settle":
                send(connection, {})
                continue
            if message["do"] == "graph":
                send(connection, {"topics": {"/cmd_vel": ""}, "actions": ["/navigate_to_pose"], "nodes": ["follower"]})
                continue
            print(json.dumps(message), file=heard, flush=True)
            scans += bool(content)
            if message.get("mission"):
                state = "running"
            if message.get("localize"):
                told += 1
                estimate = message["localize"] if behavior != "deaf" or told == 3 else None
            if "slow" in behavior:
                time.sleep(0.2)
            if behavior == "dies" and scans == 5:
                sys.exit("no memory left")
            if behavior == "garbage" and scans == 5:
                connection.sendall(b"\0\0\0\5hello")
                time.sleep(60)
            if state == "running" and scans == 20 and behavior in ("succeeded", "aborted"):
                state = behavior
            commands += bool(content)
            speed_mps = 0.3 if message["odom"][0] < 1.4 else 0.0
            turn_radps = 0.5 if behavior == "turns" else 0.0
            command = [speed_mps, 0.0, math.nan if "nan" in behavior and scans == 5 else turn_radps]
            recorded = [[message["t_ns"], "/plan", "nav_msgs/msg/Path", 4]] if scans == 3 and content else []
            answer = {
                "command": command if content else None,
                "commands": commands,
                "estimate": estimate,
                "covariance": [0.25, 0.0, 0.25, 0.07],
                "updates": int(estimate is not None),
                "map_odom": None,
                "mission": {
                    "state": state,
                    "code": 105 * (state == "aborted"),
                    "message": "",
                    "recoveries": 2,
                    "missed": 0,
                },
                "log": [[30, "controller_server", "Control loop missed its desired rate of 20 Hz"]]
                if scans == 4 and content
                else [],
                "recorded": recorded,
                "dropped": 0,
                "answered": not (message["await"] and behavior == "silent" and scans == 5),
            }
            send(connection, answer, b"path" if recorded else b"")


if __name__ == "__main__":
    main()
