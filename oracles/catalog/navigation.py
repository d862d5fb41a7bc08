"""Oracle `navigation`: the measures that the field compares navigation by, smoothness among them."""

import itertools
import math
from collections.abc import Mapping
from typing import ClassVar, Final

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from vastflow.oracles.catalog.performance import arc_lengths_m
from vastflow.oracles.judgment.oracle import Oracle, Parameters
from vastflow.oracles.judgment.verdict import Verdict
from vastflow.oracles.observation.goals import missed_goals
from vastflow.oracles.observation.situation import Situation
from vastflow.oracles.observation.trace import CLEARANCES, Reference, Trace
from vastflow.sim.model.elementary import hypots
from vastflow.sim.model.pose import Pose, seen_from

MAX_FREQUENCY_HZ: Final = 10.0
AMPLITUDE: Final = 0.05
_PADDING: Final = 4
"""Powers of two of zero padding."""


def spectral_arc_length(
    speed_mps: NDArray[np.float64],
    step_s: float,
    max_frequency_hz: float = MAX_FREQUENCY_HZ,
    amplitude: float = AMPLITUDE,
) -> float | None:
    """Arc length of a speed profile's normalized magnitude spectrum, negative: the nearer to 0, the smoother.

    SPARC = -∫_0^{f_c} sqrt((1 / f_c)² + (dV̂/df)²) df with V̂(f) = |V(f)| / |V(0)|, and f_c the highest frequency up to
    `max_frequency_hz` at which V̂ is at least `amplitude` (Balasubramanian, Melendez-Calderon, Roby-Brami and Burdet, Journal of
    NeuroEngineering and Rehabilitation 12:112, 2015). One bell shaped movement has about -1.4.

    Args:
        speed_mps: (N,) at steps of `step_s`.

    Returns:
        None for fewer than two samples, and for a robot that never moved.
    """
    if len(speed_mps) < 2 or not np.any(speed_mps):
        return None
    n = 1 << ((len(speed_mps) - 1).bit_length() + _PADDING)
    magnitude = np.abs(np.fft.rfft(speed_mps, n))
    frequency_hz = np.fft.rfftfreq(n, step_s)
    magnitude = magnitude / magnitude.max()
    within = np.flatnonzero((frequency_hz <= max_frequency_hz) & (magnitude >= amplitude))
    if within.size < 2:
        return None
    band = slice(within[0], within[-1] + 1)
    frequency_hz, magnitude = frequency_hz[band], magnitude[band]
    steps = np.diff(frequency_hz) / (frequency_hz[-1] - frequency_hz[0])
    # A Fourier transform has its sines from the C library: its last digits are no result.
    return -round(float(np.sum(hypots(steps, np.diff(magnitude)))), 9)


class NavigationParameters(Parameters):
    """Parameters of `navigation`.

    Attributes:
        stop_s: For how long the robot stands, at least, where that is a stop (s).
        near_m: Clearance up to which the robot is near obstacles (m); MRPB's safety distance, which its user sets.
    """

    stop_s: float = Field(default=0.5, ge=0)
    near_m: float = Field(default=0.3, ge=0)


class Navigation(Oracle[NavigationParameters]):
    """Measures only: passes every run, so that joint verdicts do not change.

    l is the length of the reference path (`vastflow.oracles.observation.observe`) and p the true path driven, in m; S is 1 where the mission
    succeeded and missed no goal, else 0.

    Metrics:
    - `spl` (1): S l / max(p, l), whose mean over runs is the success weighted by path length of Anderson et al., "On evaluation of
      embodied navigation agents", arXiv:1807.06757, 2018.
    - `path_efficiency` (1): l / p of a run with S = 1; above 1 by as much as octile length is longer than the path a robot can take.
    - `time_to_goal` (s): simulated, from the run's start until the last goal was reached, with S = 1.
    - `minimum_clearance` (m): from the robot's center to the nearest wall or outline of an obstacle.
    - `smoothness` (1): spectral arc length of the true speed |v| (`vastflow.oracles.catalog.navigation`), negative; one movement has about -1.4
      and each stop and start lowers it.
    - `turning` (rad/m): Σ |Δyaw| / p, the mean absolute curvature of the path, turns on the spot included.
    - `recoveries` (1): of Nav2's behavior tree.
    - `stops` (1): times the robot stood for `stop_s` or more between driving and driving; the waits before the first
      motion and after the last are none. `stopped_time` (s): of all of them.

    - `final_x`, `final_y` (m), and `final_yaw` (rad): the true final pose seen from the last goal, x ahead and y to the left, with S = 1.

    Three more are those of MRPB (Wen et al., "MRPB 1.0: A unified benchmark for the evaluation of mobile robot local planning approaches",
    ICRA 2021), over the rows of the recording, 0.1 s apart, where the benchmark has the calls of the controller:
    - `near_obstacles` (1): its p_o, the share of the time between rows at which the clearance is `near_m` at most at both.
    - `path_smoothness` (m²): its f_ps, Σ |Δx_{i+1} - Δx_i|² of the true positions, which are recorded in whole millimeters.
    - `velocity_smoothness` (m/s²): its f_vs, the mean of |v_{i+1} - v_i| / (t_{i+1} - t_i) of the true speed v.

    One that can't be had has no value: the first two without a reference path, all but the recoveries without rows.
    """

    Parameters = NavigationParameters
    metrics: ClassVar[Mapping[str, str]] = {
        "spl": "1",
        "path_efficiency": "1",
        "time_to_goal": "s",
        "minimum_clearance": "m",
        "smoothness": "1",
        "turning": "rad/m",
        "recoveries": "1",
        "stops": "1",
        "stopped_time": "s",
        "near_obstacles": "1",
        "path_smoothness": "m²",
        "velocity_smoothness": "m/s²",
        "final_x": "m",
        "final_y": "m",
        "final_yaw": "rad",
    }

    def judge(self, trace: Trace, situation: Situation) -> Verdict:
        if "t_s" not in trace.columns:
            return self.passed(trace)
        metrics: dict[str, float | None] = {"recoveries": trace.run.recoveries}
        if not len(trace):
            return self.passed(trace, **metrics)
        arrived = trace.run.outcome == "succeeded" and not missed_goals(trace, situation)
        driven_m = float(arc_lengths_m(trace.xy_m)[-1])
        if isinstance(trace.reference, Reference) and trace.reference.length_m > 0:
            best_m = trace.reference.length_m
            metrics["spl"] = best_m / max(driven_m, best_m) if arrived else 0.0
            metrics["path_efficiency"] = best_m / driven_m if arrived and driven_m > 0 else None
        if arrived and situation.goals:
            reached = trace.events("goal_reached")
            metrics["time_to_goal"] = reached[-1].t_s if reached else trace.run.simulated_s
            if "yaw_rad" in trace.columns:
                end = seen_from(
                    Pose(*(float(trace[name][-1]) for name in ("x_m", "y_m", "yaw_rad"))), situation.goals[-1]
                )
                metrics |= {"final_x": end.x_m, "final_y": end.y_m, "final_yaw": math.remainder(end.yaw_rad, math.tau)}
        steps_s = np.diff(trace["t_s"])
        if clearances_m := [trace[name] for name in _CLEARANCES if name in trace.columns]:
            clearance_m = np.min(clearances_m, axis=0)
            metrics["minimum_clearance"] = float(clearance_m.min()) if np.isfinite(clearance_m.min()) else None
            if steps_s.any():
                near = np.round(clearance_m, 9) <= self.parameters.near_m
                metrics["near_obstacles"] = float(steps_s[near[1:] & near[:-1]].sum() / steps_s.sum())
        if len(trace) > 2:
            bends_m = np.diff(trace.xy_m, n=2, axis=0)
            metrics["path_smoothness"] = float((bends_m * bends_m).sum())
        if "speed_mps" in trace.columns:
            metrics["smoothness"] = _smoothness(trace["t_s"], np.abs(trace["speed_mps"]))
            if steps_s.any():
                metrics["velocity_smoothness"] = float(np.mean(np.abs(np.diff(trace["speed_mps"])) / steps_s))
        if "yaw_rad" in trace.columns and driven_m > 0:
            turned_rad = (np.diff(trace["yaw_rad"]) + np.pi) % (2 * np.pi) - np.pi
            metrics["turning"] = float(np.abs(turned_rad).sum()) / driven_m
        if "stopped" in trace.columns:
            stops_s = stops(trace["t_s"], trace["stopped"] > 0, self.parameters.stop_s)
            metrics |= {"stops": len(stops_s), "stopped_time": round(math.fsum(stops_s), 3)}
        return self.passed(trace, **metrics)


_CLEARANCES = ("wall_clearance_m", *CLEARANCES)


def stops(t_s: NDArray[np.float64], stopped: NDArray[np.bool_], stop_s: float) -> list[float]:
    """Durations (s) of the stops between two motions, from the first to the last standing row of (N,)."""
    moving = np.flatnonzero(~stopped)
    stood_s = [float(t_s[b - 1] - t_s[a + 1]) for a, b in itertools.pairwise(moving) if b > a + 1]
    return [long_s for long_s in stood_s if round(long_s, 6) >= stop_s]


def _smoothness(t_s: NDArray[np.float64], speed_mps: NDArray[np.float64]) -> float | None:
    if len(t_s) < 2:
        return None
    step_s = float(np.median(np.diff(t_s)))
    even_s = np.arange(t_s[0], t_s[-1] + step_s / 2, step_s)
    return spectral_arc_length(np.interp(even_s, t_s, speed_mps), step_s)
