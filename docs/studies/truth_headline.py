"""Measure what the headline's two intervals hold, where runs are fixed and where they stop early.

Campaigns are drawn of configurations whose true rates come from a population. Runs are fixed, or end by a stopping rule as the product ends them; a
sample of the drawn runs is also asked of `Looks.wanted`, one after another. For each population, rule, and number of configurations are told:

- *bias*: of the mean of the configurations' rates against the mean of their true ones, in points, and beside it that of the pooled rate;
- *these*: how often the interval for these configurations holds the mean of their true rates;
- *width*: of that interval, over that of fixed runs with the same total;
- *others*: how often the interval for others of their kind, each configuration a cluster, holds the population's mean; up to 40 of them.

The populations are two that stopping harms most, one of all kinds, and, beyond these, two that are hard for this method.

    python docs/studies/truth_headline.py [--campaigns 500] [--workers 2] [--json FILE]

Exit code 1 where a coverage is below 0.93 by more than two standard errors, or an interval of one of the first three populations is wider than 1.3.
Needs numpy and scipy beside the package.
"""

import argparse
import json
import math
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from functools import cache
from itertools import product
from multiprocessing import Pool
from typing import Final, TypeAlias

import numpy as np
from numpy.typing import NDArray

from vastflow.oracles.statistics.classes import StoppingRule
from vastflow.oracles.statistics.intervals import clustered_interval, wilson
from vastflow.oracles.statistics.looks import Looks, mean_rate

Floats: TypeAlias = NDArray[np.float64]

LEAST: Final = 0.93
WIDEST: Final = 1.3
SEED: Final = 2811
"""Not the seeds by which the method was chosen."""
FIXED: Final = 20
ASKED: Final = 50
"""Drawn configurations of a cell whose runs are asked of `Looks.wanted`."""
POPULATIONS: Final = {
    "80 % at 1, 20 % at 0.8": ((1.0, 0.8), (0.8, 0.2)),
    "half at 1, half at 0.65": ((1.0, 0.65), (0.5, 0.5)),
    "40 % 1, 20 % .95, 15 % .7, 10 % .5, 15 % 0": ((1.0, 0.95, 0.7, 0.5, 0.0), (0.4, 0.2, 0.15, 0.1, 0.15)),
    "all at 0.8": ((0.8,), (1.0,)),
    "half at 0.95, half at 0.65": ((0.95, 0.65), (0.5, 0.5)),
}
RULES: Final = {
    "fixed 20": None,
    "5…12 at 0.15": StoppingRule(5, 12, error=0.15),
    "5…20": StoppingRule(5, 20),
    "5…60": StoppingRule(5, 60),
}
SIZES: Final = (6, 12, 24, 40, 200)
MOST_CLUSTERS: Final = 40


@dataclass(frozen=True)
class Cell:
    """Measurements of one kind of campaign."""

    population: str
    rule: str
    configurations: int
    campaigns: int
    runs: float
    bias: float
    pooled_bias: float
    these: float
    width: float
    others: float | None

    @property
    def error(self) -> float:
        """Standard error of a coverage at the least that is asked."""
        return math.sqrt(LEAST * (1 - LEAST) / self.campaigns)

    @property
    def good(self) -> bool:
        covered = [self.these] if self.others is None else [self.these, self.others]
        narrow = self.width <= WIDEST or self.population not in list(POPULATIONS)[:3]
        return bool(narrow and min(covered) >= LEAST - 2 * self.error)

    def __str__(self) -> str:
        others = "       –" if self.others is None else f"{self.others:8.3f}"
        return (
            f"{self.population:44}{self.rule:14}{self.configurations:4}{self.runs:7.1f}{100 * self.bias:7.2f}{100 * self.pooled_bias:7.2f}"
            f"{self.these:7.3f} ±{math.sqrt(self.these * (1 - self.these) / self.campaigns):.3f}{self.width:6.2f}{others}{'' if self.good else '  NOT GOOD'}"
        )


@cache
def looks_of(rule: StoppingRule) -> Looks:
    return Looks(rule)


def drawn(rates: Floats, rule: StoppingRule | None, rng: np.random.Generator) -> tuple[Floats, Floats]:
    """Passes and runs of configurations with true `rates`, of one shape."""
    if rule is None:
        return rng.binomial(FIXED, rates).astype(np.float64), np.full(rates.shape, float(FIXED))
    looks = looks_of(rule)
    outcomes = rng.random((rates.size, looks.most)) < rates.reshape(-1, 1)
    passes = outcomes.cumsum(axis=1)
    runs = np.full(rates.size, looks.most)
    for look in reversed(looks.looks[:-1]):
        decided = np.array(
            [name not in (None, "undecided") for name in rule.decisions(range(look + 1), [look] * (look + 1))]
        )
        runs[decided[passes[:, look - 1]]] = look
    for k in range(0, rates.size, max(rates.size // ASKED, 1)):
        said = {run: "pass" if passed else "fail" for run, passed in enumerate(outcomes[k].tolist())}
        wanted = 0
        while (more := looks.wanted({run: said[run] for run in range(wanted)})) > wanted:
            wanted = more
        if wanted != runs[k]:
            raise AssertionError(f"{rule}: runs {said} end after {wanted} and not after {runs[k]}")
    found = passes[np.arange(rates.size), runs - 1]
    return found.reshape(rates.shape).astype(np.float64), runs.reshape(rates.shape).astype(np.float64)


def measured(population: str, rule: str, configurations: int, campaigns: int, seed: int = SEED) -> Cell:
    """Draw the campaigns of a cell and ask the product for their intervals."""
    (values, shares), stopping = POPULATIONS[population], RULES[rule]
    kind = [list(POPULATIONS).index(population), list(RULES).index(rule), configurations]
    rng = np.random.default_rng([seed, *kind])
    rates = rng.choice(values, (campaigns, configurations), p=shares)
    true, mean = rates.mean(axis=1), float(np.dot(values, shares))
    passed, runs = drawn(rates, stopping, rng)
    looks = None if stopping is None else looks_of(stopping)
    held = held_others = 0
    bias, widths = np.empty(campaigns), np.empty(campaigns)
    for k, (x, n) in enumerate(zip(passed, runs, strict=True)):
        found = mean_rate(x / n if looks is None else looks.rates(x, n), n, looks)
        assert found is not None
        rate, these = found
        bias[k] = rate - true[k]
        held += these.low - 1e-9 <= true[k] <= these.high + 1e-9
        fixed = wilson(true[k] * n.sum(), n.sum())
        widths[k] = (these.high - these.low) / (fixed.high - fixed.low)
        if configurations <= MOST_CLUSTERS:
            others = clustered_interval(x, n)
            held_others += others is not None and others.low <= mean <= others.high
    pooled_bias = float((passed.sum(axis=1) / runs.sum(axis=1) - true).mean())
    others_held = held_others / campaigns if configurations <= MOST_CLUSTERS else None
    return Cell(
        *(population, rule, configurations, campaigns, float(runs.mean()), float(bias.mean()), pooled_bias),
        *(held / campaigns, float(widths.mean()), others_held),
    )


def main(arguments: Sequence[str] | None = None) -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--campaigns", type=int, default=500, metavar="N", help="of each kind")
    parser.add_argument("--workers", type=int, default=2, metavar="N", help="processes")
    parser.add_argument("--seed", type=int, default=SEED)
    parser.add_argument("--json", metavar="FILE", help="write the cells here as well")
    options = parser.parse_args(arguments)
    asked = [(*kind, options.campaigns, options.seed) for kind in product(POPULATIONS, RULES, SIZES)]
    print(
        f"{'population':44}{'rule':14}{'m':>4}{'runs':>7}{'bias':>7}{'pooled':>7}{'these':>7}{'':7}{'width':>6}  others"
    )
    with Pool(options.workers) as pool:
        cells = pool.starmap_async(measured, asked, chunksize=1).get()
    for cell in cells:
        print(cell)
    if options.json:
        with open(options.json, "w", encoding="utf-8") as file:
            json.dump([{**asdict(cell), "good": cell.good} for cell in cells], file, indent=1)
    return 0 if all(cell.good for cell in cells) else 1


if __name__ == "__main__":
    raise SystemExit(main())
