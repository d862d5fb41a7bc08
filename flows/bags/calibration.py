"""Calibration: a robot's noise, dead time, and lag, fitted to its bags with intervals."""

import math
from collections import defaultdict
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np
from numpy.typing import NDArray
from scipy import optimize, signal, stats

from vastflow.flows.bags.bag import Bag, BagError, read_bag
from vastflow.flows.bags.drive import Clock, Frames, clock_of, inverse, joined, truth_of

LEVEL: Final = 0.99
MOST_SCANS: Final = 240
SECTORS: Final = 9
"""Parts of a scan, the median of which corners, pillars, and people in some of them don't move."""
PIECE: Final = 0.25
"""Length of a piece of a drive: m, or rad of a turn."""
STEP_S: Final = 0.01
LONGEST_DEAD_S: Final = 0.6
MODEL_SHARE: Final = 0.02
"""Half-width that is added to the interval of the lidar's noise, for corners and round things taken for walls."""
LEAST: Final = {
    "noise": (20, "scans with straight walls"),
    "dropout": (20, "scans of surfaces"),
    "along": (8, f"straight pieces of {PIECE} m by odometry and a true pose"),
    "turned": (8, f"turns of {PIECE} rad on the spot by odometry and a true pose"),
    "response": (4, "steps of a command that odometry follows"),
}
"""Kind of samples to how many a fit takes."""

Numbers = NDArray[np.float64]
Samples = dict[str, list[tuple[float, ...]]]


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


def calibrate(bags: Sequence[Path], namespace: str = "") -> Calibration:
    """Fit the robot of several bags.

    Raises:
        BagError: a bag that can't be read, or nothing in them that can be fitted.
    """
    samples: Samples = defaultdict(list)
    notes: list[str] = []
    for path in bags:
        bag = read_bag(path, namespace, scans=True)
        clock, clock_notes = clock_of(bag)
        _take_scans(samples, bag)
        _take_response(samples, bag, clock)
        notes += [f"{bag.name}: {note}" for note in (*bag.notes, *clock_notes, *_take_odometry(samples, bag, clock))]
    for kind, (least, what) in LEAST.items():
        if (found := len(samples[kind])) < least:
            notes.append(f"expected at least {least} {what}, got {found}")
            del samples[kind]
    if not any(samples.values()):
        raise BagError(f"nothing to fit ({', '.join(notes)})")
    return Calibration((*_lidar(samples), *_odometry(samples), *_response(samples)), tuple(notes))


def mean_interval(values: Numbers) -> tuple[float, float, float]:
    """Mean of independent pieces with its t interval."""
    half = float(stats.t.ppf((1 + LEVEL) / 2, len(values) - 1) * values.std(ddof=1) / math.sqrt(len(values)))
    return float(values.mean()), float(values.mean()) - half, float(values.mean()) + half


def deviation_interval(squares: Numbers) -> tuple[float, float, float]:
    """Root of the mean of squares with its chi-squared interval, which heavy tails widen.

    Of n pieces with kurtosis k the variance of the mean square is (k - 1) / n of its square, as with 2 n / (k - 1) degrees of freedom.
    """
    mean = float(squares.mean())
    if not mean > 0.0:
        return 0.0, 0.0, 0.0
    kurtosis = max(3.0, float(np.mean(squares * squares)) / (mean * mean))
    freedom = (len(squares) - 1) * 2.0 / (kurtosis - 1.0)
    low, high = (freedom * mean / float(stats.chi2.ppf(at, freedom)) for at in ((1 + LEVEL) / 2, (1 - LEVEL) / 2))
    return math.sqrt(mean), math.sqrt(low), math.sqrt(high)


def _take_scans(samples: Samples, bag: Bag) -> None:
    shape = bag.scan
    if shape is None:
        return
    for row in np.unique(np.linspace(0, len(bag.ranges_m) - 1, MOST_SCANS).astype(int)):
        measured = bag.ranges_m[row].astype(np.float64)
        measured[~((measured > max(0.0, shape.range_min_m)) & (measured < shape.range_max_m))] = np.nan
        noise = _noise(measured, shape.angle_increment_rad)
        if len(noise) >= 20:
            sectors = np.array_split(noise, min(SECTORS, max(1, len(noise) // 30)))
            samples["noise"].append((float(np.median([_scale(each) for each in sectors])),))
        before, after = measured[:-2], measured[2:]
        lost = np.isnan(measured[1:-1])[np.abs(before - after) < 0.1 * np.minimum(before, after)]
        if len(lost) >= 20:
            samples["dropout"].append((float(lost.mean()), len(lost)))


def _noise(measured: Numbers, step_rad: float) -> Numbers:
    """Differences of ranges from the straight wall through both neighbors, scaled to the deviation of one range.

    On a straight line 1/r is a sinusoid of the bearing, so that r = 2 cos(step) / (1/before + 1/after) exactly, whatever the pose.
    """
    before, here, after = measured[:-2], measured[1:-1], measured[2:]
    wall = 2.0 * math.cos(step_rad) / (1.0 / before + 1.0 / after)
    weights = [wall * wall / (2.0 * math.cos(step_rad) * each * each) for each in (before, after)]
    found = (here - wall) / np.sqrt(1.0 + weights[0] ** 2 + weights[1] ** 2)
    return np.asarray(found[np.isfinite(found) & (np.abs(before - after) < 0.1 * here + 0.1)])


def _scale(values: Numbers) -> float:
    """Standard deviation of normal values among few others: of those within three deviations by the median."""
    scale = 1.4826 * float(np.median(np.abs(values)))
    within = values[np.abs(values) <= 3.0 * scale]
    return float(np.sqrt(np.mean(within * within))) / 0.98658


def _take_odometry(samples: Samples, bag: Bag, clock: Clock) -> Sequence[str]:
    at_s, first = np.unique(clock.times(bag.roles["odometry"]), return_index=True)
    true = truth_of(bag, clock, Frames(bag, clock), at_s) if len(at_s) > 1 else None
    if true is None:
        return [
            "no true pose: the estimate follows odometry between its updates, so that odometry's noise can't be told from it"
        ]
    steps = [np.hypot(*np.diff(true[:, :2], axis=0).T), np.abs(np.diff(np.unwrap(true[:, 2])))]
    gone_m, turned_rad = (np.append(0.0, np.cumsum(each)) for each in steps)
    rows = np.unique(np.floor((gone_m + turned_rad) / PIECE), return_index=True)[1]
    gone = np.diff([gone_m[rows], turned_rad[rows]])
    off = _moves(bag.roles["odometry"].values[first][rows, :3]) - _moves(true[rows])
    for kind, is_kind, length in (
        ("along", gone[1] < 0.1 * gone[0], gone[0]),
        ("turned", gone[0] < 0.02 * gone[1], gone[1]),
    ):
        samples[kind] += zip(length[is_kind].tolist(), *off[:, is_kind].tolist(), strict=True)
    return []


def _moves(poses: Numbers) -> Numbers:
    """Distances ahead and turns (2, N - 1) from one pose to the next."""
    x, y, turn = joined(inverse(poses[:-1]), poses[1:]).T
    turn = (turn + np.pi) % (2.0 * np.pi) - np.pi
    return np.array([x * np.cos(turn / 2.0) + y * np.sin(turn / 2.0), turn])


def _take_response(samples: Samples, bag: Bag, clock: Clock) -> None:
    """Fit dead time and lag to the response to each step of a command, by the log's time."""
    command, odometry = bag.roles["command"], bag.roles["odometry"]
    at_s, first = np.unique(clock.arrivals(odometry.log_s), return_index=True)
    since_s = clock.arrivals(command.log_s)
    for column in (0, 1) if len(command) > 1 and len(at_s) > 1 else ():
        spoken, speed = command.values[:, column], odometry.values[first, 3 + column]
        last_s = float(at_s[0]) - 0.8
        for begin_s in since_s[1:][np.abs(np.diff(spoken)) > 0.1].tolist():
            if last_s + 1.0 <= begin_s <= at_s[-1] - 1.2:
                last_s = begin_s
                if (found := _fit(begin_s, since_s, spoken, at_s, speed)) is not None:
                    samples["response"].append((*found, float(np.median(np.diff(at_s)))))


def _fit(
    begin_s: float, since_s: Numbers, spoken: Numbers, at_s: Numbers, speed: Numbers
) -> tuple[float, float] | None:
    """Return dead time and lag (s) that explain the 1.2 s after a step; None where they don't."""
    times = begin_s + STEP_S * np.arange(-220, 120)
    target, counted = np.interp(times, at_s, speed), slice(200, None)

    def off(parameters: Numbers) -> float:
        dead_s, lag_s = np.abs(parameters)
        row = np.searchsorted(since_s, times - dead_s, side="right") - 1
        # The share of a step of the grid that a command holds already, so that the error is continuous in the dead time.
        share = np.clip((times - dead_s - since_s[np.maximum(row, 0)]) / STEP_S, 0.0, 1.0)
        held, before = spoken[np.maximum(row, 0)], spoken[np.maximum(row - 1, 0)]
        gain = 1.0 - math.exp(-STEP_S / max(lag_s, 1e-4))
        driven = before + share * (held - before)
        said, _ = signal.lfilter([gain], [1.0, gain - 1.0], driven, zi=[(1.0 - gain) * target[0]])
        return float(((said - target)[counted] ** 2).sum())

    grid = slice(0.0, LONGEST_DEAD_S, 0.03), slice(0.01, 0.42, 0.1)
    best, least, *_ = optimize.brute(off, grid, full_output=True)
    dead_s, lag_s = np.abs(best).tolist()
    explained = 1.0 - least / max(float(((target - target.mean())[counted] ** 2).sum()), 1e-12)
    return (dead_s, lag_s) if explained > 0.9 and dead_s < LONGEST_DEAD_S else None


def _lidar(samples: Samples) -> Iterator[Fitted]:
    group, scans = "lidar.noise.laserscan", "scans, by the straight walls in them"
    if samples["noise"]:
        mean, low, high = mean_interval(np.array(samples["noise"])[:, 0])
        low, high = max(0.0, low - MODEL_SHARE * mean), high + MODEL_SHARE * mean
        n = len(samples["noise"])
        yield Fitted("lidar noise", f"{group}_gaussian_noise_std_deviation", mean, low, high, "m", n, scans)
    if samples["dropout"]:
        shares, beams = np.array(samples["dropout"]).T
        mean, low, high = mean_interval(shares)
        high -= math.log((1 - LEVEL) / 2) / beams.sum()  # where no beam was lost
        n = len(shares)
        yield Fitted("lidar dropout", f"{group}_random_drop_percentage", mean, max(0.0, low), high, "share", n, scans)


def _odometry(samples: Samples) -> Iterator[Fitted]:
    for kind, words, per in (("along", "straight pieces", "meter"), ("turned", "turns", "radian")):
        if not samples[kind]:
            continue
        gone, *offs = np.array(samples[kind]).T
        for name, unit, off in zip(("translation", "rotation"), ("m", "rad"), offs, strict=True):
            # The scale is a constant and no noise: the deviation is that of what it leaves.
            left = off - float((off * gone).sum() / (gone * gone).sum()) * gone
            found = deviation_interval(left**2 / gone * len(off) / (len(off) - 1))
            yield Fitted(f"odometry {name} per {per}", f"odometry.{name}_std_per_{per}", *found, unit, len(off), words)
        scale = mean_interval(offs[kind == "turned"] / gone)
        yield Fitted(f"odometry scale of {words}", "", *scale, "share", len(gone), "no key: a constant share")


def _response(samples: Samples) -> Iterator[Fitted]:
    if not samples["response"]:
        return
    dead_s, lag_s, periods_s = np.array(samples["response"]).T
    sampled_s = float(periods_s.mean()) / 2.0  # nothing is known between two messages
    held_up = "latency.controller_time delays commands, but holds the controller up too"
    for name, values, why in (
        ("dead time of commands", dead_s, held_up),
        ("actuator lag", lag_s, "the simulator's wheels follow within max_acceleration"),
    ):
        mean, low, high = mean_interval(values)
        low, high = max(0.0, low - sampled_s), high + sampled_s
        yield Fitted(name, "", mean, low, high, "s", len(values), f"no key; {why}")


def section_of(calibration: Calibration) -> str:
    """Return the section `robot:` of a family in a campaign file; what it has no key for is a comment."""
    lines, comments, last = ["robot:"], [f"# {note}" for note in calibration.notes], [""]
    for each in calibration.fitted:
        told = f"{each.unit}, 99 % [{each.low:.4g}, {each.high:.4g}], {each.n} {each.origin if each.key else 'pieces'}"
        *group, key = each.key.split(".")
        if not key:
            comments.append(f"# {each.name}: {each.value:.4g} {told}: {each.origin}")
            continue
        if group != last:
            lines += [f"{'  ' * depth}{name}:" for depth, name in enumerate(group, 1)]
        lines.append(f"{'  ' * len(group)}  {key}: {each.value:.4g}  # {told}")
        last = group
    return "\n".join([*(lines if len(lines) > 1 else []), *comments])
