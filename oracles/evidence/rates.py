"""Success rates and their intervals."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

from vastflow.oracles.judgement.verdict import Judgement
from vastflow.oracles.statistics.intervals import LEVEL, Interval, clustered_interval, interval, wilson_intervals

__all__ = ["LEVEL", "Counts", "Interval", "clustered", "counts_of", "pooled", "wilson"]


@dataclass(frozen=True, slots=True)
class Counts:
    """Numbers of judgements; rates exclude unjudged runs."""

    passed: int = 0
    failed: int = 0
    not_judged: int = 0

    @property
    def judged(self) -> int:
        return self.passed + self.failed

    @property
    def rate(self) -> float | None:
        """Share of passes among the judged; None where nothing was judged."""
        return self.passed / self.judged if self.judged else None

    @property
    def interval(self) -> Interval:
        """Wilson interval of the rate, for runs of these same configurations."""
        return wilson(self.passed, self.judged)


def counts_of(judgements: Iterable[Judgement]) -> Counts:
    said = list(judgements)
    return Counts(said.count("pass"), said.count("fail"), said.count("not judged"))


def pooled(clusters: Iterable[Counts]) -> Counts:
    clusters = list(clusters)
    return Counts(sum(c.passed for c in clusters), sum(c.failed for c in clusters), sum(c.not_judged for c in clusters))


def wilson(passed: float, n: float, level: float = LEVEL) -> Interval:
    """Wilson's score interval of one proportion, see `wilson_intervals`."""
    return interval(wilson_intervals(passed, n, level))


def clustered(
    configurations: Sequence[Counts], level: float = LEVEL, blocks: Sequence[int] | None = None
) -> Interval | None:
    """Interval for other configurations like these, see `clustered_interval`."""
    return clustered_interval([c.passed for c in configurations], [c.judged for c in configurations], level, blocks)
