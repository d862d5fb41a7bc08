"""Measure what `vastflow compare --until-decided` decides, and how many runs it takes, where the truth is planted.

Pairs of campaigns are drawn: configurations with rates of their own, paired runs that share their noise or not, and a difference that is spread
over all configurations, or falls on one in five, or hides behind larger ones of either sign. After each round the wealth against every claim is
looked at, as the product looks, and the runs end at the first claim. For each kind of pair are told:

- *false*: how often the runs ended with a false claim: B worse or better where it is not, a loss of the margin ruled out or shown where it is not;
- *missed*: how often the interval missed the difference at any look, whether the runs had ended or not;
- *right*, *open*: how often they ended with true claims alone, and with none;
- *rounds*: mean number of rounds, beside those of the plan, and beside the fewest after which fixed intervals, looked at once, claim as often.

In rows named *shared* groups of five configurations share their noise, as settings on one path do: their pairs are bets on sums. In those named
*ignored* they do, and are taken as independent, which is wrong.

    python docs/studies/sequential_comparison.py [--campaigns 400] [--json FILE]

Exit code 1 where false claims exceed 5 % by more than three standard errors, in any row that is not *ignored*.
"""

import argparse
import json
import math
import sys
from collections.abc import Iterator
from dataclasses import asdict, dataclass
from itertools import product
from typing import Final, TypeAlias

import numpy as np
from numpy.typing import NDArray

from vastflow.oracles.statistics.intervals import mean_interval, wilson
from vastflow.oracles.statistics.sequential import interval_at_any_look, log_wealth

Floats: TypeAlias = NDArray[np.float64]
ERROR: Final = 0.05
SEED: Final = 2911
THRESHOLD: Final = math.log(2.0 / ERROR)
FEW: Final = 100
"""Campaigns of a row that fixed intervals are computed of."""
KINDS: Final = ("spread", "one in five", "opposite", "shared", "ignored")
SIZES: Final = ((10, 0.05), (50, 0.05), (200, 0.02))
"""Numbers of configurations, and margins."""


@dataclass(frozen=True)
class Planted:
    """A kind of pair of campaigns; `alike` is the share of pairs whose runs share their noise."""

    kind: str
    configurations: int
    rounds: int
    margin: float
    difference: float
    alike: float = 0.8

    def rates(self, rng: np.random.Generator) -> tuple[Floats, Floats]:
        """Rates of passing (m,) before and after, whose means differ by `difference`."""
        m, d = self.configurations, self.difference
        before = rng.uniform(0.35, 0.65, m)
        if self.kind == "one in five":
            before = rng.choice((1.0, 0.95, 0.7, 0.0), m, p=(0.5, 0.2, 0.15, 0.15))
            hit = np.arange(m) % 5 == 0
            before[hit] = 0.95 if d < 0 else 0.05
            return before, before + 5 * d * hit
        away = 0.3 * (-1.0) ** np.arange(m) if self.kind == "opposite" else 0.0
        return before, before + d + away

    def drawn(self, campaigns: int, rng: np.random.Generator) -> NDArray[np.int64]:
        """Counts (campaigns, rounds, sums) of seeds by the sum of their pairs, up to each round."""
        counts = []
        for _ in range(campaigns):
            before, after = self.rates(rng)
            noise = rng.random((3, self.rounds, self.configurations))
            if self.kind in ("shared", "ignored"):
                noise = np.repeat(noise[:, :, ::5], 5, axis=2)
            change = (np.where(noise[2] < self.alike, noise[0], noise[1]) < after) * 1 - (noise[0] < before)
            sums = change.reshape(self.rounds, -1, self.size).sum(axis=-1)
            counts.append(np.stack([(sums == value).sum(axis=1) for value in self.sums], axis=-1).cumsum(axis=0))
        return np.array(counts)

    @property
    def size(self) -> int:
        """Pairs of one seed."""
        return 5 if self.kind == "shared" else 1

    @property
    def sums(self) -> Floats:
        """Possible sums of a seed's pairs."""
        return np.arange(-self.size, self.size + 1.0)


@dataclass(frozen=True)
class Measured:
    """Shares of campaigns, and mean rounds; `fixed` is None where no fixed plan of that length claims as often."""

    planted: Planted
    campaigns: int
    false: float
    missed: float
    right: float
    open: float
    rounds: float
    fixed: int | None

    @property
    def good(self) -> bool:
        return self.planted.kind == "ignored" or self.false <= ERROR + 3 * math.sqrt(
            ERROR * (1 - ERROR) / self.campaigns
        )

    def __str__(self) -> str:
        p = self.planted
        fixed = "   –" if self.fixed is None else f"{self.fixed:4}"
        return (
            f"{p.kind:12}{p.configurations:4} ×{p.rounds:3}{100 * p.margin:6.0f}{100 * p.difference:+7.1f}"
            f"{self.false:8.3f}{self.missed:8.3f}{self.right:8.3f}{self.open:8.3f}{self.rounds:8.1f} of{p.rounds:3}{fixed}"
            f"{'' if self.good else '  NOT GOOD'}"
        )


def claims(
    low_side: Floats, high_side: Floats, margin: float, true: float
) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
    """Whether any claim ends the runs, and whether a false one is among them, for ends of intervals."""
    lost, worse, better, ruled_out = high_side < -margin, high_side < 0.0, low_side > 0.0, low_side > -margin
    false = (
        (lost & (true >= -margin)) | (worse & (true >= 0)) | (better & (true <= 0)) | (ruled_out & (true <= -margin))
    )
    return worse | ruled_out, false


def measured(planted: Planted, campaigns: int, rng: np.random.Generator) -> Measured:
    """Draw pairs of campaigns, and look at each as the product does."""
    counts, true, margin = planted.drawn(campaigns, rng), planted.difference, planted.margin
    sizes = np.full(len(planted.sums), planted.size)

    def above(bound: float) -> NDArray[np.bool_]:
        return np.asarray(log_wealth(planted.sums, sizes, counts, bound) >= THRESHOLD)

    def below(bound: float) -> NDArray[np.bool_]:
        return np.asarray(log_wealth(planted.sums, sizes, counts[..., ::-1], -bound) >= THRESHOLD)

    # Ends that stand for the intervals': on the same side of each bound.
    low = np.where(above(0.0), 0.5, np.where(above(-margin), -margin / 2, -1.0))
    high = np.where(below(-margin), -0.9, np.where(below(0.0), -margin / 2, 1.0))
    ended, wrong = claims(low, high, margin, true)
    last = np.where(ended.any(axis=1), ended.argmax(axis=1), planted.rounds - 1)
    every = np.arange(campaigns)
    for k in range(0, campaigns, max(campaigns // 20, 1)):
        each = np.repeat(planted.sums / planted.size, counts[k, last[k]])
        found = interval_at_any_look(np.repeat(each, planted.size), np.repeat(np.arange(len(each)), planted.size))
        if (found[0] > -margin, found[1] < 0.0) != (low[k, last[k]] > -margin, high[k, last[k]] < 0.0):
            raise AssertionError(f"{planted}: {counts[k, last[k]]} has the interval {found}")
    decided, false = ended[every, last], wrong[every, last]
    missed = (above(true) | below(true)).any(axis=1)
    return Measured(
        planted,
        campaigns,
        float(false.mean()),
        float(missed.mean()),
        float((decided & ~false).mean()),
        float((~decided).mean()),
        float(last.mean() + 1),
        fewest_fixed(planted, counts[:FEW], float(decided.mean())),
    )


def fewest_fixed(planted: Planted, counts: NDArray[np.int64], share: float) -> int | None:
    """The fewest rounds of a fixed plan whose interval makes a claim in `share` of the campaigns, one value a seed."""
    values = planted.sums / planted.size

    def claiming(rounds: int) -> float:
        ends = np.array([mean_interval(np.repeat(values, each)) for each in counts[:, rounds - 1]])
        return float(claims(ends[:, 0], ends[:, 1], planted.margin, 0.0)[0].mean())

    low, high = 0, counts.shape[1]
    if share == 0.0 or claiming(high) < share:
        return None
    while high - low > 1:
        middle = (low + high) // 2
        low, high = (low, middle) if claiming(middle) >= share else (middle, high)
    return high


def rows() -> Iterator[Planted]:
    """Kinds of pairs: no difference, the margin, half of it, a large loss, and a gain."""
    for kind, (m, margin), rounds in product(KINDS, SIZES, (10, 50)):
        for times in (0.0, -0.5, -1.0, -3.0, 1.0):
            yield Planted(kind, m, rounds, margin, times * margin, 0.0 if kind == "opposite" else 0.8)


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--campaigns", type=int, default=400, help="pairs of campaigns of each kind")
    parser.add_argument("--json", metavar="FILE", help="write all numbers")
    options = parser.parse_args()
    rng, found = np.random.default_rng(SEED), []
    print("kind        configs × rounds margin  differs   false  missed   right    open  rounds      fixed")
    for planted in rows():
        found.append(measured(planted, options.campaigns, rng))
        print(found[-1], flush=True)
    right, ignored = ([one for one in found if (one.planted.kind == "ignored") == wrong] for wrong in (False, True))
    for name, those in (
        ("shared noise ignored", ignored),
        ("all others", right),
        ("no difference", [one for one in right if one.planted.difference == 0]),
        ("loss of the margin", [one for one in right if one.planted.difference == -one.planted.margin]),
        ("three margins lost", [one for one in right if one.planted.difference < -one.planted.margin]),
    ):
        n = sum(one.campaigns for one in those)
        false = round(sum(one.false * one.campaigns for one in those))
        ends, worst = wilson(false, n), max(one.false for one in those)
        spent = sum(one.rounds * one.planted.configurations for one in those)
        whole = sum(one.planted.rounds * one.planted.configurations for one in those)
        print(
            f"{name}: {false} of {n} end falsely ({100 * ends.low:.2f} to {100 * ends.high:.2f} %), at most {worst:.3f} of a row; "
            f"{np.mean([one.open for one in those]):.2f} undecided; {100 * spent / whole:.0f} % of the plan's runs"
        )
    if options.json:
        with open(options.json, "w") as file:
            json.dump([asdict(one) for one in found], file)
    sys.exit(not all(one.good for one in found))


if __name__ == "__main__":
    main()
