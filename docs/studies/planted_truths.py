"""Planted truths are found, and nothing is found where nothing was planted.

Campaigns are drawn with known success rates, and the statistics of `vastflow.oracles.statistics` are asked for what was put in:

- *classes*: of configurations of known rates, how many claims are wrong, and how many are found;
- *factors*: a harmful factor and an interaction in a campaign of paths, maps and settings, whose configurations differ and share paths; how
  often they are found, whether intervals hold the truth, and how often something is found that is not there;
- *contrasts*, *crossed*, *responses*: what is shown on a campaign's situations and on others, of how many situations, levels and points; where
  situations respond differently, how often an interaction is claimed that is not there;
- *lengths*: a failure rate that rises with the length of the path, in campaigns whose paths differ, and one that does not;
- *stopping*: errors and runs of the sequential rule, drawn, beside those that are computed;
- *comparison*: how often a campaign against itself, with other noise, looks changed, and how often a loss is found;
- *gate_others*, *gate_these*: how often the gate passes a campaign whose success rate loses exactly the margin, each path as much (spread),
  one path in five five times as much (concentrated), or as many paths as make the margin everything (total). Of `others` the paths are
  drawn anew for each campaign; of `these` they stay. Runs of a pair are drawn independently, which is the worst that equal seeds may do.

    python docs/studies/planted_truths.py [--campaigns 1000] [PART ...]

Prints a table; exit code 1 where a rate of errors is above what is stated, by more than four standard errors of the simulation.
"""

import math
import time
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from functools import cache
from itertools import product
from typing import Any, Final

import numpy as np
from missions import parser_of
from numpy.typing import NDArray

from vastflow.oracles.results.factors import factors_of
from vastflow.oracles.statistics.analysis import FactorAnalysis, factor_analysis
from vastflow.oracles.statistics.classes import CLAIMS, ClassBounds, StoppingRule, classify
from vastflow.oracles.statistics.comparison import Pairs, changes, difference
from vastflow.oracles.statistics.intervals import mean_interval, needed

Floats = NDArray[np.float64]
Part = Callable[[int, np.random.Generator], Iterator["Finding"]]


@dataclass(frozen=True)
class Finding:
    """One rate of the simulation.

    Attributes:
        of: Number of cases that `times` is counted among.
        most: Upper limit of the rate, beside simulation noise; None for a rate that is only reported.
        least: Lower limit of the rate, likewise.
    """

    what: str
    times: float
    of: int
    most: float | None = None
    least: float | None = None

    @property
    def rate(self) -> float:
        return self.times / self.of if self.of else 0.0

    @property
    def good(self) -> bool:
        def noise(p: float) -> float:
            return 4 * math.sqrt(max(p * (1 - p), 0.0) / max(self.of, 1))

        low_enough = self.most is None or self.rate <= self.most + noise(self.most)
        return low_enough and (self.least is None or self.rate >= self.least - noise(self.least))

    def __str__(self) -> str:
        bound = "" if self.most is None else f"at most {self.most:.3f}"
        bound += "" if self.least is None else f"at least {self.least:.3f}"
        return f"{self.what:76}{self.rate:8.4f} of {self.of:<7}{bound:18}{'' if self.good else '  NOT GOOD'}"


def classes(campaigns: int, rng: np.random.Generator) -> Iterator[Finding]:
    """Simulate campaigns of 400 configurations with known rates, and count wrong classes."""
    rates = np.repeat([0.0, 0.1, 0.3, 0.5, 0.9, 1.0], [60, 40, 60, 60, 80, 100])
    true = ClassBounds().of(rates)
    for runs, least in ((20, (1.0, 0.1, 1.0)), (60, (1.0, 0.97, 1.0))):
        shares = np.zeros(len(CLAIMS))
        found = np.zeros((len(CLAIMS), 2))
        for _ in range(campaigns):
            claims = claims_of(rng.binomial(runs, rates), runs)
            for k in range(len(CLAIMS)):
                shares[k] += wrong_share(claims, true, k)
                planted = np.isin(rates, ([0.0], [0.5], [1.0])[k])
                found[k] += (claims[planted] == k).sum(), planted.sum()
        for name, share in zip(CLAIMS, shares, strict=True):
            yield Finding(f"classes: share of {name} claims that are wrong, {runs} runs", share, campaigns, most=0.05)
        for name, (times, of), at_least in zip(CLAIMS, found, least, strict=True):
            what = f"classes: {name} at its clearest (rates 0, 0.5, 1) is called so, {runs} runs"
            yield Finding(what, times, int(of), least=at_least)
    mixed = (claims_of(np.r_[np.zeros(40), rng.binomial(20, 0.9, 360)], 20) for _ in range(campaigns))
    never, what = sum((claims[:40] == 0).sum() for claims in mixed), "total failures among 90 % with a rate of 0.9"
    yield Finding(f"classes: {what} are systematic", never, 40 * campaigns, least=0.99)
    wrong = sum((claims_of(rng.binomial(20, np.full(50, 0.2)), 20) > 0).any() for _ in range(campaigns))
    yield Finding("classes: any wrong claim where all are on a bound", wrong, campaigns, most=0.05)
    near = np.repeat([0.2001, 0.5, 0.7999], [134, 133, 133])
    shares = np.zeros(len(CLAIMS))
    for _ in range(campaigns):
        claims = claims_of(rng.binomial(60, near), 60)
        shares += [wrong_share(claims, ClassBounds().of(near), k) for k in range(len(CLAIMS))]
    for name, share in zip(CLAIMS, shares, strict=True):
        yield Finding(f"classes: wrong {name} claims, two thirds flaky next to a bound", share, campaigns, most=0.05)


def claims_of(passed: NDArray[Any], runs: int) -> NDArray[np.int64]:
    """Index in `CLAIMS` of the class of each configuration; -1 where it is undecided."""
    names = classify(passed, np.full(len(passed), runs)).names
    return np.array([CLAIMS.index(name) if name in CLAIMS else -1 for name in names])


def wrong_share(claims: NDArray[np.int64], true: NDArray[np.intp], claim: int) -> float:
    """Share of wrongly classified configurations among those of a class."""
    called = claims == claim
    return float((called & (true != claim)).sum() / max(called.sum(), 1))


def a_campaign(
    rng: np.random.Generator, harm: float, together: float, spread: float
) -> tuple[list[dict[str, Any]], Floats, NDArray[np.int64], NDArray[np.int64]]:
    """Draw levels, failure rates, and failures of a crossed design with 10 runs each.

    `harm` is added to the failure rate at 3 obstacles, `together` at the high noise with the high speed; paths and configurations
    differ by beta distributions whose spread is `spread`.
    """
    settings = list(product((0, 1, 3), (0.0, 0.1), (0.2, 0.5)))
    names = ("map", "obstacles", "noise", "speed")
    rows = [
        dict(zip(names, (where, *each), strict=True)) for where in np.repeat([*"ABCD"], 4).tolist() for each in settings
    ]
    block = np.repeat(np.arange(16), len(settings))
    planted = np.array(
        [0.15 + harm * (r["obstacles"] == 3) + together * (r["noise"] * r["speed"] == 0.05) for r in rows]
    )
    path_rate = rng.beta(0.5 * (1 - spread) / spread, 0.5 * (1 - spread) / spread, block.max() + 1)[block]
    mixed = np.clip(planted + 0.3 * planted * (1 - planted) * (2 * path_rate - 1), 1e-6, 1 - 1e-6)
    size = (1 - spread) / spread
    rates = rng.beta(mixed * size, (1 - mixed) * size)
    return rows, planted, rng.binomial(10, rates), block


def analyzed(
    rows: list[dict[str, Any]], failed: NDArray[np.int64], block: NDArray[np.int64], runs: int = 10
) -> FactorAnalysis:
    found = factor_analysis(factors_of(rows)[0], runs - failed, np.full(len(rows), runs), block)
    assert found is not None
    return found


def factors(campaigns: int, rng: np.random.Generator) -> Iterator[Finding]:
    """Campaigns with a harmful factor and an interaction, and with nothing."""
    planted, pair = frozenset({"obstacles", "noise", "speed"}), {"noise", "speed"}
    harmful = interacting = false = paired = 0
    for _ in range(campaigns):
        rows, _, failed, block = a_campaign(rng, harm=0.25, together=0.35, spread=0.2)
        found = analyzed(rows, failed, block)
        significant = {effect.name: effect for effect in found.factors if effect.others.shown}
        pairs = [set(effect.names) for effect in found.interactions if effect.claim.shown]
        harmful += "obstacles" in significant
        interacting += pair in pairs
        false += bool(set(significant) - planted)
        paired += any(names != pair for names in pairs)
    yield Finding("factors: the harmful factor (+0.25) is found", harmful, campaigns, least=0.9)
    yield Finding("factors: the interaction (+0.35 in one of four cells) is found", interacting, campaigns, least=0.9)
    yield Finding("factors: another factor is found, beside what was planted", false, campaigns, most=0.05)
    yield Finding("factors: another pair is found, beside what was planted", paired, campaigns, most=0.05)
    for spread, words in ((0.05, "alike"), (0.2, "different"), (0.6, "all or nothing")):
        nothing = 0
        for _ in range(campaigns):
            rows, _, failed, block = a_campaign(rng, harm=0.0, together=0.0, spread=spread)
            nothing += any(effect.others.shown for effect in analyzed(rows, failed, block).factors)
        yield Finding(
            f"factors: anything is found where nothing is, configurations {words}", nothing, campaigns, most=0.05
        )


def contrasts(campaigns: int, rng: np.random.Generator) -> Iterator[Finding]:
    """Plant one harmful level on situations with beta-distributed failure rates, 5 runs each."""
    for levels, situations, points in product((2, 3), (4, 6, 10, 20), (0.0, 0.1, 0.3, 1.0)):
        block = np.repeat(np.arange(situations), levels)
        level = np.tile(np.arange(levels), situations)
        found = np.zeros(2)
        for _ in range(campaigns):
            base = 0.0 if points == 1.0 else rng.beta(0.5, 4.5, situations)[block]
            failed = rng.binomial(5, np.clip(base + points * (level == levels - 1), 0, 1))
            (effect,) = analyzed([{"a": int(k)} for k in level], failed, block, 5).factors
            found += effect.these.shown, effect.others.shown
        for times, words in zip(found, ("these", "others"), strict=True):
            surely = points == 1 and (words == "these" or situations > 4)
            what = f"contrasts: {situations} situations, {levels} levels, {100 * points:.0f} points, {words}"
            yield Finding(what, times, campaigns, most=None if points else 0.05, least=1.0 if surely else None)


def crossed(campaigns: int, rng: np.random.Generator) -> Iterator[Finding]:
    """Three crossed factors of two levels, one of which acts by 30 points; and situations that respond differently to one."""
    rows = [{"a": a, "b": b, "c": c} for _ in range(4) for a, b, c in product((0, 1), repeat=3)]
    block = np.repeat(np.arange(4), 8)
    harm = np.array([row["a"] for row in rows])
    found, false = 0, np.zeros(2)
    for _ in range(campaigns):
        base = rng.beta(0.5, 4.5, 4)[block]
        effects = {
            e.name: e for e in analyzed(rows, rng.binomial(5, np.clip(base + 0.3 * harm, 0, 1)), block, 5).factors
        }
        found += effects["a"].these.shown
        quiet = [effects["b"], effects["c"]]
        false += any(e.these.shown for e in quiet), any(e.others.shown for e in quiet)
    yield Finding("crossed: the one that acts by 30 points, these", found, campaigns, least=0.9)
    yield Finding("crossed: any of the two that do nothing, these", false[0], campaigns, most=0.05)
    yield Finding("crossed: any of the two that do nothing, others", false[1], campaigns, most=0.05)


def responses(campaigns: int, rng: np.random.Generator) -> Iterator[Finding]:
    """Situations that respond differently to a factor, whatever their path length; and by 50 points more where it is long."""
    for situations, settings, levels in product((24, 12, 6), (4, 1), (2, 3)):
        for more in (0.0, 0.5):
            shown = 0
            rows = [
                {"length": 5 * (1 + s % 2), "a": a, "b": b}
                for s in range(situations)
                for a, b in product(range(levels), range(settings))
            ]
            block = np.repeat(np.arange(situations), levels * settings)
            a, long = (np.array([row[name] for row in rows]) for name in ("a", "length"))
            for _ in range(campaigns):
                slope = rng.uniform(-0.3, 0.3, situations)[block] + more * (long > 5)
                failed = rng.binomial(10, np.clip(0.35 + slope * a / (levels - 1), 0, 1))
                pairs = analyzed(rows, failed, block).interactions
                shown += any(pair.claim.shown for pair in pairs if more == 0 or set(pair.names) == {"a", "length"})
            what = f"responses: {situations} situations, {settings} settings, {levels} levels: an interaction"
            told = "that is not there" if more == 0 else "of 50 points"
            yield Finding(f"{what} {told}", shown, campaigns, **({"most": 0.05} if more == 0 else {}))


def lengths(campaigns: int, rng: np.random.Generator) -> Iterator[Finding]:
    """Simulate campaigns of 24 paths on 3 maps with 4 settings each, 10 runs."""
    for rise, words in ((0.0, "none"), (0.05, "0.05 a metre")):
        found = held = other = 0
        for _ in range(campaigns):
            wanted = np.tile([5.0, 10.0, 15.0], 8)
            meters = wanted + rng.uniform(-0.3, 0.3, 24)
            planted = np.clip(0.05 + rise * meters, 0.0, 1.0)
            of_path = rng.beta(planted * 6, (1 - planted) * 6)
            rows = [
                {"map": "ABC"[k // 8], "setting": s, "path length (m)": float(meters[k])}
                for k in range(24)
                for s in range(4)
            ]
            path = np.repeat(np.arange(24), 4)
            rates = np.clip(of_path, 1e-3, 1 - 1e-3)[path]
            failed = rng.binomial(10, rng.beta(rates * 20, (1 - rates) * 20))
            effects = {effect.name: effect for effect in analyzed(rows, failed, path).factors}
            length = effects["path length (m)"]
            assert length.trend is not None
            found += length.others.shown
            other += any(effect.others.shown for name, effect in effects.items() if name != length.name)
            low, high = length.trend.change_interval
            held += low <= rise * (length.trend.greatest - length.trend.smallest) <= high
        bound = {"most": 0.05} if rise == 0 else {"least": 0.85}
        yield Finding(f"lengths: path length is found to matter, planted {words}", found, campaigns, **bound)
        yield Finding(f"lengths: something else is, planted {words}", other, campaigns, most=0.05)
        yield Finding(f"lengths: the interval of the slope holds it, planted {words}", held, campaigns, least=0.93)


def rare(campaigns: int, rng: np.random.Generator) -> Iterator[Finding]:
    """Simulate campaigns without effects, with few failures and unequal levels."""
    rows = [{"a": "small" if k < 30 else "large", "b": k % 3} for k in range(600)]
    false = 0
    for _ in range(campaigns):
        failed = np.where(rng.random(len(rows)) < 0.015, rng.integers(1, 11, len(rows)), 0)
        found = analyzed(rows, failed, np.arange(len(rows)))
        false += any(effect.others.shown for effect in found.factors)
        false += any(effect.claim.shown for effect in found.interactions)
    yield Finding(
        "factors: anything is found where failures are rare and a level is small", false, campaigns, most=0.05
    )


def stopping(campaigns: int, rng: np.random.Generator) -> Iterator[Finding]:
    """The sequential rule against its computed characteristics."""
    rule, configurations = StoppingRule(5, 40), 20
    for p in (0.02, 0.2, 0.2001, 0.5, 0.8, 0.97):
        expected = rule.operating_characteristics([p])
        true = CLAIMS[int(ClassBounds().of(np.array([p]))[0])]
        wrong, runs = 0, 0
        for _ in range(campaigns * configurations):
            passed = np.cumsum(rng.random(rule.max_runs) < p)
            said = rule.decisions(passed, np.arange(1, rule.max_runs + 1))
            end = next(n for n, name in enumerate(said, 1) if name is not None)
            wrong += said[end - 1] not in (true, "undecided")
            runs += end
        of = campaigns * configurations
        computed = f"computed {expected.wrong[0]:.4f}, runs {runs / of:.2f} for {expected.expected_runs[0]:.2f}"
        yield Finding(f"stopping: a wrong class at p = {p:g} ({computed})", wrong, of, most=0.05)


def comparison(campaigns: int, rng: np.random.Generator) -> Iterator[Finding]:
    """A campaign of 100 configurations × 20 runs against itself with other noise, and against one that lost something.

    A last comparison is of 25 paths with 4 settings each, whose paths gain and lose, all their settings alike, and nothing on the whole.
    """
    configuration = np.repeat(np.arange(100), 20)
    held = false = found = of = shared = 0
    for _ in range(campaigns):
        rates = rng.beta(4.0, 0.5, 100)
        before, after = (rng.random(2000) < rates[configuration] for _ in range(2))
        same = difference(Pairs(configuration, before, after))
        assert same is not None
        held += same.interval[0] <= 0.0 <= same.interval[1]
        false += any(change.shown for change in changes(Pairs(configuration, before, after)))
        lost = rates - np.where(np.arange(100) < 10, 0.95 * rates, 0.0)
        after = rng.random(2000) < lost[configuration]
        shown = {change.configuration for change in changes(Pairs(configuration, before, after)) if change.shown}
        found, of = found + len(shown & set(range(10))), of + 10
        gain = np.repeat(rng.uniform(-0.3, 0.3, 25), 4)
        before, after = rng.random(2000) < 0.6, rng.random(2000) < (0.6 + gain)[configuration]
        on_paths = difference(Pairs(configuration, before, after, configuration // 4), "others")
        assert on_paths is not None
        shared += on_paths.interval[0] <= 0.0 <= on_paths.interval[1]
    yield Finding(
        "comparison: the interval holds no difference where paths gain and lose", shared, campaigns, least=0.94
    )
    yield Finding("comparison: the interval holds no difference", held, campaigns, least=0.95)
    yield Finding("comparison: any configuration seems changed where none is", false, campaigns, most=0.05)
    yield Finding("comparison: configurations that lost 95 % of their rate are found", found, of, least=0.75)


GATE_RUNS: Final = 20
MANNERS: Final = ("spread", "concentrated", "total")
OTHERS: Final = ((0.1, 36), (0.1, 100), (0.02, 183), (0.02, 500))
"""Margins, and numbers of paths that suffice for them."""
THESE: Final = ((0.1, 8), (0.1, 40), (0.02, 24), (0.02, 150))


def gate_rates(
    manner: str, margin: float, paths: int, rng: np.random.Generator, *, exact: bool
) -> tuple[Floats, Floats]:
    """Success rates of paths before and after a loss of `margin` on the mean.

    Args:
        exact: Whether the mean of these very paths loses `margin`; else that of the kind that they are drawn from.
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
    change = (rng.binomial(GATE_RUNS, after) - rng.binomial(GATE_RUNS, before)) / GATE_RUNS
    return mean_interval(change)[0] > -margin


def holds_for_these(before: Floats, after: Floats, margin: float, rng: np.random.Generator) -> bool:
    """Likewise, each pair of runs one draw."""
    then, now = (rng.random((GATE_RUNS, len(before))) < each for each in (before, after))
    return lower_end(int((then & ~now).sum()), int((now & ~then).sum()), then.size) > -margin


@cache
def lower_end(lost: int, gained: int, pairs: int) -> float:
    """Width of the interval of this number of pairs."""
    return mean_interval(np.repeat([-1.0, 0.0, 1.0], [lost, pairs - lost - gained, gained]))[0]


def gate_others(campaigns: int, rng: np.random.Generator) -> Iterator[Finding]:
    """Losses of the margin, none, and of ten points, on paths that are drawn anew."""
    for margin, paths in OTHERS:
        assert (needed(margin) or 0) <= paths
        for manner in MANNERS:
            passed = sum(
                holds_for_others(*gate_rates(manner, margin, paths, rng, exact=False), margin, rng)
                for _ in range(campaigns)
            )
            what = f"gate of others: a loss of {100 * margin:g} points, {manner}, on {paths} paths passes"
            yield Finding(what, passed, campaigns, most=0.025)
        same = [rng.beta(8.0, 2.0, paths) for _ in range(campaigns)]
        yield Finding(
            f"gate of others: no loss, on {paths} paths, passes a margin of {100 * margin:g}",
            sum(holds_for_others(each, each, margin, rng) for each in same),
            campaigns,
        )


def gate_these(campaigns: int, rng: np.random.Generator) -> Iterator[Finding]:
    """The same on paths that stay; and a loss of ten points under a margin of two."""
    for margin, paths in THESE:
        for manner in MANNERS:
            if manner == "total" and round(margin * paths) != margin * paths:
                continue
            before, after = gate_rates(manner, margin, paths, rng, exact=True)
            lost = float((before - after).mean())
            passed = sum(holds_for_these(before, after, lost, rng) for _ in range(campaigns))
            what = f"gate of these: a loss of {100 * lost:.3g} points, {manner}, on {paths} paths passes"
            yield Finding(what, passed, campaigns, most=0.025)
        before = rng.beta(8.0, 2.0, paths)
        passed = sum(holds_for_these(before, before, margin, rng) for _ in range(campaigns))
        yield Finding(
            f"gate of these: no loss, other noise, on {paths} paths, passes {100 * margin:g}", passed, campaigns
        )
    for manner in MANNERS:
        before, after = gate_rates(manner, 0.1, 20, rng, exact=True)
        caught = sum(not holds_for_these(before, after, 0.02, rng) for _ in range(campaigns))
        what = f"gate of these: a loss of 10 points, {manner}, on 20 paths fails a margin of 2"
        yield Finding(what, caught, campaigns, least=0.95)
    for pairs in (183, 480, 4800):
        yield Finding(
            f"gate of these: {pairs} pairs that all end alike pass a margin of 2",
            lower_end(0, 0, pairs) > -0.02,
            1,
            least=1.0,
        )


PARTS: Mapping[Part, tuple[int, int]] = {
    part: (7, k)
    for k, part in enumerate((classes, factors, lengths, rare, stopping, comparison, contrasts, crossed, responses))
} | {gate_others: (18, 0), gate_these: (18, 1)}
"""Parts and their seeds."""


def main() -> int:
    parser = parser_of(__doc__)
    parser.add_argument("--campaigns", type=int, default=1000, metavar="N", help="of each kind")
    parser.add_argument("parts", nargs="*", metavar="PART", help="those named only")
    options = parser.parse_args()
    good = True
    for part, seed in PARTS.items():
        if not options.parts or part.__name__ in options.parts:
            began_s = time.process_time()
            for finding in part(options.campaigns, np.random.default_rng(seed)):
                print(finding, flush=True)
                good &= finding.good
            print(f"{part.__name__}: {time.process_time() - began_s:.0f} s CPU\n", flush=True)
    return 0 if good else 1


if __name__ == "__main__":
    raise SystemExit(main())
