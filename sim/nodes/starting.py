"""The start of a run's nodes: the bridge, and processes in order, each when the one before is ready."""

import contextlib
import math
import socket
import time
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

from vastflow.sim.model.faults import ScenarioError
from vastflow.sim.model.files import copy_file
from vastflow.sim.model.nodes import NodeProcess, Nodes
from vastflow.sim.nodes.channel import Channel
from vastflow.sim.scenario.programs.containers import CHANNEL
from vastflow.sim.scenario.programs.process import ProcessGroup
from vastflow.sim.scenario.programs.run import ProcessRun
from vastflow.sim.world.occupancy import OccupancyMap
from vastflow.sim.world.robot_model import Lidar

BRIDGE_WITHIN_S: Final = 30.0
_LOOK_S: Final = 0.05


@dataclass(frozen=True)
class Started:
    """The nodes of a run, ready.

    Attributes:
        groups: Name to process of each node; the bridge is none.
    """

    nodes: Nodes
    channel: Channel
    programs: ProcessRun
    groups: Mapping[str, ProcessGroup]

    def ended(self) -> str:
        """Return which process ended and how, in words; empty while all run.

        Raises:
            ScenarioError: a container ended by a limit, or by its runtime. The run is not to be judged.
        """
        self.programs.check()
        for name, group in self.groups.items():
            if group.failure is not None:
                return group.with_last_line(f"node {name!r} {group.failure or 'ended'}")
        return ""


@contextmanager
def started(
    programs: ProcessRun, nodes: Nodes, domain: int, lidar: Lidar, ground: OccupancyMap | None
) -> Iterator[Started]:
    """Start the nodes of a run; they end with it.

    Args:
        domain: Id of the run's domain of ROS 2.
        ground: The map that the robot has; None without one.

    Raises:
        ScenarioError: a process can't be started, ended, or is not ready in time. The run is not to be judged.
    """
    if not programs.in_main:  # containers have a network of their own
        programs.environment |= {
            "ROS_DOMAIN_ID": str(domain),
            "ROS_AUTOMATIC_DISCOVERY_RANGE": "LOCALHOST",
            # Later releases, which have the range, warn of it.
            **({"ROS_LOCALHOST_ONLY": "1"} if programs.environment.get("ROS_DISTRO") == "humble" else {}),
        }
    # Shared memory of processes that are killed stays behind, and a later run of the domain finds it.
    programs.environment.setdefault("FASTDDS_BUILTIN_TRANSPORTS", "UDPv4")
    folder = programs.folders.out.parent / "channel"
    folder.mkdir(exist_ok=True)
    for file in Path(__file__).parent.glob("bridge*.py"):
        copy_file(file, folder / file.name)
    seen = CHANNEL if programs.in_main else f"../{folder.name}"  # as a socket's path has to be short
    command = [nodes.python, f"{seen}/bridge.py", f"{seen}/bridge.sock"]
    groups: dict[str, ProcessGroup] = {}
    bridge: ProcessGroup | None = None
    with Channel(folder / "bridge.sock", lambda: _how(bridge, programs)) as channel:
        bridge = programs.start(command, "bridge", stays=True)
        channel.ask(*_setup(nodes, lidar, ground), BRIDGE_WITHIN_S)
        for process in nodes.processes:
            environment = {**programs.environment, **process.environment}
            group = programs.start(process.command, process.name, stays=True, environment=environment)
            groups[process.name] = group
            _wait(process, group, channel, programs)
        channel.ask({"do": "settle", "wait_s": BRIDGE_WITHIN_S}, b"", 2.0 * BRIDGE_WITHIN_S)
        yield Started(nodes, channel, programs, groups)


def _how(group: ProcessGroup | None, programs: ProcessRun) -> str | None:
    if group is None or group.failure is None:
        return None
    programs.check()  # a container says more
    return group.with_last_line(group.failure or "ended")


def _setup(nodes: Nodes, lidar: Lidar, ground: OccupancyMap | None) -> tuple[dict[str, Any], bytes]:
    about: dict[str, Any] | None = None
    cells = b""
    if ground is not None:
        rows, columns = ground.shape
        origin = (*ground.origin_xy_m, ground.frame.yaw_rad)
        about = {"resolution": ground.resolution_m, "width": columns, "height": rows, "origin": origin}
        cells = ground.cells.astype("i1").tobytes()
    period_s, turn = 1.0 / lidar.rate_hz, lidar.angle_increment_rad
    sweep_s = period_s * turn / math.tau if lidar.sweeps else 0.0
    scan = {
        "angle_min": lidar.angle_min_rad,
        "angle_max": lidar.angle_min_rad + turn * (lidar.beams - 1),
        "angle_increment": turn,
        "range_min": lidar.range_min_m,
        "range_max": lidar.range_max_m,
        "scan_time": period_s,
        "time_increment": sweep_s,
    }
    setup = {
        "topics": dict(nodes.topics),
        "frames": dict(nodes.frames),
        "actions": dict(nodes.actions),
        "stamped": nodes.stamped,
        "answer": nodes.answer if nodes.time == "lock_step" else "",
        "mission": nodes.mission,
        "joints": nodes.joints,
        "record": list(nodes.record),
        "mount": list(lidar.mount_xyt),
        "lidar": scan,
        "map": about,
    }
    return setup, cells


def _wait(process: NodeProcess, group: ProcessGroup, channel: Channel, programs: ProcessRun) -> None:
    """Return when a process is ready; raises `ScenarioError` if it ends or takes too long."""
    if not process.ready:
        return
    until_s = time.monotonic() + process.ready_within_s
    while not _is_ready(process, group, channel):
        if (how := _how(group, programs)) is not None:
            raise ScenarioError(f"node {process.name!r} {how}")
        if time.monotonic() > until_s:
            what = f"{process.ready} {process.ready_at!r}"
            raise ScenarioError(
                group.with_last_line(
                    f"node {process.name!r}: no {what} within {process.ready_within_s:g} s of its start"
                )
            )
        time.sleep(_LOOK_S)


def _is_ready(process: NodeProcess, group: ProcessGroup, channel: Channel) -> bool:
    at = process.ready_at
    if process.ready == "log":
        return at in group.log.read().decode(errors="replace")
    if process.ready == "port":
        with contextlib.suppress(OSError), socket.create_connection(("127.0.0.1", int(at)), _LOOK_S):
            return True
        return False
    graph, _ = channel.ask({"do": "graph"}, b"", BRIDGE_WITHIN_S)
    offered: Sequence[str] = [*graph[f"{process.ready}s"]]
    return at in offered or f"/{at}" in offered
