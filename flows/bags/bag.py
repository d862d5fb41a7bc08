"""Bags of ROS as arrays, read in a process with limits."""

import importlib.util
import pickle
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Final

import numpy as np
from numpy.typing import NDArray

from vastflow.sim.model.faults import UserError
from vastflow.tasks.engine.child import Child

MOST_BYTES: Final = 16 << 30
MOST_MEMORY_BYTES: Final = 6 << 30
MOST_S: Final = 1800.0


class BagError(UserError):
    """A bag that can't be read, or lacks what a run needs."""


@dataclass(frozen=True)
class Messages:
    """Numbers of messages, in the order of the log.

    Attributes:
        log_s: (N,) time of the log.
        stamp_s: (N,) time of the header; NaN without one.
        values: (N, K), of poses x (m), y (m), and yaw (rad) first, of odometry then v (m/s), w (rad/s); of commands v, w; of a goal's
            status its code.
    """

    log_s: NDArray[np.float64]
    stamp_s: NDArray[np.float64]
    values: NDArray[np.float64]

    def __len__(self) -> int:
        return len(self.log_s)


@dataclass(frozen=True)
class ScanShape:
    """Frame, angle between beams (rad), and limits (m) of a laser scanner."""

    frame: str
    angle_increment_rad: float
    range_min_m: float
    range_max_m: float


@dataclass(frozen=True)
class Bag:
    """Content of a bag.

    Attributes:
        topics: Role to topic, see `vastflow.flows.bags.reading`.
        roles: Role to its messages; empty ones where there is none.
        frames: Parent and child frame of odometry.
        edges: Parent and child frame to the transforms between them.
        fixed: The same of static transforms.
        behaviors: Log time (s) and name of each behavior that a tree began.
        ranges_m: (N, B) ranges of the scans of `roles["scan"]`; none unless they were asked for.
        exported: Outcome and reason of a whole simulated run that vastflow exported; None of another bag.
        notes: What was left out, one line each.
    """

    name: str
    topics: Mapping[str, str]
    roles: Mapping[str, Messages] = field(repr=False)
    frames: tuple[str, str]
    edges: Mapping[tuple[str, str], Messages] = field(repr=False)
    fixed: Mapping[tuple[str, str], tuple[float, float, float]]
    behaviors: Sequence[tuple[float, str]]
    scan: ScanShape | None
    ranges_m: NDArray[np.float32] = field(repr=False)
    exported: tuple[str, str] | None
    notes: tuple[str, ...]


def read_bag(path: Path, namespace: str = "", *, scans: bool = False) -> Bag:
    """Read a rosbag2 (folder, `.mcap`, or `.db3`) or a ROS 1 bag in a process with limits.

    Args:
        namespace: The robot's, such as `robot1`; empty for the only robot.
        scans: Whether ranges are read.

    Raises:
        BagError: it can't be read, has several robots, or is beyond the limits.
        UserError: rosbags is missing.
    """
    if importlib.util.find_spec("rosbags") is None:
        raise UserError("rosbags is missing. Call pip install 'vastflow[ros]'.")
    if not path.exists():
        raise BagError(f"{path}: expected a bag, got no such file or folder")
    request = {"path": str(path.absolute()), "namespace": namespace, "scans": scans}
    reader = "vastflow.flows.bags.reading:answer"
    with Child(reader, memory_bytes=MOST_MEMORY_BYTES, file_bytes=MOST_BYTES) as child:
        try:
            bag: Bag = pickle.loads(child.ask(request, MOST_S))  # of our own process, made of numbers and names
        except UserError as error:
            raise BagError(f"{path}: {error}") from None
    return bag
