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
    """A criterion after a batch, such as `5 batches` with the text `batches 3 of 5`."""

    limit: str
    text: str
    met: bool


def plan_text(spec: SearchSpec, runs: int, *, at_most: bool = False) -> str:
    """Describe a search with `runs` runs of each point in one line."""
    most = "up to " if at_most else ""
    ends = " or ".join(each.limit for each in criteria(spec, (), {}, 0.0))
    confirm = f", then {spec.confirm} fresh runs of the best" if spec.confirm else ""
    dimensions = "1 dimension" if len(spec.search_space) == 1 else f"{len(spec.search_space)} dimensions"
    points = "1 point" if spec.per_batch == 1 else f"{spec.per_batch} points"
    beside = f" and as many by {spec.baseline} beside them" if spec.baseline else ""
    return (
        f"search by {spec.strategy} of {dimensions} to {spec.direction} {spec.objective.name}, {points} a "
        f"batch{beside} with {most}{runs} run{'s' * (runs > 1)} each, until {ends}{confirm}"
    )


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
    """Each criterion of a search, by its strategy's metrics and the time on the clock."""
    told = [each for batch in batches for each in batch]
    judged = sum(each.objective is not None for each in told)
    runs, hours = sum(each.runs for each in told), sum(each.simulated_s for each in told) / 3600.0
    for budget in spec.budget:
        for one, many, limit, reached in (
            ("batch", "batches", budget.batches, len(batches)),
            ("judged point", "judged points", budget.evaluations, judged),
            ("run", "runs", budget.runs, runs),
        ):
            if limit is not None:
                yield Criterion(
                    f"{limit} {one if limit == 1 else many}", f"{many} {reached} of {limit}", reached >= limit
                )
        if (most := budget.simulated_hours) is not None:
            yield Criterion(f"{most:g} simulated hours", f"simulated hours {hours:.2f} of {most:g}", hours >= most)
        if (most := budget.time) is not None:  # without the time spent: results are the same whenever they are made
            yield Criterion(f"{most:g} s", f"time of {most:g} s", elapsed_s >= most)
    best = best_of(told, spec.direction)
    sign, op = (1, ">=") if spec.direction == "maximize" else (-1, "<=")
    for stopping in spec.stopping:
        if (target := stopping.target_objective) is not None:
            met = best is not None and sign * (best.objective or 0.0) >= sign * target
            found = "none" if best is None else f"{best.objective:g}"
            yield Criterion(f"{spec.objective.name} {op} {target:g}", f"objective {found}, target {target:g}", met)
        if (rule := stopping.no_improvement) is not None:
            stood, patience = _batches_without_improvement(batches, spec.direction, rule), rule.patience
            yield Criterion(
                f"no improvement in {patience} batch{'es' * (patience > 1)}",
                f"batches without improvement {stood} of {patience}",
                stood >= patience,
            )
        if (metric := stopping.metric) is not None:
            right = f"{metric.op} {metric.value:g}"
            met = metric.name in metrics and _OPERATORS[metric.op](metrics[metric.name], metric.value)
            yield Criterion(f"{metric.name} {right}", f"{metric.name} {metrics.get(metric.name, 0.0):.3g} {right}", met)
    most = spec.max_proposals
    yield Criterion(f"{most} proposals", f"proposals {len(told)} of {most}", len(told) >= most)


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
