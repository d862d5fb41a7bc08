"""The recording of a run from its drive: the simulator's columns, in whole thousandths."""

from collections.abc import Mapping
from typing import Final

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from vastflow.flows.bags.bag import Bag, Messages
from vastflow.flows.bags.drive import Clock, Drive, between
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


def recording_of(bag: Bag, clock: Clock, drive: Drive) -> Recording:
    """Return the recording of a drive, whose true pose is the estimate where the bag has no other."""
    t_s, poses = drive.t_s, drive.poses
    elapsed_s = t_s - t_s[0]
    speed_mps, yaw_rate_radps = _motion(bag, clock, drive)
    columns = {
        "t_ms": thousandths(elapsed_s),
        **_pose_columns("", poses),
        **_pose_columns("estimated_", drive.estimate),
        "speed_mmps": thousandths(speed_mps),
        "yaw_rate_mradps": thousandths(yaw_rate_radps),
    }
    for role, prefix in (("control", "command_"), ("command", "sent_")):
        if len(told := bag.roles[role]):
            forward_mps, turn_radps = _held(clock.arrivals(told), told.values, t_s).T
            columns |= {f"{prefix}speed_mmps": thousandths(forward_mps)}
            columns |= {f"{prefix}yaw_rate_mradps": thousandths(turn_radps)}
    columns["localized"] = _updates(bag, clock, t_s)
    steps_m = np.hypot(*np.diff(poses[:, :2], axis=0).T)
    x_m, y_m = poses[-1, :2].tolist()
    hits = _contacts(bag, clock, drive)
    goal = "goal_reached" if drive.outcome == "succeeded" else "goal_missed"
    recoveries = _recoveries(bag, clock, drive)
    events = sorted([*recoveries, *hits], key=lambda event: event.t_s)
    events.append(Event(round(float(elapsed_s[-1]), 3), goal, x_m, y_m, "0"))
    run = Run(
        run_index=0,
        seed="0",
        outcome=drive.outcome,
        error_code=0,
        reason=drive.reason,
        simulated_s=round(float(elapsed_s[-1]), 3),
        distance_m=round(float(steps_m.sum()), 3),
        recoveries=len(recoveries),
        missed_goals=0,
        events=tuple(events),
        estimated_by="" if drive.truth is not None else drive.origin,
    )
    return Recording(run, columns)


def thousandths(values: NDArray[np.float64]) -> Column:
    return np.rint(values * 1000.0).astype(np.int32)


def _pose_columns(prefix: str, poses: NDArray[np.float64]) -> dict[str, Column]:
    x_m, y_m, yaw_rad = poses.T
    turned_rad = (yaw_rad + np.pi) % (2.0 * np.pi) - np.pi
    named = {"x_mm": x_m, "y_mm": y_m, "yaw_mrad": turned_rad}
    return {f"{prefix}{name}": thousandths(values) for name, values in named.items()}


def _motion(bag: Bag, clock: Clock, drive: Drive) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return speed and yaw rate (N,): those of the truth, else of odometry, else of the poses."""
    if len(told := bag.roles["truth"] if len(bag.roles["truth"]) else bag.roles["odometry"]):
        at_s, first = np.unique(clock.times(told), return_index=True)
        return tuple(np.interp(drive.t_s, at_s, told.values[first, k]) for k in (3, 4))
    x_m, y_m, yaw_rad = drive.poses.T
    step_s = float(drive.t_s[1] - drive.t_s[0])
    ahead = np.cos(yaw_rad) * np.gradient(x_m, step_s) + np.sin(yaw_rad) * np.gradient(y_m, step_s)
    return ahead, np.gradient(np.unwrap(yaw_rad), step_s)


def _held(since_s: NDArray[np.float64], values: NDArray[np.float64], t_s: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the last values (N, K) at each time, 0 before the first."""
    last = np.searchsorted(since_s, t_s + 1e-6, side="right") - 1
    return np.where(last[:, None] >= 0, values[np.maximum(last, 0)], 0.0)


def _updates(bag: Bag, clock: Clock, t_s: NDArray[np.float64]) -> Column:
    """Return (N,) 1 where the estimate was updated since the row before."""
    told = bag.roles["estimate"]
    if not len(told):
        of_map = [each for (parent, _), each in bag.edges.items() if parent.rpartition("/")[2] == "map"]
        told = max(of_map, key=len, default=told)
    last = np.searchsorted(clock.arrivals(told) if len(told) else np.empty(0), t_s + 1e-6, side="right")
    return (np.diff(last, prepend=0) > 0).astype(np.int32)


def _recoveries(bag: Bag, clock: Clock, drive: Drive) -> list[Event]:
    found = []
    for log_s, name in bag.behaviors:
        what = next((words for begin, words in RECOVERIES.items() if name.startswith(begin)), None)
        at = Messages(*(np.array([value]) for value in (log_s, np.nan, 0.0)))
        t_s = float(clock.arrivals(at)[0])
        if what and drive.t_s[0] <= t_s <= drive.t_s[-1]:
            (x_m, y_m, _), *_ = between(drive.t_s, drive.poses, np.array([t_s])).tolist()
            found.append(Event(round(t_s - float(drive.t_s[0]), 3), "recovery", round(x_m, 3), round(y_m, 3), what))
    return found


def _contacts(bag: Bag, clock: Clock, drive: Drive) -> list[Event]:
    """Contacts of a bag that has them, such as an export. It does not tell with what."""
    told, begin_s = bag.roles["contact"], float(drive.t_s[0])
    times = clock.arrivals(told) if drive.truth is not None and len(told) else np.empty(0)
    return [
        Event(round(t_s - begin_s, 3), "contact", round(x_m, 3), round(y_m, 3), "something")
        for t_s, (x_m, y_m, *_) in zip(times.tolist(), told.values.tolist(), strict=False)
        if begin_s <= t_s <= drive.t_s[-1]
    ]


def wall_contacts(drive: Drive, ground: OccupancyMap, radius_m: float) -> list[Event]:
    """Contacts of a disc with the map's walls by the true pose, one at the begin of each."""
    far_m = ndimage.distance_transform_edt(~ground.occupied) * ground.resolution_m
    rows, columns = np.floor(ground.in_cells(drive.poses[:, :2])).astype(int).T
    inside = (rows >= 0) & (columns >= 0) & (rows < ground.shape[0]) & (columns < ground.shape[1])
    touches = np.zeros(len(rows), dtype=np.bool_)
    # A cell's size less: neither the robot nor the wall is known better.
    touches[inside] = far_m[rows[inside], columns[inside]] < radius_m - ground.resolution_m
    begins = np.flatnonzero(touches & ~np.append(False, touches[:-1]))
    times = (drive.t_s - drive.t_s[0])[begins]
    places = drive.poses[begins, :2]
    return [
        Event(round(t, 3), "contact", x, y, "wall") for t, (x, y) in zip(times.tolist(), places.tolist(), strict=True)
    ]
