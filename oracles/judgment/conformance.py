"""Conformance checks for oracles, to be called in an author's tests, and the sample runs they judge."""

import math
import pickle
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, Final, get_args

import numpy as np
from numpy.typing import NDArray

from vastflow.oracles.judgment.oracle import Oracle, Parameters
from vastflow.oracles.judgment.verdict import Judgment, Verdict, read_verdicts, write_verdicts
from vastflow.oracles.observation.observe import distances_to
from vastflow.oracles.observation.obstacle_tracks import obstacle_tracks_of
from vastflow.oracles.observation.situation import Situation
from vastflow.oracles.observation.trace import MaybeReference, NoReference, Reference, Trace, signals_of
from vastflow.sim.model.obstacle import Obstacle, Trigger
from vastflow.sim.model.pose import Pose
from vastflow.sim.model.recording import Event, Outcome, Run
from vastflow.sim.model.shape import Box, Disc
from vastflow.sim.plug_ins.conformance import must, watched_generators

STEP_S: Final = 0.1
_START, _GOAL = Pose(0.0, 0.0), Pose(5.0, 0.0)
_PALLET = Obstacle("pallet", Box(0.8, 0.8), Pose(2.0, 1.5))
_DRUM = Obstacle("drum", Disc(0.25), Pose(4.0, -1.0))
_CARTON = Obstacle("carton", Box(0.5, 0.5), Pose(3.5, 0.0), Trigger(3.5, 0.0, 1.0))


@dataclass(frozen=True)
class SampleRun:
    """A run to judge, named by its particularity."""

    name: str
    trace: Trace = field(repr=False)
    situation: Situation = field(repr=False)


def sample_runs() -> tuple[SampleRun, ...]:
    """Sample runs of a robot that drives 5 m along a corridor at 0.5 m/s, and variations."""
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
    t_ms = np.rint(np.arange(len(x_m)) * STEP_S * 1000).astype(np.int32)
    apart = distances_to(obstacle_tracks_of(situation, run), t_ms, np.column_stack((x_m, 0 * x_m)))
    columns = {**_driven(x_m, localized), **signals_of(apart)}
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


def _run(outcome: Outcome, simulated_s: float, distance_m: float, events: tuple[Event, ...] = ()) -> Run:
    reason = "" if outcome == "succeeded" else "as the sample wants it"
    fields: Mapping[str, Any] = {"run_index": 3, "seed": "0", "error_code": 0, "recoveries": 0, "missed_goals": 0}
    return Run(outcome=outcome, reason=reason, simulated_s=simulated_s, distance_m=distance_m, events=events, **fields)


OPTIONAL: Final = ("command_", "sent_", "covariance_", "wall_clearance_m", "deviation_m", "static_clearance_m")
"""Prefixes of signals that a run may lack."""


def check_oracle(oracle: Oracle[Any], runs: Sequence[SampleRun] | None = None) -> None:
    """Check all of `CHECKS` on `oracle`.

    Args:
        runs: Runs to judge, by default `sample_runs`, to which an author can add.

    Raises:
        AssertionError: a broken contract.
    """
    judged = sample_runs() if runs is None else runs
    for check in CHECKS:
        check(oracle, judged)


def check_declarations(oracle: Oracle[Any], runs: Sequence[SampleRun]) -> None:
    """It declares valid parameters and metrics."""
    name = type(oracle).__name__
    must(isinstance(oracle.parameters, Parameters), f"{name}'s parameters must be an oracle.Parameters")
    must(oracle.parameters.__class__ is oracle.Parameters, f"{name} must name its parameter model in `Parameters`")
    for metric, unit in oracle.metrics.items():
        must(isinstance(unit, str) and unit, f"{name} must declare the unit of {metric!r}, '1' for a count")


def check_verdicts(oracle: Oracle[Any], runs: Sequence[SampleRun]) -> None:
    """It gives each run a verdict with reason and all metrics that survives JSON."""
    for run in runs:
        _check_verdict(oracle, run, _judged(oracle, run))


def check_missing_signals(oracle: Oracle[Any], runs: Sequence[SampleRun]) -> None:
    """It judges runs that lack an `OPTIONAL` signal."""
    for run in runs:
        for missing in sorted(name for name in run.trace.columns if name.startswith(OPTIONAL)):
            columns = {name: column for name, column in run.trace.columns.items() if name != missing}
            lacking = replace(run, name=f"{run.name} without {missing}", trace=replace(run.trace, columns=columns))
            _check_verdict(oracle, lacking, _judged(oracle, lacking))


def check_inputs_are_kept(oracle: Oracle[Any], runs: Sequence[SampleRun]) -> None:
    """It does not change its inputs, which other oracles share."""
    for run in runs:
        before = {name: column.copy() for name, column in run.trace.columns.items()}
        _judged(oracle, run)
        kept = before.keys() == run.trace.columns.keys() and all(
            np.array_equal(before[name], column, equal_nan=True) for name, column in run.trace.columns.items()
        )
        must(kept, f"{type(oracle).__name__} must not change the trace of {run.name!r}")


def check_determinism(oracle: Oracle[Any], runs: Sequence[SampleRun]) -> None:
    """It repeats its verdicts, in any order of the runs and after pickling.

    Global generators are not to be drawn from, even where they are seeded before: another thread may use them.
    """
    name = type(oracle).__name__
    with watched_generators() as used:
        first = [_judged(oracle, run) for run in runs]
        again = [_judged(oracle, run) for run in reversed(runs)][::-1]
        must(not used(), f"{name} must not use a global generator")
    must(first == again, f"{name} must say the same of the same run. It keeps state, or draws numbers.")
    sent = pickle.loads(pickle.dumps(oracle))
    must(first == [_judged(sent, run) for run in runs], f"{name} must say the same after it was pickled")


def check_runs_alone(oracle: Oracle[Any], runs: Sequence[SampleRun]) -> None:
    """It says the same of a run alone and together with others of its configuration, in any order."""
    name = type(oracle).__name__
    for run in runs:
        traces = [replace(run.trace, run=replace(run.trace.run, run_index=k)) for k in (4, 7, 9)]
        alone = [oracle.judge(trace, run.situation) for trace in traces]
        must(oracle.judge_all(traces, run.situation) == alone, f"{name} must judge {run.name!r} together as alone")
        backwards = oracle.judge_all(traces[::-1], run.situation)
        must(backwards == alone[::-1], f"{name} must judge {run.name!r} the same in any order")
        must(oracle.judge_all([], run.situation) == [], f"{name} must have no verdict on no run")


CHECKS: Final[tuple[Callable[[Oracle[Any], Sequence[SampleRun]], None], ...]] = (
    check_declarations,
    check_inputs_are_kept,
    check_verdicts,
    check_missing_signals,
    check_determinism,
    check_runs_alone,
)
"""All checks, to parametrize a test."""


def _judged(oracle: Oracle[Any], run: SampleRun) -> Verdict:
    try:
        return oracle.judge(run.trace, run.situation)
    except Exception as error:
        what = f"{type(oracle).__name__} must judge {run.name!r}, or say `not_judged`, and not raise"
        raise AssertionError(f"{what} {type(error).__name__}: {error}") from error


def _check_verdict(oracle: Oracle[Any], run: SampleRun, verdict: Verdict) -> None:
    name = type(oracle).__name__
    must(isinstance(verdict, Verdict), f"{name} must give a Verdict on {run.name!r}, not {type(verdict).__name__}")
    mine = (verdict.oracle, verdict.run_index) == (oracle.name, run.trace.run.run_index)
    must(mine, f"{name} must give its own name and the run's index. Use `passed`, `failed` and `not_judged`.")
    known = get_args(Judgment)
    must(verdict.judgment in known, f"{name} must judge one of {known}, not {verdict.judgment!r}")
    told = bool(verdict.reason.strip()) == (verdict.judgment != "pass")
    must(told, f"{name} must say why {run.name!r} is {verdict.judgment!r}: a reason, and none for a pass")
    units = {metric: measured.unit for metric, measured in verdict.metrics.items()}
    must(
        units == dict(oracle.metrics), f"{name} must have all of its metrics in each verdict, None where there is none"
    )
    for metric, measured in verdict.metrics.items():
        finite = measured.value is None or (type(measured.value) in (int, float) and math.isfinite(measured.value))
        must(finite, f"{name}'s {metric} of {run.name!r} must be a finite number or None, not {measured.value!r}")
    must(read_verdicts(write_verdicts([verdict])) == [verdict], f"{name}'s verdict must be the same read from JSON")
