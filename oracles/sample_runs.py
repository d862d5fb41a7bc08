"""Sample runs: small traces of every kind, for tests of oracles."""

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from vastflow.oracles.obstacle_tracks import obstacle_tracks_of
from vastflow.oracles.situation import Situation
from vastflow.oracles.trace import MaybeReference, NoReference, Reference, Trace
from vastflow.sim.model.obstacle import Obstacle, Trigger
from vastflow.sim.model.pose import Pose
from vastflow.sim.model.recording import Event, Outcome, Run

STEP_S: Final = 0.1
_START, _GOAL = Pose(0.0, 0.0), Pose(5.0, 0.0)
_PALLET = Obstacle("pallet", "box", Pose(2.0, 1.5), 0.8, 0.8)
_DRUM = Obstacle("drum", "cylinder", Pose(4.0, -1.0), 0.5, 0.5)
_CARTON = Obstacle("carton", "box", Pose(3.5, 0.0), 0.5, 0.5, Trigger(3.5, 0.0, 1.0))


@dataclass(frozen=True)
class SampleRun:
    """A run to judge.

    Attributes:
        name: What is particular about it.
    """

    name: str
    trace: Trace = field(repr=False)
    situation: Situation = field(repr=False)


def sample_runs() -> tuple[SampleRun, ...]:
    """A robot that drives 5 m along x in a corridor of 4 m at 0.5 m/s, and what may be otherwise."""
    drive = np.minimum(0.05 * np.arange(101), 5.0)
    stop = np.minimum(drive, 2.6)
    appears = Event(5.0, "spawned", 3.5, 0.0, "carton")
    touches = (Event(6.0, "contact", 3.0, 0.0, "carton", 0.4), Event(6.1, "obstacle_moved", 3.6, 0.0, "carton", 0.2))
    both = (_PALLET, _DRUM)
    return (
        _sample("an empty corridor", drive),
        _sample("two obstacles", drive, both),
        _sample("an obstacle that appears late", stop, (*both, _CARTON), events=(appears,), outcome="timed_out"),
        _sample("an obstacle that is run into", drive, (_CARTON,), events=(appears, *touches)),
        _sample("an obstacle that never appears", drive, (_CARTON,)),
        _sample("a robot that never moves", 0 * drive, both, outcome="aborted"),
        _sample("a robot that never knows where it is", drive, localized=False),
        _sample("no reference path", drive, reference=NoReference("the scenario has no map")),
        _sample("a single row", drive[:1], both),
        _sample("no rows", drive[:0], (*both, _CARTON), outcome="failed"),
        SampleRun("no robot", Trace(_run("succeeded", 3.0, 0.0), {}, NoReference("no robot")), Situation(None, (), ())),
    )


def _sample(
    name: str,
    x_m: NDArray[np.float64],
    obstacles: tuple[Obstacle, ...] = (),
    *,
    events: tuple[Event, ...] = (),
    outcome: Outcome = "succeeded",
    localized: bool = True,
    reference: MaybeReference | None = None,
) -> SampleRun:
    situation = Situation(_START, (_GOAL,), obstacles)
    run = _run(outcome, len(x_m) * STEP_S, float(x_m[-1] - x_m[0]) if len(x_m) else 0.0, events)
    columns = {**_driven(x_m, localized), **_apart(x_m, situation, run)}
    straight = Reference(np.array([[0.0, 0.0], [5.0, 0.0]]), 5.0)
    found = straight if reference is None else reference
    if isinstance(found, Reference):
        columns["deviation_m"] = 0 * x_m
    return SampleRun(name, Trace(run, columns, found), situation)


def _driven(x_m: NDArray[np.float64], localized: bool) -> dict[str, NDArray[np.float64]]:
    none = np.zeros(len(x_m))
    speed = np.diff(x_m, append=x_m[-1:]) / STEP_S
    error = 0.02 + 0.01 * np.sin(np.arange(len(x_m)))
    names = ("y_m", "yaw_rad", "estimated_yaw_rad", "yaw_rate_radps", "command_yaw_rate_radps", "sent_yaw_rate_radps")
    covariances = ("covariance_xx_m2", "covariance_xy_m2", "covariance_yy_m2", "covariance_yaw_rad2")
    return {
        "t_s": np.arange(len(x_m)) * STEP_S,
        "x_m": x_m,
        "estimated_x_m": x_m + error,
        "estimated_y_m": none,
        **{name: none.copy() for name in (*names, *covariances)},
        **{name: speed.copy() for name in ("speed_mps", "command_speed_mps", "sent_speed_mps")},
        "localized": (np.arange(len(x_m)) % 5 == 0) * float(localized),
        "localization_error_m": error,
        "stopped": (speed == 0).astype(np.float64),
        "wall_clearance_m": none + 2.0,
    }


def _apart(x_m: NDArray[np.float64], situation: Situation, run: Run) -> dict[str, NDArray[np.float64]]:
    xy_m = np.column_stack((x_m, 0 * x_m))
    t_ms = np.rint(np.arange(len(x_m)) * STEP_S * 1000).astype(np.int32)
    apart_m: dict[str, NDArray[np.float64]] = {}
    for each in obstacle_tracks_of(situation, run):
        kind = "appearing" if each.obstacle.trigger else "static"
        for name, distance_m in (
            (f"{kind}_clearance_m", each.clearance_m(t_ms, xy_m)),
            (f"separation_m/{each.obstacle.size_class}", np.hypot(*(xy_m - each.at(t_ms)).T)),
        ):
            apart_m[name] = np.minimum(apart_m.get(name, np.full(len(x_m), math.inf)), distance_m)
    return apart_m


def _run(outcome: Outcome, simulated_s: float, distance_m: float, events: tuple[Event, ...] = ()) -> Run:
    reason = "" if outcome == "succeeded" else "as the sample wants it"
    fields: Mapping[str, Any] = {"run_index": 3, "seed": "0", "error_code": 0, "recoveries": 0, "missed_goals": 0}
    return Run(outcome=outcome, reason=reason, simulated_s=simulated_s, distance_m=distance_m, events=events, **fields)
