"""Checks of a strategy's contract, which its author can call in a test."""

from collections.abc import Callable, Sequence
from typing import Any, Final

from vastflow.producers.search.space import Point
from vastflow.producers.search.strategy import Evaluation, Parameters, Problem, Proposal, Strategy
from vastflow.sim.plug_ins.conformance import must, watched_generators

BATCHES: Final = 4

Kind = type[Strategy[Any]]


def check_strategy(kind: Kind, parameters: Parameters, problem: Problem) -> None:
    """Check all of `CHECKS`, in their order; raises an AssertionError at the first that fails."""
    for check in CHECKS:
        check(kind, parameters, problem)


def check_points(kind: Kind, parameters: Parameters, problem: Problem) -> None:
    """Check that it proposes points of the space, and at most the requested number."""
    for points in _asked(kind, parameters, problem):
        must(len(points) <= problem.per_batch, f"{kind.__name__} must propose at most {problem.per_batch} points")
        outside = [point for point in points if not problem.space.contains(point)]
        must(not outside, f"{kind.__name__} must propose points of the space, not {outside[:1]}")


def check_determinism(kind: Kind, parameters: Parameters, problem: Problem) -> None:
    """Check that equal answers give equal proposals and leave global generators alone."""
    with watched_generators() as used:
        same = _asked(kind, parameters, problem) == _asked(kind, parameters, problem)
        must(same, f"{kind.__name__} must propose the same by the same evaluations. Draw from `problem.draws` alone.")
        must(not used(), f"{kind.__name__} must not use a global generator. Draw from `problem.draws` alone.")


def check_infeasible(kind: Kind, parameters: Parameters, problem: Problem) -> None:
    """Check that a strategy goes on when its points can't be built."""
    must(
        all(_asked(kind, parameters, problem, feasible=False)), f"{kind.__name__} must go on where points are rejected"
    )


def check_numbers(kind: Kind, parameters: Parameters, problem: Problem) -> None:
    """It reports the metrics that it declares, from the beginning."""
    found, declared = set(kind(parameters, problem).metrics), set(kind.reports)
    must(found == declared, f"{kind.__name__} must report {sorted(declared)}, not {sorted(found)}")


CHECKS: Final[tuple[Callable[[Kind, Parameters, Problem], None], ...]] = (
    check_points,
    check_determinism,
    check_infeasible,
    check_numbers,
)
"""All checks, for a test that is parametrized with them and reports each on its own."""


def _asked(kind: Kind, parameters: Parameters, problem: Problem, *, feasible: bool = True) -> list[Sequence[Point]]:
    strategy, number = kind(parameters, problem), 0
    batches: list[Sequence[Point]] = []
    for batch in range(BATCHES):
        points = list(strategy.ask(batch, problem.per_batch))
        evaluations = []
        for point in points:
            number += 1
            proposal, known = Proposal(number, batch, point), feasible and number % 5 != 0
            value = float(problem.space.encoded(point).sum()) if problem.space.contains(point) else 0.0
            measures = dict.fromkeys(kind.measures(parameters), value)
            evaluations.append(
                Evaluation(proposal, "judged", value, measures, 5)
                if known
                else Evaluation(proposal, "rejected", reason="nothing can be built there")
            )
        strategy.tell(evaluations)
        batches.append(points)
    return batches
