"""Drives: the poses of a bag's robot on one clock, and its mission."""

import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Final, get_args

import numpy as np
from numpy.typing import NDArray

from vastflow.flows.bags.bag import Bag, BagError, Messages
from vastflow.sim.model.pose import Pose
from vastflow.sim.model.recording import Outcome

JUMP_S: Final = 1.0
"""Difference of the steps of stamps and log that is a jump of a clock."""
GAP_S: Final = 0.5
"""Time without a pose that is told."""
LONGEST_S: Final = 86_400.0
REACHED_M: Final = 0.35
"""Distance of a robot from its goal that has reached it, where no action says so: Nav2's tolerance of 0.25 m, and the way to a stop."""
MOVING_MPS: Final = 0.02
_BASES: Final = ("base_footprint", "base_link", "base")
_TRUE: Final = re.compile(r"(.*_)?(true|gt|ground_?truth)")
_WORLDS: Final = ("map", "world")
_EXECUTING, _SUCCEEDED, _CANCELED, _ABORTED = 2, 4, 5, 6
_DEEPEST: Final = 20

Poses = NDArray[np.float64]
"""(N, 3) x (m), y (m), yaw (rad)."""


@dataclass(frozen=True)
class Clock:
    """The clock of a bag: stamps of headers, or the log's where stamps jump or are missing.

    Attributes:
        log_s, time_s: (N,) increasing times of the log, and those of the clock.
    """

    log_s: NDArray[np.float64] = field(repr=False)
    time_s: NDArray[np.float64] = field(repr=False)
    by_stamps: bool

    def arrivals(self, log_s: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return when messages (N,) of these times of the log arrived."""
        before, after = np.minimum(log_s - self.log_s[0], 0.0), np.maximum(log_s - self.log_s[-1], 0.0)
        return np.asarray(np.interp(log_s, self.log_s, self.time_s) + before + after)

    def times(self, messages: Messages) -> NDArray[np.float64]:
        """Return the times (N,) that messages are about."""
        stamped = self.by_stamps and bool(np.isfinite(messages.stamp_s).all())
        return messages.stamp_s if stamped else self.arrivals(messages.log_s)


def clock_of(bag: Bag) -> tuple[Clock, tuple[str, ...]]:
    """Return the clock of a bag, and what is wrong with the other.

    Raises:
        BagError: no message of a pose.
    """
    stamped = max([*bag.edges.values(), bag.roles["odometry"]], key=len, default=bag.roles["odometry"])
    if len(stamped) < 2:
        raise BagError(f"{bag.name}: expected transforms or odometry of a robot, got {len(stamped)} messages")
    log_step_s, step_s = np.diff(stamped.log_s), np.diff(stamped.stamp_s)
    usual_log_s, usual_s = float(np.median(log_step_s)), float(np.median(step_s))
    keep = np.concatenate(([True], log_step_s > 0))
    by_stamps = Clock(stamped.log_s[keep], np.maximum.accumulate(stamped.stamp_s[keep]), True)
    by_log = Clock(stamped.log_s[keep], stamped.log_s[keep], False)
    if not usual_s > 0.0 or (step_s < -JUMP_S).any():
        what = "jump back" if usual_s > 0.0 else "stand still or are missing"
        return by_log, (f"stamps {what}; times are the log's",)
    apart_s = step_s - log_step_s * usual_s / max(usual_log_s, 1e-9)
    worst = int(np.argmax(np.abs(apart_s)))
    if abs(apart_s[worst]) <= JUMP_S:
        return by_stamps, ()
    if log_step_s[worst] * usual_s > step_s[worst] * usual_log_s:
        return by_stamps, (f"the log's clock jumps by {log_step_s[worst]:.0f} s; times are those of stamps",)
    return by_log, (f"stamps jump by {step_s[worst]:.0f} s; times are the log's",)


def joined(outer: Poses, inner: Poses) -> Poses:
    """Return poses of a frame's frame: `inner` (N, 3) or (3,), seen from where `outer` is seen."""
    (x, y, yaw), (ix, iy, iyaw) = outer.T, inner.T
    c, s = np.cos(yaw), np.sin(yaw)
    return np.stack(np.broadcast_arrays(x + c * ix - s * iy, y + s * ix + c * iy, yaw + iyaw), axis=-1)


def inverse(pose: Poses) -> Poses:
    x, y, yaw = pose.T
    c, s = np.cos(yaw), np.sin(yaw)
    return np.stack([-c * x - s * y, s * x - c * y, -yaw], axis=-1)


def held(since_s: NDArray[np.float64], values: NDArray[np.float64], t_s: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the last of values (N, K) at each time, and the first before it."""
    return np.asarray(values[np.maximum(np.searchsorted(since_s, t_s + 1e-6, side="right") - 1, 0)])


class Frames:
    """The frames of a bag, in the plane."""

    def __init__(self, bag: Bag, clock: Clock) -> None:
        self._clock = clock
        self._parents: dict[str, tuple[str, Messages | Poses]] = {}
        for (parent, child), pose in bag.fixed.items():
            self._parents[child] = parent, np.array(pose)
        for (parent, child), messages in sorted(bag.edges.items(), key=lambda edge: len(edge[1])):
            self._parents[child] = parent, messages
        odometry, (parent, child) = bag.roles["odometry"], bag.frames
        if len(odometry) and parent and child and child not in self._parents:
            self._parents[child] = parent, odometry

    @property
    def names(self) -> Sequence[str]:
        return [*self._parents]

    def up(self, frame: str) -> list[str]:
        """Return a frame and those above it, up to the root."""
        found = [frame]
        while found[-1] in self._parents and len(found) < _DEEPEST:
            found.append(self._parents[found[-1]][0])
        return found

    def has_moved(self, frame: str) -> bool:
        return any(isinstance(self._parents[each][1], Messages) for each in self.up(frame)[:-1])

    def poses(self, frame: str, t_s: NDArray[np.float64]) -> Poses:
        """Return the poses (N, 3) of a frame in its root."""
        found = np.zeros((len(t_s), 3))
        for child in self.up(frame)[:-1]:
            parent, how = self._parents[child]
            if not isinstance(how, Messages):
                pose = how
            elif basename(parent) == "map" and not _TRUE.fullmatch(basename(child)):
                # What the stack took for the transform: the last that it was told, which AMCL dates ahead.
                pose = held(self._clock.arrivals(how.log_s), how.values[:, :3], t_s)
            else:
                pose = between(self._clock.times(how), how.values[:, :3], t_s)
            found = joined(pose, found)
        return found


def between(at_s: NDArray[np.float64], poses: Poses, t_s: NDArray[np.float64]) -> Poses:
    """Interpolate poses (N, 3) linearly."""
    at_s, first = np.unique(at_s, return_index=True)
    x, y, yaw = poses[first].T
    return np.column_stack([np.interp(t_s, at_s, each) for each in (x, y, np.unwrap(yaw))])


def basename(frame: str) -> str:
    return frame.rpartition("/")[2]


@dataclass(frozen=True)
class Drive:
    """The robot's mission in a bag.

    Attributes:
        t_s: (N,) times of the rows on the bag's clock, 0.1 s apart; the first is when the robot was sent.
        estimate, truth: (N, 3) poses on the map at these times; truth is None if the bag has none.
        origin: Frames or topics of the estimate, in words.
        goal_from: Where the goal is from, in words.
        reason: Why it failed; empty for a success.
        notes: What was assumed or is missing, one line each.
    """

    t_s: NDArray[np.float64] = field(repr=False)
    estimate: Poses = field(repr=False)
    truth: Poses | None = field(repr=False)
    origin: str
    goal: Pose
    goal_from: str
    outcome: Outcome
    reason: str
    notes: tuple[str, ...]

    @property
    def poses(self) -> Poses:
        """True poses, else estimates (N, 3)."""
        return self.estimate if self.truth is None else self.truth


def drive_of(bag: Bag, clock: Clock, start: Pose | None = None, goal: Pose | None = None, row_s: float = 0.1) -> Drive:
    """Return the first mission of a bag.

    Args:
        start: Pose at the bag's begin, for a bag without a map frame.
        goal: Goal of a bag that doesn't tell it.

    Raises:
        BagError: the bag lacks what a mission needs.
    """
    frames, notes = Frames(bag, clock), []
    begin_s, end_s = float(clock.time_s[0]), float(clock.time_s[-1])
    began_s, ended_s, outcome = _sent(bag, clock, begin_s, end_s)
    origin, estimated = _estimate_of(bag, clock, frames, start)
    if goal is not None:
        goal_from = "--goal"
    elif (named := _goal(bag, clock, began_s, ended_s)) is not None:
        goal, goal_from = named
    else:
        goal = _pose(estimated(np.array([ended_s]))[0])
        goal_from = "where the robot ended, as nothing in the bag names one"
    if ended_s - began_s > LONGEST_S:
        took = f"{ended_s - began_s:.0f} s, as if both clocks had jumped"
        raise BagError(f"{bag.name}: expected a mission of a day at most, got {took}")
    t_s = began_s + row_s * np.arange(int((ended_s - began_s) / row_s + 1e-6) + 1, dtype=np.float64)
    away_m = np.hypot(*(estimated(t_s)[:, :2] - (goal.x_m, goal.y_m)).T)
    if outcome is None:
        near = np.flatnonzero(away_m <= REACHED_M)
        outcome = "succeeded" if near.size else "failed"
        notes.append("no action tells the outcome; it follows from the distance to the goal")
        if near.size and not bag.exported:
            speeds = np.append(np.hypot(*np.diff(estimated(t_s)[:, :2], axis=0).T) / row_s, 0.0)
            still = np.flatnonzero(speeds[near[0] :] <= MOVING_MPS)
            t_s = t_s[: near[0] + int(still[0]) + 1]
    if len(t_s) < 2:
        raise BagError(f"{bag.name}: expected a mission, got one of {ended_s - began_s:.1f} s")
    words = {"succeeded": "", "aborted": "the action was aborted", "timed_out": "the action was canceled"}
    missed = f"the bag ended {away_m[-1]:.2f} m from the goal"
    reason = bag.exported[1] if bag.exported else words.get(outcome, missed)
    at_s = clock.time_s
    within = at_s[(at_s >= began_s) & (at_s <= ended_s)]
    if len(within) > 1 and (gap_s := float(np.diff(within).max())) > GAP_S:
        notes.append(f"no pose for {gap_s:.1f} s; poses between are interpolated")
    truth = truth_of(bag, clock, frames, t_s)
    return Drive(t_s, estimated(t_s), truth, origin, goal, goal_from, outcome, reason, (*bag.notes, *notes))


def _sent(bag: Bag, clock: Clock, begin_s: float, end_s: float) -> tuple[float, float, Outcome | None]:
    """Return when the robot was sent, when its mission ended, and how; None where no action tells it."""
    status = bag.roles["status"]
    if bag.exported:
        ended_s = float(clock.times(bag.roles["truth"])[-1]) if len(bag.roles["truth"]) else end_s
        return begin_s, ended_s, next((each for each in get_args(Outcome) if each == bag.exported[0]), None)
    at_s, codes = clock.arrivals(status.log_s), status.values[:, 0] if len(status) else np.empty(0)
    if len(sent := np.flatnonzero(np.isin(codes, (1, _EXECUTING)))):
        ends = np.flatnonzero((codes >= _SUCCEEDED) & (np.arange(len(codes)) > sent[0]))
        outcomes: dict[int, Outcome] = {_SUCCEEDED: "succeeded", _CANCELED: "timed_out", _ABORTED: "aborted"}
        if ends.size:
            return float(at_s[sent[0]]), float(at_s[ends[0]]), outcomes.get(int(codes[ends[0]]), "failed")
        return float(at_s[sent[0]]), end_s, None
    for role in ("goal", "plan"):
        if len(bag.roles[role]):
            return max(begin_s, float(clock.arrivals(bag.roles[role].log_s)[0])), end_s, None
    odometry = bag.roles["odometry"]
    moving = np.flatnonzero(np.abs(odometry.values[:, 3]) > MOVING_MPS) if len(odometry) else np.empty(0, int)
    return float(clock.times(odometry)[moving[0]]) if moving.size else begin_s, end_s, None


def _goal(bag: Bag, clock: Clock, began_s: float, ended_s: float) -> tuple[Pose, str] | None:
    for role in ("goal", "plan"):
        messages = bag.roles[role]
        at_s = clock.arrivals(messages.log_s)
        # The one that the mission is about: told shortly before it began, or the first after.
        known = np.flatnonzero((at_s >= began_s - 2.0) & (at_s <= ended_s))
        if known.size:
            return _pose(messages.values[known[0]]), f"the first message of {bag.topics[role]}"
    return None


def _estimate_of(
    bag: Bag, clock: Clock, frames: Frames, start: Pose | None
) -> tuple[str, Callable[[NDArray[np.float64]], Poses]]:
    """Return the origin of the robot's estimate on the map, in words, and its poses (N, 3) at times.

    Raises:
        BagError: nothing tells the robot's place on the map.
    """
    bases = [name for base in _BASES for name in frames.names if basename(name) == base and frames.has_moved(name)]
    bases += [name for name in frames.names if name == bag.frames[1]]
    if not bases:
        known = ", ".join(frames.names) or "none"
        raise BagError(f"{bag.name}: expected a frame base_link or base_footprint that moves, got {known}")
    base = max(bases, key=lambda name: basename(frames.up(name)[-1]) == "map")
    chain = frames.up(base)[::-1]
    words = " → ".join(chain)
    if basename(chain[0]) == "map":
        return words, lambda t_s: frames.poses(base, t_s)
    role = next((role for role in ("estimate", "initial") if len(bag.roles[role])), None)
    if role is not None:
        told = bag.roles[role]
        since_s, at_s, on_map = clock.arrivals(told.log_s), clock.times(told), told.values[:, :3]
        words = f"{bag.topics[role]} and {words}"
    elif start is not None:
        since_s = at_s = clock.time_s[:1]
        on_map, words = np.array([[start.x_m, start.y_m, start.yaw_rad]]), f"{words} from --start"
    else:
        what = f"a map frame, /amcl_pose, /initialpose, or --start X,Y,YAW, got frames from {chain[0]} on alone"
        raise BagError(f"{bag.name}: expected {what}")
    roots = joined(on_map, inverse(frames.poses(base, at_s)))
    return words, lambda t_s: joined(held(since_s, roots, t_s), frames.poses(base, t_s))


def truth_of(bag: Bag, clock: Clock, frames: Frames, t_s: NDArray[np.float64]) -> Poses | None:
    """Return the true poses (N, 3) at times; None where the bag has none."""
    named = (name for name in frames.names if _TRUE.fullmatch(basename(name)))
    name = next((name for name in named if basename(frames.up(name)[-1]) in _WORLDS), None)
    told = bag.roles["truth"]
    if name is None or (bag.exported and len(told)):  # an export's transforms end a tick before its run
        return between(clock.times(told), told.values[:, :3], t_s) if len(told) else None
    return frames.poses(name, t_s)


def _pose(values: NDArray[np.float64]) -> Pose:
    x_m, y_m, yaw_rad = values[:3].tolist()
    return Pose(x_m, y_m, float(np.angle(np.exp(1j * yaw_rad))))
