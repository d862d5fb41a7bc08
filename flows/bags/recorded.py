"""The recording of a run from its drive: the simulator's columns, in whole thousandths."""

from collections.abc import Mapping, Sequence
from typing import Final

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from vastflow.flows.bags.bag import Bag
from vastflow.flows.bags.drive import Clock, Drive, Poses, between, held
from vastflow.sim.model.recording import Event, Recording, Run
from vastflow.sim.world.occupancy import OccupancyMap

RECOVERIES: Final[Mapping[str, str]] = {
    "Spin": "spin",
    "Wait": "wait",
    "BackUp": "back up",
    "ClearLocalCostmap": "clear local costmap",
    "ClearGlobalCostmap": "clear global costmap",
    "ClearCostmap": "clear both costmaps",
}
"""Begins of the names of Nav2's recovery nodes to the words of events."""

Column = NDArray[np.int32]


def recording_of(bag: Bag, clock: Clock, drive: Drive, hits: Sequence[Event] = ()) -> Recording:
    """Return the recording of a drive, whose true pose is the estimate where the bag has no other.

    Args:
        hits: Contacts with walls; those of a bag that tells them, such as an export, take their place.
    """
    t_s, poses = drive.t_s, drive.poses
    elapsed_s, last_s = t_s - t_s[0], round(float(t_s[-1] - t_s[0]), 3)
    columns = {"t_ms": thousandths(elapsed_s)}
    for prefix, those in (("", poses), ("estimated_", drive.estimate)):
        turned_rad = (those[:, 2] + np.pi) % (2.0 * np.pi) - np.pi
        named = {"x_mm": those[:, 0], "y_mm": those[:, 1], "yaw_mrad": turned_rad}
        columns |= {f"{prefix}{name}": thousandths(values) for name, values in named.items()}
    speeds = {"": _motion(bag, clock, drive)}
    for role, prefix in (("control", "command_"), ("command", "sent_")):
        if len(told := bag.roles[role]):
            since_s = clock.arrivals(told.log_s)
            speeds[prefix] = np.where(t_s >= since_s[0] - 1e-6, held(since_s, told.values, t_s).T, 0.0)
    for prefix, (forward_mps, turn_radps) in speeds.items():
        columns[f"{prefix}speed_mmps"] = thousandths(forward_mps)
        columns[f"{prefix}yaw_rate_mradps"] = thousandths(turn_radps)
    columns["localized"] = _updates(bag, clock, t_s)
    recoveries, told = _recoveries(bag, clock, drive), bag.roles["contact"]
    if drive.truth is not None and len(told):
        hits = _events(drive, "contact", clock.arrivals(told.log_s), told.values, ["something"] * len(told))
    events = sorted([*recoveries, *hits], key=lambda event: event.t_s)
    goal = "goal_reached" if drive.outcome == "succeeded" else "goal_missed"
    events.append(Event(last_s, goal, float(poses[-1, 0]), float(poses[-1, 1]), "0"))
    run = Run(
        run_index=0,
        seed="0",
        outcome=drive.outcome,
        error_code=0,
        reason=drive.reason,
        simulated_s=last_s,
        distance_m=round(float(np.hypot(*np.diff(poses[:, :2], axis=0).T).sum()), 3),
        recoveries=len(recoveries),
        missed_goals=0,
        events=tuple(events),
        estimated_by="" if drive.truth is not None else drive.origin,
    )
    return Recording(run, columns)


def thousandths(values: NDArray[np.float64]) -> Column:
    return np.rint(values * 1000.0).astype(np.int32)


def _motion(bag: Bag, clock: Clock, drive: Drive) -> NDArray[np.float64]:
    """Return speed and yaw rate (2, N): those of the truth, else of odometry, else of the poses."""
    if len(told := bag.roles["truth"] if len(bag.roles["truth"]) else bag.roles["odometry"]):
        at_s, first = np.unique(clock.times(told), return_index=True)
        return np.array([np.interp(drive.t_s, at_s, told.values[first, k]) for k in (3, 4)])
    x_m, y_m, yaw_rad = drive.poses.T
    step_s = float(drive.t_s[1] - drive.t_s[0])
    ahead = np.cos(yaw_rad) * np.gradient(x_m, step_s) + np.sin(yaw_rad) * np.gradient(y_m, step_s)
    return np.array([ahead, np.gradient(np.unwrap(yaw_rad), step_s)])


def _updates(bag: Bag, clock: Clock, t_s: NDArray[np.float64]) -> Column:
    """Return (N,) 1 where the estimate was updated since the row before."""
    told = bag.roles["estimate"]
    if not len(told):
        of_map = [each for (parent, _), each in bag.edges.items() if parent.rpartition("/")[2] == "map"]
        told = max(of_map, key=len, default=told)
    last = np.searchsorted(clock.arrivals(told.log_s), t_s + 1e-6, side="right")
    return (np.diff(last, prepend=0) > 0).astype(np.int32)


def _recoveries(bag: Bag, clock: Clock, drive: Drive) -> list[Event]:
    whats = [
        next((words for begin, words in RECOVERIES.items() if name.startswith(begin)), "") for _, name in bag.behaviors
    ]
    times = clock.arrivals(np.array([log_s for log_s, _ in bag.behaviors], dtype=np.float64))
    places = between(drive.t_s, drive.poses, times)
    return _events(drive, "recovery", times, places, whats)


def _events(drive: Drive, kind: str, t_s: NDArray[np.float64], places: Poses, whats: Sequence[str]) -> list[Event]:
    """Return the events of the drive that are something, of times and places (N, 2 or more)."""
    begin_s, end_s = drive.t_s[[0, -1]].tolist()
    return [
        Event(round(at_s - begin_s, 3), kind, round(x_m, 3), round(y_m, 3), what)
        for at_s, (x_m, y_m, *_), what in zip(t_s.tolist(), places.tolist(), whats, strict=True)
        if what and begin_s <= at_s <= end_s
    ]


def wall_contacts(drive: Drive, ground: OccupancyMap, radius_m: float) -> list[Event]:
    """Contacts of a disc with the map's walls by the true pose, one at the begin of each."""
    far_m, _ = cKDTree(ground.centers_of(np.argwhere(ground.occupied))).query(drive.poses[:, :2])
    # A cell's size less: neither the robot nor the wall is known better.
    touches = far_m < radius_m - ground.resolution_m
    begins = np.flatnonzero(touches & ~np.append(False, touches[:-1]))
    return _events(drive, "contact", drive.t_s[begins], drive.poses[begins], ["wall"] * len(begins))
