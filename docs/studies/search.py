"""Measure strategies on spaces with known truth: runs to a failure, boundary error, coverage.

    python docs/studies/search.py [pockets] [boundary] [coverage] [--seeds N]

- `pockets`: boxes of 1 % and of 0.2 % of the unit cube in six dimensions, both or one of them, in which a run fails with probability
  0.9 and outside of which none does. On the sloped space the objective is a metric that falls toward them from afar, on the flat one the failure rate
  alone. There the pockets lie anywhere, across faces of the cube too, and nothing can be better than random: pockets inside of the cube are
  more often met by who keeps to its middle. Counted are runs until a failure is confirmed, by 3 of 5 runs that fail again; runs
  that confirm nothing count too. Each seed has other pockets. Asked is a third of random's runs, whose median is of 2000 seeds, for that of
  fewer is chance.
- `boundary`: a failure rate that rises along one of two parameters, at a place that depends on the other. Counted is how far the curve
  of 50 % is from the true one, against a grid of five times the runs.
- `coverage`: the interval of the confirming runs of 200 searches, against the rate at the point that they confirm.

No simulator runs: the pure core is asked and told; `search_real.py` asks the simulator. The exit code is 1 where a goal is missed that
is not known to be.
"""

import argparse
import sys
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from vastflow.oracles.statistics.intervals import clopper_pearson_intervals, interval
from vastflow.producers.campaign_file.search import SearchDimension
from vastflow.producers.search.criteria import best_of
from vastflow.producers.search.space import Space
from vastflow.producers.search.strategy import Evaluation, Problem, Proposal, Strategy, find_strategy

Floats = NDArray[np.float64]

PER_BATCH: Final = 8
SIZES: Final = (1, 4, 8)
"""Points of a batch that driven strategies are asked for: one where a file says nothing. Those of a batch don't know of each other."""
DIMENSIONS: Final = 6
WIDE, NARROW, BOTH = (0.01,), (0.002,), (0.01, 0.002)
DRIVEN: Final = ("optuna", "optuna cmaes", "qd")
FAILS_INSIDE: Final = 0.9
CONFIRMING_RUNS: Final = 5
CONFIRMING_FAILURES: Final = 3
MOST_RUNS: Final = 500
METRIC_NOISE: Final = 0.05
"""Standard deviation of a run's metric; the metric is 1 on a pocket's border."""
PLACES: Final = 10**6
RUNS: Final = PLACES + 1
"""Streams of draws that no batch of a strategy has: its points are drawn from the seed, too."""
FASTER: Final = 3.0
"""Factor by which driven strategies must need fewer runs than random ones on a slope."""
RANDOM_SEEDS: Final = 2000
SHORT_OF_IT: Final = {
    ("qd", BOTH, 1): 2.5,
    ("qd", BOTH, 4): 2.5,
    ("optuna", BOTH, 4): 2.5,
    ("qd", WIDE, 8): 2.5,
    ("optuna", WIDE, 8): 2.5,
    ("qd", BOTH, 8): 2.0,
    ("optuna", BOTH, 8): 2.0,
}
"""Cases that miss it, to the factor they must reach: eight or ten points are random and five runs confirm, so of a third of random's runs,
23 for both pockets, about ten are left to be driven: two batches of four, or one of eight."""

STRATEGIES: Final[dict[str, dict[str, Any]]] = {
    "random": {},
    "sobol": {},
    "optuna": {},
    "optuna cmaes": {"sampler": "cmaes"},
    "qd": {"archive": {"type": "grid", "bins": 5, "measures": {f"x{k}": {"low": 0, "high": 1} for k in (0, 1)}}},
}


def strategy_of(name: str, problem: Problem) -> Strategy[Any]:
    """A strategy at its beginning, with the parameters that the proof gives it."""
    kind = find_strategy(name.partition(" ")[0], Path())
    return kind(kind.Parameters.model_validate(STRATEGIES.get(name, {})), problem)


def cube(dimensions: int) -> Space:
    """The unit cube."""
    return Space({f"x{k}": SearchDimension(type="float", low=0.0, high=1.0) for k in range(dimensions)})


@dataclass(frozen=True)
class Pockets:
    """Boxes in the unit cube in which runs fail.

    Attributes:
        centers: (n, d).
        halves: (n,) half of the length of an edge.
        wrapped: Whether what is beyond a face of the cube is at the opposite one.
    """

    centers: Floats
    halves: Floats
    wrapped: bool = False

    def metric(self, unit: Floats) -> float:
        """Greatest distance along an axis to the nearest pocket's center, in halves of its edge: at most 1 inside."""
        off = np.abs(unit - self.centers)
        off = np.minimum(off, 1.0 - off) if self.wrapped else off
        return float((off.max(axis=1) / self.halves).min())

    def fails(self, unit: Floats, draws: np.random.Generator) -> bool:
        """Whether a run fails."""
        return self.metric(unit) <= 1.0 and bool(draws.random() < FAILS_INSIDE)


def pockets_of(seed: int, volumes: Sequence[float], *, wrapped: bool = False) -> Pockets:
    """The pockets of a seed, all of them inside the cube; wrapped ones lie anywhere."""
    halves = np.array([volume ** (1 / DIMENSIONS) / 2 for volume in volumes])
    draws, margins = np.random.default_rng([seed, PLACES]), 0.0 * halves if wrapped else halves
    centers = np.stack([margin + (1 - 2 * margin) * draws.random(DIMENSIONS) for margin in margins])
    return Pockets(centers, halves, wrapped)


def evaluations(
    strategy: Strategy[Any], measured: Callable[[Floats], float], space: Space, measures: Sequence[str]
) -> Iterator[tuple[Floats, Evaluation]]:
    """Points and what is found there, one after the other, without an end: one run each."""
    number = batch = 0
    while True:
        told = []
        for point in strategy.ask(batch, strategy.problem.per_batch):
            number += 1
            unit = space.encoded(point)
            known = {name: float(point[name]) for name in measures}  # type: ignore[arg-type]
            told.append(Evaluation(Proposal(number, batch, point), "judged", measured(unit), known, 1))
            yield unit, told[-1]
        strategy.tell(told)
        batch += 1


def runs_to_confirmed(
    name: str, seed: int, volumes: Sequence[float], *, sloped: bool, per_batch: int = PER_BATCH
) -> int:
    """Runs until a failure is confirmed."""
    pockets = pockets_of(seed, volumes, wrapped=not sloped)
    draws, space = np.random.default_rng([seed, RUNS]), cube(DIMENSIONS)
    strategy = strategy_of(name, Problem(space, "minimize" if sloped else "maximize", seed, per_batch))
    failed: list[bool] = []

    def measured(unit: Floats) -> float:
        failed.append(pockets.fails(unit, draws))
        return pockets.metric(unit) + METRIC_NOISE * draws.normal() if sloped else float(failed[-1])

    runs = 0
    for unit, _ in evaluations(strategy, measured, space, type(strategy).measures(strategy.parameters)):
        runs += 1
        if failed[-1]:
            runs += CONFIRMING_RUNS
            if sum(pockets.fails(unit, draws) for _ in range(CONFIRMING_RUNS)) >= CONFIRMING_FAILURES:
                return runs
        if runs >= MOST_RUNS:
            return MOST_RUNS
    raise AssertionError("unreachable: strategies go on asking")


def asked_of(*, sloped: bool) -> list[tuple[str, int]]:
    """Strategies and sizes of their batches, which matter to those that a slope drives."""
    return [(name, size) for name in STRATEGIES for size in (SIZES if sloped and name in DRIVEN else (PER_BATCH,))]


def pockets(seeds: int = 200) -> bool:
    """Print runs to the first confirmed failure by strategy; whether the goals are met."""
    met = True
    for volumes, sloped in ((NARROW, True), (WIDE, True), (BOTH, True), (BOTH, False)):
        which = " and ".join(f"{volume:.1%}" for volume in volumes)
        print(f"\n{'sloped' if sloped else 'flat'}, {which}: runs to the first confirmed failure, {seeds} seeds")
        print(f"{'strategy':12} {'batch':>5} {'quartile':>8} {'median':>8} {'quartile':>8}   random's median over its")
        of_random = 0.0
        for name, size in asked_of(sloped=sloped):
            tries = RANDOM_SEEDS if name == "random" else seeds
            runs = [runs_to_confirmed(name, seed, volumes, sloped=sloped, per_batch=size) for seed in range(tries)]
            low, median, high = (float(each) for each in np.quantile(runs, (0.25, 0.5, 0.75)))
            of_random = of_random or median
            said = f"{name:12} {size:5} {low:8.0f} {median:8.0f} {high:8.0f}   {of_random / median:.2f}"
            if sloped and name in DRIVEN:
                faster, least = of_random / median, SHORT_OF_IT.get((name, volumes, size), FASTER)
                said += f" of {FASTER:g} asked, {'met' if faster >= FASTER else 'MISSED'}"
                said += f", as is known from {least:g} on" * (least <= faster < FASTER)
                met &= faster >= least
            print(said, flush=True)
    return met


GRID: Final = 21
GRID_RUNS: Final = 10
"""Points of the reference grid along each parameter, and runs of each."""
NEAR: Final = 0.05
"""Root mean square distance of the curve, as a share of the range."""


def curve(x: Floats) -> Floats:
    """Return the second parameter at which the failure rate is 50 %."""
    return 0.5 + 0.25 * np.sin(2.5 * np.pi * x) * np.exp(-0.5 * x)


def rate(unit: Floats) -> Any:
    """Failure rate at (…, 2) coordinates: from 1 % to 99 % within a fifth of the range."""
    return 1.0 / (1.0 + np.exp((unit[..., 1] - curve(unit[..., 0])) / 0.022))


def curve_of(surface: Floats, along: Floats) -> Floats:
    """Return for each x the first y at which the rate crosses the level; NaN without a crossing."""
    found = np.full(len(surface), np.nan)
    for k, column in enumerate(surface):
        crossings = np.flatnonzero((column[:-1] > 0) & (column[1:] <= 0))
        if len(crossings):
            i = crossings[0]
            found[k] = along[i] + (along[i + 1] - along[i]) * column[i] / (column[i] - column[i + 1])
    return found


def boundary(seeds: int = 20) -> bool:
    """Print the distance of the curve that `boundary` finds; whether the goal is met."""
    budget, errors, of_grid = GRID * GRID * GRID_RUNS // 5, [], []
    for seed in range(seeds):
        draws, space = np.random.default_rng([seed, RUNS]), cube(2)
        strategy = strategy_of("boundary", Problem(space, "maximize", seed, PER_BATCH))
        number = batch = 0
        while (number + PER_BATCH) * GRID_RUNS <= budget:
            told = []
            for point in strategy.ask(batch, PER_BATCH):
                number += 1
                found = draws.binomial(GRID_RUNS, rate(space.encoded(point))) / GRID_RUNS
                told.append(Evaluation(Proposal(number, batch, point), "judged", float(found), {}, GRID_RUNS))
            strategy.tell(told)
            batch += 1
        along = np.linspace(0.0, 1.0, GRID)
        units = np.stack(np.meshgrid(along, along, indexing="ij"), axis=-1).reshape(-1, 2)
        mean, _ = strategy.surface(units)  # type: ignore[attr-defined]
        grid = draws.binomial(GRID_RUNS, rate(units)) / GRID_RUNS - 0.5
        for found, kept in ((mean, errors), (grid, of_grid)):
            off = curve_of(found.reshape(GRID, GRID), along) - curve(along)
            kept.append(float(np.sqrt(np.mean(np.where(np.isnan(off), 1.0, off) ** 2))))
    print(
        f"\nboundary: root mean square distance to the curve, {seeds} seeds, {budget} runs against the grid's {5 * budget}"
    )
    print(f"boundary: median {np.median(errors):.4f}, worst {max(errors):.4f}; the grid's {np.median(of_grid):.4f}")
    return max(errors) <= NEAR


SEARCH_RUNS: Final = 64
FRESH_RUNS: Final = 60


def coverage(seeds: int = 200) -> bool:
    """Print the coverage of confirming intervals; True if it is high enough."""
    met = True
    print(
        f"\ncoverage: {seeds} searches of {SEARCH_RUNS} points of one run, {FRESH_RUNS} fresh runs of the best, 95 % intervals"
    )
    for name in ("random", "optuna"):
        covered, found_rates, true_rates = 0, [], []
        for seed in range(seeds):
            draws, space = np.random.default_rng([seed, RUNS]), cube(2)
            strategy = strategy_of(name, Problem(space, "maximize", seed, PER_BATCH))
            told = []

            def measured(unit: Floats, draws: np.random.Generator = draws) -> float:
                return float(draws.binomial(3, 0.6 * rate(unit)) / 3)

            for _, each in evaluations(strategy, measured, space, ()):
                told.append(each)
                if len(told) == SEARCH_RUNS:
                    break
            best = best_of(told, "maximize")
            assert best is not None and best.objective is not None
            truth = 0.6 * float(rate(space.encoded(best.proposal.point)))
            failed = int(draws.binomial(FRESH_RUNS, truth))
            bounds = interval(clopper_pearson_intervals(failed, FRESH_RUNS))
            covered += bounds.low <= truth <= bounds.high
            found_rates.append(best.objective)
            true_rates.append(truth)
        least = 0.95 - 1.96 * np.sqrt(0.95 * 0.05 / seeds)
        met &= covered / seeds >= least
        said = f"got at {np.mean(found_rates):.0%} on average, in truth {np.mean(true_rates):.0%}"
        print(f"{name:10} {covered} of {seeds} intervals cover; {said}", flush=True)
    return met


PROOFS: Final = (pockets, boundary, coverage)


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("proofs", nargs="*", metavar="PROOF", help="pockets, boundary, coverage; else all")
    parser.add_argument("--seeds", type=int, help="else as many as each proof needs")
    asked = parser.parse_args()
    chosen = [proof for proof in PROOFS if not asked.proofs or proof.__name__ in asked.proofs]
    met = [proof(asked.seeds) if asked.seeds else proof() for proof in chosen]
    sys.exit(0 if all(met) else 1)
