"""Causes of failed runs, at most one a run."""

from collections.abc import Iterator, Mapping, Sequence
from typing import Final, Literal, TypeAlias

import numpy as np

from vastflow.oracles.judgment.verdict import Verdict
from vastflow.oracles.observation.trace import CLEARANCES, Trace
from vastflow.sim.loop.standstill import STANDSTILL_M, STOOD_STILL
from vastflow.sim.model.elementary import hypot, hypots

Cause: TypeAlias = Literal[
    "stood still",
    "jump of the estimate",
    "lost",
    "contact",
    "blocked by an obstacle",
    "no path to the goal",
    "no path",
    "timed out recovering",
    "gave up recovering",
    "too close",
    "mislocalized",
    "left the path",
    "unknown",
]

LOST_M: Final = 0.5
"""Localization error of a lost robot: twice Nav2's goal tolerance."""
JUMP_M: Final = 0.5
"""Change of the localization error between two rows, 0.1 s apart, that is a jump."""
JUMP_S: Final = 1.0
"""Time in which a jump can invalidate a path: Nav2's default trees replan each second."""
AT_M: Final = 0.5
"""Distance of a contact from the final position that counts as there."""
BLOCKED_M: Final = 0.7
"""Distance of the robot's center from what blocks it: Nav2's inflation radius."""
SEEN_M: Final = 2.5
"""Range at which costmaps see obstacles: Nav2's `obstacle_max_range`."""
RECOVERING_S: Final = 30.0
"""Time before the end within which a recovery belongs to it."""
LEFT_M: Final = 1.0
"""Deviation from the reference path of a robot that has left it."""

CAUSES: Final[Mapping[Cause, str]] = {
    "stood still": f"the robot was sent and never moved {STANDSTILL_M:g} m",
    "jump of the estimate": f"the estimate jumped by {JUMP_M:g} m or more, and the path was invalid from there (INVALID_PATH)",
    "lost": f"localization error above {LOST_M:g} m at the end",
    "contact": "the robot touched something and ended there, safety fails a contact, or social or barn a run with one",
    "blocked by an obstacle": f"the mission ended within {BLOCKED_M:g} m of an obstacle that is not on the map, or without a path and "
    f"within {SEEN_M:g} m of one",
    "no path to the goal": "the planner never found a path, from the start to the end of the run",
    "no path": "the planner found no path any more, and no recovery helped",
    "timed out recovering": f"the time ran out within {RECOVERING_S:g} s of a recovery",
    "gave up recovering": f"Nav2 gave up within {RECOVERING_S:g} s of a recovery",
    "too close": "safety: closer to an obstacle than the robot could stop within; social: for too long close to a body that moves",
    "mislocalized": f"robustness: localization error under way, not above {LOST_M:g} m at the end",
    "left the path": f"performance: more than {LEFT_M:g} m off the reference path",
    "unknown": "none of the causes is seen",
}
"""Causes in words, in order of precedence."""

_SUCCESS, _SAFETY, _ROBUSTNESS, _PERFORMANCE = "success", "safety", "robustness", "performance"
_SOCIAL: Final = "social"
_NEAR: Final = {_SAFETY, _SOCIAL}
"""Oracles of what is near, which a wrong estimate alone does not fail."""
_TOUCHED: Final = {_SOCIAL: "contacts", "barn": "collided"}
"""Oracle to its metric of contacts."""
_NO_PATH: Final = 200
"""First of the planner's error codes."""
_INVALID_PATH: Final = "103"


def cause_of(trace: Trace, verdicts: Sequence[Verdict]) -> Cause | None:
    """The cause of a run's failure: `unknown` if none is seen, None if no verdict is `fail`.

    The end is that of the run, or of the first goal that was given up.
    """
    failed = {verdict.oracle: verdict for verdict in verdicts if verdict.judgment == "fail"}
    return next(_seen(trace, failed), "unknown") if failed else None


def _seen(trace: Trace, failed: Mapping[str, Verdict]) -> Iterator[Cause]:
    if not len(trace):
        return
    missed = trace.events("goal_missed")
    end = int(np.searchsorted(trace["t_s"], missed[0].t_s)) if missed else len(trace)
    end = min(end, len(trace) - 1)
    without_path = trace.run.outcome == "aborted" and trace.run.error_code >= _NO_PATH
    never = _SUCCESS in failed and without_path and _never_followed(trace)
    if trace.events(STOOD_STILL) and not never:
        yield "stood still"
    if _SUCCESS in failed and _path_lost_by_jump(trace):
        yield "jump of the estimate"
    if failed.keys() - _NEAR and not trace.run.estimated_by and trace["localization_error_m"][end] > LOST_M:
        yield "lost"
    x_m, y_m = trace.xy_m[end]
    contacts = () if trace.run.estimated_by else trace.events("contact")
    touched = any(hypot(event.x_m - x_m, event.y_m - y_m) <= AT_M for event in contacts)
    told = any(failed[name].metrics[metric].value for name, metric in _TOUCHED.items() if name in failed)
    if told or (_SUCCESS in failed and touched) or (_SAFETY in failed and _fails_contact(failed[_SAFETY])):
        yield "contact"
    if _SUCCESS in failed:
        kinds = [name for name in CLEARANCES if name in trace.columns]
        apart_m = min((float(trace[name][end]) for name in kinds), default=np.inf)
        if apart_m <= (SEEN_M if without_path else BLOCKED_M):
            yield "blocked by an obstacle"
        if without_path:
            yield "no path to the goal" if never else "no path"
        ended_s = float(trace["t_s"][end])
        if any(0.0 <= ended_s - event.t_s <= RECOVERING_S for event in trace.events("recovery")):
            yield "timed out recovering" if trace.run.outcome == "timed_out" else "gave up recovering"
    if not failed.keys().isdisjoint(_NEAR):
        yield "too close"
    if _ROBUSTNESS in failed:
        yield "mislocalized"
    if _PERFORMANCE in failed and "deviation_m" in trace.columns and trace["deviation_m"].max() > LEFT_M:
        yield "left the path"


def _never_followed(trace: Trace) -> bool:
    """Whether no path was followed: only controllers command motion forward or to the side."""
    forward, lateral = (trace.columns.get(f"command_{name}mps") for name in ("speed_", "lateral_speed_"))
    return forward is not None and not (forward > 0.0).any() and (lateral is None or not lateral.any())


def _path_lost_by_jump(trace: Trace) -> bool:
    failures = trace.events("control_failed")
    if not failures or failures[-1].what != _INVALID_PATH:
        return False
    error_m = np.column_stack((trace["estimated_x_m"] - trace["x_m"], trace["estimated_y_m"] - trace["y_m"]))
    jumped_s = trace["t_s"][1:][hypots(*np.diff(error_m, axis=0).T) >= JUMP_M]
    return bool(np.any(np.abs(failures[-1].t_s - jumped_s) <= JUMP_S))


def _fails_contact(safety: Verdict) -> bool:
    """Whether the run fails for a contact: with an obstacle, or with anything if the margin is kept."""
    measured = {name: metric.value for name, metric in safety.metrics.items()}
    margin_m = measured.get("margin")
    return bool(measured.get("obstacle_contacts")) or (bool(measured.get("contacts")) and not (margin_m or 0.0) < 0.0)
