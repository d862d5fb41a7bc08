"""Rates as the paper counts them: a configuration as often as it was requested.

Configurations of equal content are run once. Who counts each of them, as one does that ran them all, gives a configuration
the weight 1 + its duplicates. Its runs are no more for that, and so the intervals take the weights into account.
"""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass

from vastflow.oracles.evidence.rates import LEVEL, Counts, Interval, clustered, pooled, wilson

Weights = Mapping[str, int]
"""Configuration to how often it was requested; what is not in it, once."""


@dataclass(frozen=True, slots=True)
class WeightedRate:
    """A success rate over weighted configurations.

    Attributes:
        counts: Runs, each as often as its configuration was requested.
        interval: Of these same configurations, as if each run were drawn anew. Wilson's at Kish's effective number of runs:
            (Σ w n)² / Σ w² n for configurations of weight w and n judged runs.
        clustered: For other configurations like these, whatever their weights: see `vastflow.oracles.evidence.rates.clustered`. None
            for fewer than two.
    """

    counts: Counts
    interval: Interval
    clustered: Interval | None

    @property
    def rate(self) -> float | None:
        """Share of passes among the judged; None where nothing was judged."""
        return self.counts.rate


def weights_of(configurations: Iterable[tuple[str, str | None]]) -> dict[str, int]:
    """Each configuration that is no duplicate, to 1 and the number of its duplicates.

    Args:
        configurations: Name and `duplicate_of`, as `configurations.parquet` has them.
    """
    weights: dict[str, int] = {}
    for name, duplicate_of in configurations:
        run = name if duplicate_of is None else duplicate_of
        weights[run] = weights.get(run, 0) + 1
    return weights


def weighted_counts(counts: Mapping[str, Counts], weights: Weights) -> dict[str, Counts]:
    """The counts that there would be, had each configuration been run as often as it was requested, with these same runs."""
    return {
        name: Counts(*(weights.get(name, 1) * n for n in (each.passed, each.failed, each.not_judged)))
        for name, each in counts.items()
    }


def weighted_rate(
    counts: Mapping[str, Counts], weights: Weights, level: float = LEVEL, blocks: Mapping[str, int] | None = None
) -> WeightedRate:
    """The rate over the configurations of `counts`, each with its weight.

    Args:
        blocks: Configuration to the number of its block; by default each is its own.
    """
    repeated = weighted_counts(counts, weights)
    whole = pooled(repeated.values())
    if whole.rate is None:
        return WeightedRate(whole, Interval(0.0, 1.0), None)
    runs = whole.judged**2 / sum(weights.get(name, 1) * each.judged for name, each in repeated.items())
    of = None if blocks is None else [blocks[name] for name in repeated]
    return WeightedRate(whole, wilson(whole.rate * runs, runs, level), clustered(list(repeated.values()), level, of))
