"""When a search ends: its budget and its criteria of stopping, each against its limit."""

import operator
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Final

from vastflow.producers.campaign_file.search import NoImprovement, SearchSpec
from vastflow.producers.search.strategy import Evaluation

_OPERATORS: Final = {
    ">": operator.gt,
    ">=": operator.ge,
    "<": operator.lt,
    "<=": operator.le,
    "==": operator.eq,
    "!=": operator.ne,
}


@dataclass(frozen=True, slots=True)
class Criterion:
    """A criterion as it stands after a batch.

    Attributes:
        text: Such as `batches 3 of 5`.
        met: Whether it ends the search.
    """

    text: str
    met: bool


def plan_text(spec: SearchSpec, runs: int, *, at_most: bool = False) -> str:
    """Return a line on what a search would do.

    Args:
        runs: Of each point.
        at_most: Whether these are its most.
    """
    most = "up to " if at_most else ""
    ends = " or ".join([*_limits(spec), *_stops(spec), f"{spec.max_proposals} proposals"])
    confirm = f", then {spec.confirm} fresh runs of the best" if spec.confirm else ""
    dimensions = "1 dimension" if len(spec.search_space) == 1 else f"{len(spec.search_space)} dimensions"
    points = "1 point" if spec.per_batch == 1 else f"{spec.per_batch} points"
    beside = f" and as many by {spec.baseline} beside them" if spec.baseline else ""
    return (
        f"search by {spec.strategy} of {dimensions} to {spec.direction} {spec.objective.name}, {points} a "
        f"batch{beside} with {most}{runs} run{'s' * (runs > 1)} each, until {ends}{confirm}"
    )


def _limits(spec: SearchSpec) -> Iterator[str]:
    """Each amount of the budget, such as `5 batches`."""
    for budget in spec.budget:
        if budget.batches is not None:
            yield f"{budget.batches} batch{'es' * (budget.batches > 1)}"
        if budget.evaluations is not None:
            yield f"{budget.evaluations} judged point{'s' * (budget.evaluations > 1)}"
        if budget.runs is not None:
            yield f"{budget.runs} run{'s' * (budget.runs > 1)}"
        if budget.simulated_hours is not None:
            yield f"{budget.simulated_hours:g} simulated hours"
        if budget.time is not None:
            yield f"{budget.time:g} s"


def _stops(spec: SearchSpec) -> Iterator[str]:
    """Each criterion of stopping, such as `coverage >= 0.3`."""
    for stopping in spec.stopping:
        if stopping.target_objective is not None:
            op = ">=" if spec.direction == "maximize" else "<="
            yield f"{spec.objective.name} {op} {stopping.target_objective:g}"
        if stopping.no_improvement is not None:
            patience = stopping.no_improvement.patience
            yield f"no improvement in {patience} batch{'es' * (patience > 1)}"
        if stopping.metric is not None:
            yield f"{stopping.metric.name} {stopping.metric.op} {stopping.metric.value:g}"


def best_of(evaluations: Sequence[Evaluation], direction: str) -> Evaluation | None:
    """The first of the evaluations with the best objective; None where none has one."""
    judged = [each for each in evaluations if each.objective is not None]
    if not judged:
        return None
    sign = 1 if direction == "maximize" else -1
    return max(judged, key=lambda each: (sign * (each.objective or 0.0), -each.proposal.number))


def runs_until(evaluations: Sequence[Evaluation], objective: float, direction: str) -> int | None:
    """Runs up to the first evaluation that is as good, its own included; None where none is."""
    sign, runs = (1 if direction == "maximize" else -1), 0
    for each in evaluations:
        runs += each.runs
        if each.objective is not None and sign * each.objective >= sign * objective:
            return runs
    return None


def criteria(
    spec: SearchSpec, batches: Sequence[Sequence[Evaluation]], metrics: Mapping[str, float], elapsed_s: float
) -> Iterator[Criterion]:
    """Each criterion of a search after the batches that there are.

    Args:
        metrics: What the strategy reports.
        elapsed_s: Time on the clock.
    """
    told = [each for batch in batches for each in batch]
    judged = sum(each.objective is not None for each in told)
    runs, hours = sum(each.runs for each in told), sum(each.simulated_s for each in told) / 3600.0
    for budget in spec.budget:
        if budget.batches is not None:
            yield Criterion(f"batches {len(batches)} of {budget.batches}", len(batches) >= budget.batches)
        if budget.evaluations is not None:
            yield Criterion(f"judged points {judged} of {budget.evaluations}", judged >= budget.evaluations)
        if budget.runs is not None:
            yield Criterion(f"runs {runs} of {budget.runs}", runs >= budget.runs)
        if budget.simulated_hours is not None:
            yield Criterion(
                f"simulated hours {hours:.2f} of {budget.simulated_hours:g}", hours >= budget.simulated_hours
            )
        if budget.time is not None:
            spent = f"time of {budget.time:g} s"  # no more, for it stands beside results that are the same whenever they are made
            yield Criterion(spent, elapsed_s >= budget.time)
    best = best_of(told, spec.direction)
    for stopping in spec.stopping:
        if stopping.target_objective is not None:
            sign = 1 if spec.direction == "maximize" else -1
            met = best is not None and sign * (best.objective or 0.0) >= sign * stopping.target_objective
            found = "none" if best is None else f"{best.objective:g}"
            yield Criterion(f"objective {found}, target {stopping.target_objective:g}", met)
        if stopping.no_improvement is not None:
            stood = _batches_without_improvement(batches, spec.direction, stopping.no_improvement)
            patience = stopping.no_improvement.patience
            yield Criterion(f"batches without improvement {stood} of {patience}", stood >= patience)
        if stopping.metric is not None:
            name, value = stopping.metric.name, stopping.metric.value
            known = name in metrics
            met = known and _OPERATORS[stopping.metric.op](metrics[name], value)
            yield Criterion(f"{name} {metrics.get(name, 0.0):.3g} {stopping.metric.op} {value:g}", met)
    yield Criterion(f"proposals {len(told)} of {spec.max_proposals}", len(told) >= spec.max_proposals)


def _batches_without_improvement(batches: Sequence[Sequence[Evaluation]], direction: str, rule: NoImprovement) -> int:
    """Return the number of last batches that have not improved the best by `min_delta`, or at all."""
    sign, reached, stood = (1 if direction == "maximize" else -1), None, 0
    for batch in batches:
        best = best_of(batch, direction)
        value = None if best is None or best.objective is None else sign * best.objective
        if value is not None and (reached is None or (value > reached and value - reached >= rule.min_delta)):
            reached, stood = value, 0
        else:
            stood += 1
    return stood
