"""Check that the gate passes a loss of its margin in at most 2.5 % of campaigns.

Campaigns are drawn whose success rate loses exactly the margin, in three manners:

- *spread*: each path loses as much as any other;
- *concentrated*: one path in five loses five times the margin;
- *total*: as many paths fail always, from rates of 1, as make the margin.

Of `others` the paths are drawn anew for each campaign; of `these` they stay, and repetitions alone are drawn. Runs of a pair are drawn
independently of each other, which is the worst that equal seeds may do. Told beside the errors: how often a campaign without a loss
passes, and how often one that lost ten points does not.

    python tests/proofs/gate.py [--campaigns 2000]

Prints a table; exit code 1 where a gate errs more often than is stated, by more than four standard errors of the simulation.
"""

from collections.abc import Iterator
from functools import cache
from typing import Final

import numpy as np
from missions import parser_of
from numpy.typing import NDArray
from planted_truths import Finding, printed

from vastflow.oracles.statistics.intervals import mean_interval, needed

Floats = NDArray[np.float64]

RUNS: Final = 20
MANNERS: Final = ("spread", "concentrated", "total")
OTHERS: Final = ((0.1, 36), (0.1, 100), (0.02, 183), (0.02, 500))
"""Margins, and numbers of paths that suffice for them."""
THESE: Final = ((0.1, 8), (0.1, 40), (0.02, 24), (0.02, 150))


def rates(manner: str, margin: float, paths: int, rng: np.random.Generator, *, exact: bool) -> tuple[Floats, Floats]:
    """Success rates of paths before and after a loss of `margin` on the mean.

    Args:
        exact: Of these paths; else of the kind that they are drawn from.
    """
    if manner == "spread":
        before = rng.beta(8.0, 2.0, paths) * (1 - margin) + margin
        return before, before - margin
    share, loss = (0.2, 5 * margin) if manner == "concentrated" else (margin, 1.0)
    hit = np.arange(paths) < round(share * paths) if exact else rng.random(paths) < share
    before = np.where(hit & (manner == "total"), 1.0, rng.beta(8.0, 2.0, paths) * (1 - loss % 1) + loss % 1)
    return before, np.where(hit, before - loss, before)


def holds_for_others(before: Floats, after: Floats, margin: float, rng: np.random.Generator) -> bool:
    """Whether a campaign of these rates passes, each path one draw."""
    change = (rng.binomial(RUNS, after) - rng.binomial(RUNS, before)) / RUNS
    return mean_interval(change)[0] > -margin


def holds_for_these(before: Floats, after: Floats, margin: float, rng: np.random.Generator) -> bool:
    """Likewise, each pair of runs one draw."""
    then, now = (rng.random((RUNS, len(before))) < each for each in (before, after))
    return lower_end(int((then & ~now).sum()), int((now & ~then).sum()), then.size) > -margin


@cache
def lower_end(lost: int, gained: int, pairs: int) -> float:
    """Width of the interval of this number of pairs."""
    return mean_interval(np.repeat([-1.0, 0.0, 1.0], [lost, pairs - lost - gained, gained]))[0]


def others(campaigns: int, rng: np.random.Generator) -> Iterator[Finding]:
    """Losses of the margin, none, and of ten points, on paths that are drawn anew."""
    for margin, paths in OTHERS:
        assert (needed(margin) or 0) <= paths
        for manner in MANNERS:
            passed = sum(
                holds_for_others(*rates(manner, margin, paths, rng, exact=False), margin, rng) for _ in range(campaigns)
            )
            what = f"others: a loss of {100 * margin:g} points, {manner}, on {paths} paths passes"
            yield Finding(what, passed, campaigns, most=0.025)
        same = [rng.beta(8.0, 2.0, paths) for _ in range(campaigns)]
        yield Finding(
            f"others: no loss, on {paths} paths, passes a margin of {100 * margin:g}",
            sum(holds_for_others(each, each, margin, rng) for each in same),
            campaigns,
        )


def these(campaigns: int, rng: np.random.Generator) -> Iterator[Finding]:
    """The same on paths that stay; and a loss of ten points under a margin of two."""
    for margin, paths in THESE:
        for manner in MANNERS:
            if manner == "total" and round(margin * paths) != margin * paths:
                continue
            before, after = rates(manner, margin, paths, rng, exact=True)
            lost = float((before - after).mean())
            passed = sum(holds_for_these(before, after, lost, rng) for _ in range(campaigns))
            what = f"these: a loss of {100 * lost:.3g} points, {manner}, on {paths} paths passes"
            yield Finding(what, passed, campaigns, most=0.025)
        before = rng.beta(8.0, 2.0, paths)
        passed = sum(holds_for_these(before, before, margin, rng) for _ in range(campaigns))
        yield Finding(f"these: no loss, other noise, on {paths} paths, passes {100 * margin:g}", passed, campaigns)
    for manner in MANNERS:
        before, after = rates(manner, 0.1, 20, rng, exact=True)
        caught = sum(not holds_for_these(before, after, 0.02, rng) for _ in range(campaigns))
        what = f"these: a loss of 10 points, {manner}, on 20 paths fails a margin of 2"
        yield Finding(what, caught, campaigns, least=0.95)
    for pairs in (183, 480, 4800):
        yield Finding(
            f"these: {pairs} pairs that all end alike pass a margin of 2", lower_end(0, 0, pairs) > -0.02, 1, least=1.0
        )


def main() -> int:
    parser = parser_of(__doc__)
    parser.add_argument("--campaigns", type=int, default=2000, metavar="N", help="of each kind")
    options = parser.parse_args()
    return printed(enumerate((others, these)), options.campaigns, 18)


if __name__ == "__main__":
    raise SystemExit(main())
