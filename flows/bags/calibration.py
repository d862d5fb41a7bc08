"""Calibration: a robot's noise, dead time, and lag, fitted to its bags with intervals."""

import itertools
import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np
from numpy.typing import NDArray
from scipy import optimize, signal, stats

from vastflow.flows.bags.bag import Bag, BagError, read_bag
from vastflow.flows.bags.drive import Clock, Frames, clock_of, joined, origin_of, truth_of
from vastflow.sim.world.lidar import scan
from vastflow.sim.world.occupancy import OccupancyMap
from vastflow.sim.world.skip_table import skip_table_of

LEVEL: Final = 0.99
MOST_SCANS: Final = 240
GATE_M: Final = 0.3
"""Difference of a range from the map's beyond which the beam met something else."""
SURFACE: Final = 0.02
"""Relative difference from a straight wall up to which neighboring beams meet one surface."""
PIECE_M: Final = 0.25
PIECE_RAD: Final = 0.25
STEP_S: Final = 0.01
LONGEST_DEAD_S: Final = 0.6
MODEL_SHARE: Final = 0.02
"""Half-width that is added to the interval of the lidar's noise, for corners and round things taken for walls."""

Numbers = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class Fitted:
    """A quantity with its 99 % interval.

    Attributes:
        key: Key below `robot`; empty where the simulator has none.
        n: Number of independent pieces behind it.
        origin: Data that it is from, or the reason why there is no key.
    """

    name: str
    key: str
    value: float
    low: float
    high: float
    unit: str
    n: int
    origin: str


@dataclass(frozen=True)
class Calibration:
    """The fitted quantities of several bags, and what could not be fitted, one line each."""

    fitted: tuple[Fitted, ...]
    notes: tuple[str, ...]


@dataclass
class _Samples:
    """Estimates of the pieces of all bags."""

    noise_m: list[float]
    dropout: list[float]
    along: list[tuple[float, float, float]]  # distance, its error, error of the yaw
    turned: list[tuple[float, float, float]]  # turn, error of the distance, error of the yaw
    response: list[tuple[float, float, float]]  # dead time, lag, period of odometry


def calibrate(
    bags: Sequence[Path],
    ground: OccupancyMap | None,
    namespace: str = "",
    mount: tuple[float, float, float] | None = None,
) -> Calibration:
    """Fit the robot of several bags.

    Args:
        ground: The map that the robot had; None to compare beams with their neighbors alone.
        mount: Pose of the lidar on the robot (m, m, rad), for bags without that transform.

    Raises:
        BagError: a bag that can't be read, or nothing in them that can be fitted.
    """
    samples, notes = _Samples([], [], [], [], []), []
    for path in bags:
        bag = read_bag(path, namespace, scans=True)
        clock, clock_notes = clock_of(bag)
        frames = Frames(bag, clock)
        notes += [f"{bag.name}: {note}" for note in (*bag.notes, *clock_notes)]
        notes += [f"{bag.name}: {note}" for note in _take_scans(samples, bag, clock, frames, ground, mount)]
        notes += [f"{bag.name}: {note}" for note in _take_odometry(samples, bag, clock, frames)]
        notes += [f"{bag.name}: {note}" for note in _take_response(samples, bag, clock)]
    fitted = [*_lidar(samples), *_odometry(samples), *_response(samples)]
    if not fitted:
        raise BagError(f"expected scans, a true pose, or commands with odometry, got none ({', '.join(notes)})")
    return Calibration(tuple(fitted), tuple(notes))


def mean_interval(values: Sequence[float]) -> tuple[float, float, float]:
    """Mean of independent pieces with its t interval."""
    found = np.asarray(values, dtype=np.float64)
    half = float(stats.t.ppf((1 + LEVEL) / 2, len(found) - 1) * found.std(ddof=1) / math.sqrt(len(found)))
    mean = float(found.mean())
    return mean, mean - half, mean + half


def deviation_interval(squares: Sequence[float]) -> tuple[float, float, float]:
    """Root of the mean of squares with its chi-squared interval, which heavy tails widen.

    Of n pieces with kurtosis k the variance of the mean square is (k - 1) / n of its square, as with 2 n / (k - 1) degrees of freedom.
    """
    found = np.asarray(squares, dtype=np.float64)
    mean = float(found.mean())
    if not mean > 0.0:
        return 0.0, 0.0, 0.0
    kurtosis = max(3.0, float(np.mean(found * found)) / (mean * mean))
    freedom = (len(found) - 1) * 2.0 / (kurtosis - 1.0)
    low, high = (freedom * mean / float(stats.chi2.ppf(at, freedom)) for at in ((1 + LEVEL) / 2, (1 - LEVEL) / 2))
    return math.sqrt(mean), math.sqrt(low), math.sqrt(high)


def _take_scans(
    samples: _Samples,
    bag: Bag,
    clock: Clock,
    frames: Frames,
    ground: OccupancyMap | None,
    mount: tuple[float, float, float] | None,
) -> Iterator[str]:
    shape, ranges = bag.scan, bag.ranges_m
    if shape is None or len(ranges) < 2:
        yield "no scans"
        return
    rows = np.unique(np.linspace(0, len(ranges) - 1, MOST_SCANS).astype(int))
    due: NDArray[np.float64] | None = None
    if ground is not None:
        due = _due(bag, clock, frames, ground, mount, rows)
        if due is None:
            yield f"no transform from the base to {shape.frame}, nor --lidar X,Y,YAW: scans are compared with themselves"
    for number, row in enumerate(rows):
        measured = ranges[row].astype(np.float64)
        returned = np.isfinite(measured) & (measured > shape.range_min_m) & (measured < shape.range_max_m)
        expected = None if due is None else due[number]
        noise = _noise(np.where(returned, measured, np.nan), shape.angle_increment_rad, expected)
        if len(noise) >= 20:
            samples.noise_m.append(_scale(noise))
        is_due = _is_due(measured, returned, expected)
        if is_due.sum() >= 20:
            samples.dropout.append(float((~returned)[is_due].mean()))


def _due(
    bag: Bag,
    clock: Clock,
    frames: Frames,
    ground: OccupancyMap,
    mount: tuple[float, float, float] | None,
    rows: NDArray[np.int64],
) -> Numbers | None:
    """Return the map's ranges (N, B) for scans; None if the lidar's place is not known."""
    shape = bag.scan
    assert shape is not None
    found = origin_of(bag, clock, frames, None)
    t_s = clock.times(bag.roles["scan"])[rows]
    truth = truth_of(bag, clock, frames, t_s)
    poses = found.at(t_s) if truth is None else truth
    if mount is None:
        chain = frames.up(shape.frame)
        if found.base not in chain:
            return None
        mount = tuple(frames.poses(shape.frame, t_s[:1], chain.index(found.base))[0].tolist())
    upright, frame = ground.upright, ground.frame
    skips = skip_table_of(upright.occupied)
    bearings = mount[2] + shape.angle_min_rad + shape.angle_increment_rad * np.arange(bag.ranges_m.shape[1])
    directions = np.column_stack((np.cos(bearings), np.sin(bearings)))
    if shape.angle_increment_rad < 0:
        directions = directions[::-1].copy()
    due = np.empty((len(rows), len(bearings)))
    sensors = joined(poses, np.array([*mount[:2], 0.0]))
    sensors[:, :2] = frame.points_to_grid(sensors[:, :2])
    sensors[:, 2] -= frame.yaw_rad
    nothing = np.empty((0, 7))
    for k, sensor in enumerate(sensors):
        place = upright.resolution_m, *upright.origin_xy_m
        scan(skips, *place, nothing, sensor, directions, shape.range_min_m, shape.range_max_m, due[k])
    return due[:, ::-1] if shape.angle_increment_rad < 0 else due


def _noise(measured: Numbers, step_rad: float, expected: Numbers | None) -> Numbers:
    """Differences of ranges from the straight wall through both neighbors, scaled to the deviation of one range.

    On a straight line 1/r is a sinusoid of the bearing, so that r = 2 cos(step) / (1/before + 1/after) exactly, whatever the pose. Where the
    map is known, only triples count that it has on a straight wall, and whose ranges are near its own.
    """
    before, here, after = measured[:-2], measured[1:-1], measured[2:]
    with np.errstate(invalid="ignore", divide="ignore"):
        wall = 2.0 * math.cos(step_rad) / (1.0 / before + 1.0 / after)
        weights = [wall * wall / (2.0 * math.cos(step_rad) * each * each) for each in (before, after)]
        found = (here - wall) / np.sqrt(1.0 + weights[0] ** 2 + weights[1] ** 2)
        good = np.isfinite(found) & (np.abs(before - after) < 0.1 * here + 0.1)
        if expected is not None:
            a, b, c = expected[:-2], expected[1:-1], expected[2:]
            straight = 2.0 * math.cos(step_rad) / (1.0 / a + 1.0 / c)
            good &= np.abs(b - straight) < SURFACE * b
            good &= np.abs(here - b) < GATE_M
    return np.asarray(found[good])


def _scale(values: Numbers) -> float:
    """Standard deviation of normal values among few others: of those within three deviations by the median."""
    scale = 1.4826 * float(np.median(np.abs(values)))
    within = values[np.abs(values) <= 3.0 * scale]
    return float(np.sqrt(np.mean(within * within))) / 0.98658 if scale > 0.0 else 0.0


def _is_due(measured: Numbers, returned: NDArray[np.bool_], expected: Numbers | None) -> NDArray[np.bool_]:
    """Whether a beam (B,) meets something: by the map, else where both neighbors meet one surface."""
    if expected is not None:
        sides = np.stack([np.roll(expected, 1), expected, np.roll(expected, -1)])
        return np.asarray(np.isfinite(sides).all(axis=0))
    near, far = np.roll(measured, 1), np.roll(measured, -1)
    with np.errstate(invalid="ignore"):
        alike = np.abs(near - far) < 0.1 * np.minimum(near, far)
    return np.asarray(np.roll(returned, 1) & np.roll(returned, -1) & alike)


def _take_odometry(samples: _Samples, bag: Bag, clock: Clock, frames: Frames) -> Iterator[str]:
    odometry = bag.roles["odometry"]
    if len(odometry) < 10:
        yield "no odometry"
        return
    at_s, first = np.unique(clock.times(odometry), return_index=True)
    counted = odometry.values[first, :3]
    true = truth_of(bag, clock, frames, at_s)
    if true is None:
        yield "no true pose: the estimate follows odometry between its updates, so that odometry's noise can't be told from it"
        return
    rows = [0]
    steps_m = np.hypot(*np.diff(true[:, :2], axis=0).T)
    turns_rad = np.diff(np.unwrap(true[:, 2]))
    gone_m, turned_rad = np.append(0.0, np.cumsum(steps_m)), np.append(0.0, np.cumsum(np.abs(turns_rad)))
    for k in range(1, len(at_s)):
        if gone_m[k] - gone_m[rows[-1]] >= PIECE_M or turned_rad[k] - turned_rad[rows[-1]] >= PIECE_RAD:
            rows.append(k)
    for a, b in itertools.pairwise(rows):
        ahead_m, turn_rad = float(gone_m[b] - gone_m[a]), float(turned_rad[b] - turned_rad[a])
        moves = [_moved(poses[a], poses[b]) for poses in (true, counted)]
        off_m, off_rad = moves[1][0] - moves[0][0], moves[1][1] - moves[0][1]
        if turn_rad < 0.1 * ahead_m:
            samples.along.append((ahead_m, off_m, off_rad))
        elif ahead_m < 0.02 * turn_rad:
            samples.turned.append((turn_rad, off_m, off_rad))


def _moved(a: Numbers, b: Numbers) -> tuple[float, float]:
    """Distance ahead and turn from one pose to another."""
    middle = a[2] + (turn := (b[2] - a[2] + math.pi) % (2.0 * math.pi) - math.pi) / 2.0
    return float((b[0] - a[0]) * math.cos(middle) + (b[1] - a[1]) * math.sin(middle)), float(turn)


def _take_response(samples: _Samples, bag: Bag, clock: Clock) -> Iterator[str]:
    """Fit dead time and lag to the response to each step of a command, by the log's time."""
    command, odometry = bag.roles["command"], bag.roles["odometry"]
    if len(command) < 10 or len(odometry) < 10:
        yield "no commands beside odometry: no dead time, no lag"
        return
    at_s, first = np.unique(clock.arrivals(odometry), return_index=True)
    t_s = np.arange(at_s[0], at_s[-1], STEP_S)
    since_s = clock.arrivals(command)
    taken = 0
    for column in (0, 1):
        spoken = command.values[:, column]
        speed = np.interp(t_s, at_s, odometry.values[first, 3 + column])
        changes = since_s[1:][np.abs(np.diff(spoken)) > 0.1]
        for begin_s in _apart(changes, 1.0):
            window = (t_s >= begin_s - 0.2) & (t_s <= begin_s + 1.2)
            if window.sum() < 100:
                continue
            found = _fit(t_s, window, since_s, spoken, speed)
            if found is not None:
                samples.response.append((*found, float(np.median(np.diff(at_s)))))
                taken += 1
    if taken < 4:
        yield f"{taken} steps of commands: expected at least 4 for dead time and lag"


def _apart(moments_s: Numbers, least_s: float) -> Iterator[float]:
    last = -math.inf
    for moment in moments_s.tolist():
        if moment - last >= least_s:
            last = moment
            yield moment


def _fit(
    t_s: Numbers, window: NDArray[np.bool_], since_s: Numbers, spoken: Numbers, speed: Numbers
) -> tuple[float, float] | None:
    begin = max(0, int(np.flatnonzero(window)[0]) - 200)
    part = slice(begin, int(np.flatnonzero(window)[-1]) + 1)
    times, target, counted = t_s[part], speed[part], window[part]

    def off(parameters: Numbers) -> Numbers:
        dead_s, lag_s = parameters
        row = np.searchsorted(since_s, times - dead_s, side="right") - 1
        # The share of a step of the grid that a command holds already, so that the error is continuous in the dead time.
        share = np.clip((times - dead_s - since_s[np.maximum(row, 0)]) / STEP_S, 0.0, 1.0)
        held, before = spoken[np.maximum(row, 0)], spoken[np.maximum(row - 1, 0)]
        driven = before + share * (held - before)
        gain = 1.0 - math.exp(-STEP_S / max(lag_s, 1e-4))
        said, _ = signal.lfilter([gain], [1.0, gain - 1.0], driven, zi=[(1.0 - gain) * target[0]])
        return np.asarray((said - target)[counted])

    grid = [(d, lag) for d in np.arange(0.0, LONGEST_DEAD_S, 0.03) for lag in (0.01, 0.05, 0.1, 0.2, 0.4)]
    start = min(grid, key=lambda each: float((off(np.array(each)) ** 2).sum()))
    best = optimize.minimize(lambda x: float((off(np.abs(x)) ** 2).sum()), start, method="Nelder-Mead")
    dead_s, lag_s = np.abs(best.x).tolist()
    explained = 1.0 - best.fun / max(float(((target - target.mean())[counted] ** 2).sum()), 1e-12)
    return (dead_s, lag_s) if explained > 0.9 and dead_s < LONGEST_DEAD_S else None


def _lidar(samples: _Samples) -> Iterator[Fitted]:
    scans = "scans, by the straight walls in them"
    for name, key, values, unit in (
        ("lidar noise", "lidar.noise.laserscan_gaussian_noise_std_deviation", samples.noise_m, "m"),
        ("lidar dropout", "lidar.noise.laserscan_random_drop_percentage", samples.dropout, "share"),
    ):
        if len(values) >= 2:
            mean, low, high = mean_interval(values)
            more = MODEL_SHARE * mean if unit == "m" else 0.0
            yield Fitted(name, key, mean, max(0.0, low - more), high + more, unit, len(values), scans)


def _odometry(samples: _Samples) -> Iterator[Fitted]:
    for pieces, kind, per in ((samples.along, "straight pieces", "meter"), (samples.turned, "turns", "radian")):
        if len(pieces) < 8:
            continue
        gone, off_m, off_rad = np.array(pieces).T
        for name, unit, off in (("translation", "m", off_m), ("rotation", "rad", off_rad)):
            # The scale is a constant and no noise: the deviation is that of what it leaves.
            share = float((off * gone).sum() / (gone * gone).sum())
            squares = (off - share * gone) ** 2 / gone * len(off) / (len(off) - 1)
            found = deviation_interval(squares.tolist())
            key = f"odometry.{name}_std_per_{per}"
            yield Fitted(f"odometry {name} per {per}", key, *found, unit, len(off), kind)
            if (name, per) in (("translation", "meter"), ("rotation", "radian")):
                scale = mean_interval((off / gone).tolist())
                yield Fitted(f"odometry scale of {kind}", "", *scale, "share", len(off), "no key: a constant share")


def _response(samples: _Samples) -> Iterator[Fitted]:
    if len(samples.response) < 4:
        return
    dead_s, lag_s, periods_s = np.array(samples.response).T
    sampled_s = float(periods_s.mean()) / 2.0  # nothing is known between two messages
    for name, values, why in (
        (
            "dead time of commands",
            dead_s,
            "no key; latency.controller_time delays commands, but holds the controller up too",
        ),
        ("actuator lag", lag_s, "no key; the simulator's wheels follow within max_acceleration"),
    ):
        mean, low, high = mean_interval(values.tolist())
        yield Fitted(name, "", mean, max(0.0, low - sampled_s), high + sampled_s, "s", len(values), why)


def section_of(calibration: Calibration) -> str:
    """Return the section `robot:` of a family in a campaign file; what it has no key for is a comment."""
    comments = [f"# {note}" for note in calibration.notes]
    tree: dict[str, list[str]] = {}
    for each in calibration.fitted:
        told = f"{each.unit}, 99 % [{each.low:.4g}, {each.high:.4g}], {each.n} {each.origin if each.key else 'pieces'}"
        if each.key:
            group, _, key = each.key.rpartition(".")
            tree.setdefault(group, []).append(f"{key}: {each.value:.4g}  # {told}")
        else:
            comments.append(f"# {each.name}: {each.value:.4g} {told}: {each.origin}")
    lines = ["robot:"] if tree else []
    for group, rows in tree.items():
        depth = group.split(".")
        lines += [f"{'  ' * (k + 1)}{name}:" for k, name in enumerate(depth)]
        lines += [f"{'  ' * (len(depth) + 1)}{row}" for row in rows]
    return "\n".join([*lines, *comments])
