"""Recount what the report says of factors, on campaigns with known effects.

- *units* (others): paths respond differently to a factor that has no mean effect; an effect for others is claimed at most in 5 %. Start and
  goal pairs repeat on several maps, or a path on many maps.
- *trends*: intervals of the change over a number hold the population's, total effects included, and none that is told beside a claim holds 0.
- *power*: shares of campaigns in which an effect is shown on these situations, and for others; and the share at the least effect that
  `power_of` promises.
- *metrics*: claims where nothing differs, with and without runs that fail, and where paths respond differently; shares of a shown effect.

    PYTHONPATH=.package python docs/studies/truth_factors.py [--campaigns 500] [--workers N] [--json FILE] [PART ...]

Prints a table with the standard error of each figure. Exit code 1 where false claims exceed 0.06, or coverage is below 0.93, by more than two
standard errors. Needs numpy and scipy.
"""

import argparse
import json
import math
import time
from collections.abc import Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import asdict, dataclass
from itertools import product
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from vastflow.oracles.results.factors import factors_of
from vastflow.oracles.results.units import units_of
from vastflow.oracles.statistics.analysis import FactorAnalysis, factor_analysis
from vastflow.oracles.statistics.measured import Runs, metric_effects
from vastflow.oracles.statistics.power import power_of

SEED: Final = 3_911_207
"""Seed of the judging campaigns; those that chose the methods had seeds below 1,000."""
FALSE, COVERED, PROMISED = 0.06, 0.93, 0.7
_CHUNK: Final = 50
Floats = NDArray[np.float64]


@dataclass(frozen=True)
class Cell:
    """One kind of campaign: a function of this module, and its arguments."""

    part: str
    arguments: tuple[Any, ...]


@dataclass(frozen=True)
class Figure:
    """A share of campaigns, or of what `of` counts.

    Attributes:
        kind: `false` claims and `covered` truths are judged, and `promised` power; `told` are not.
    """

    part: str
    cell: str
    what: str
    kind: str
    times: int
    of: int

    @property
    def rate(self) -> float:
        return self.times / self.of if self.of else 0.0

    @property
    def error(self) -> float:
        return math.sqrt(max(self.rate * (1 - self.rate), 0.25 / max(self.of, 1)) / max(self.of, 1))

    @property
    def good(self) -> bool:
        if self.kind == "false":
            return self.rate - 2 * self.error <= FALSE
        least = {"covered": COVERED, "promised": PROMISED}.get(self.kind, 0.0)
        return self.of == 0 or self.rate + 2 * self.error >= least

    def __str__(self) -> str:
        bad = "" if self.good else "  NOT GOOD"
        return f"{self.part:8} {self.cell:52} {self.what:34} {self.rate:6.3f} ± {self.error:.3f} of {self.of}{bad}"


Counts = dict[tuple[str, str], list[int]]


def _count(found: Counts, what: str, kind: str, is_so: bool) -> None:
    times = found.setdefault((what, kind), [0, 0])
    times[0] += is_so
    times[1] += 1


def _analyzed(
    rows: Sequence[dict[str, Any]],
    failed: NDArray[np.int64],
    units: NDArray[np.int64],
    sets: NDArray[np.int64] | None = None,
) -> FactorAnalysis:
    of = None if sets is None else {"a": sets}
    found = factor_analysis(factors_of(rows)[0], 5 - failed, np.full(len(rows), 5), units, sets=of)
    assert found is not None
    return found


def _scenario(place: int, path: int) -> dict[str, Any]:
    return {"environment": {"map_file": {"file": f"{place}"}}, "task": {"goal_pose": {"x": path}}, "system": {}}


def units(rng: np.random.Generator, found: Counts, paths: int, maps: int, levels: int, responds: str) -> None:
    """A factor whose effect differs between paths, or maps, by 0.2, and is 0 on average."""
    places = list(product(range(paths), range(maps), range(levels)))
    path, place, level = np.array(places).T
    slopes = rng.normal(0.0, 0.2, maps if responds == "map" else paths)
    slope = slopes[place if responds == "map" else path]
    failed = rng.binomial(5, np.clip(0.5 + slope * (level / (levels - 1) - 0.5), 0, 1))
    of = units_of([_scenario(m, p) for p, m, _ in places])
    assert of.noun == responds
    (effect,) = _analyzed([{"a": f"l{k}"} for k in level], failed, of.codes, path * maps + place).factors
    _count(found, f"claimed for other {of.others}", "false", effect.others.shown)


def trends(rng: np.random.Generator, found: Counts, paths: int, change: float, differ: float, within: bool) -> None:
    """A failure rate that changes over a number, of three levels on each path, or of one on each."""
    level = np.tile([0, 1, 2], paths) if within else np.arange(paths) % 3
    path = np.repeat(np.arange(paths), 3) if within else np.arange(paths)
    base = 0.0 if change == 1.0 else rng.uniform(0.1, 0.5, paths)[path]
    slope = change + differ * rng.uniform(-1, 1, paths)[path]
    failed = rng.binomial(5, np.clip(base + slope * level / 2, 0, 1))
    (effect,) = _analyzed([{"a": float(k)} for k in level], failed, path).factors
    if effect.trend is not None:
        low, high = effect.trend.change_interval
        _count(found, "interval holds the change", "covered", low <= change <= high)
        if effect.others.shown:
            _count(found, "of those shown, interval holds 0", "told", low <= 0 <= high)
            if effect.trend.shown:
                _count(found, "of those told, interval holds 0", "false", low <= 0 <= high)


def power(rng: np.random.Generator, found: Counts, paths: int, levels: int, effect: float) -> None:
    """One level that fails more, alike on all paths."""
    level, path = np.tile(np.arange(levels), paths), np.repeat(np.arange(paths), levels)
    base = np.zeros(paths) if effect == 1.0 else rng.beta(1.2, 4.2, paths)
    failed = rng.binomial(5, np.minimum(base[path] + effect * (level == levels - 1), 1))
    (shown,) = _analyzed([{"a": f"l{k}"} for k in level], failed, path).factors
    kind = "told" if effect else "false"
    _count(found, "shown on these", kind, shown.these.shown)
    _count(found, "shown for others", kind, shown.others.shown)


def promised(rng: np.random.Generator, found: Counts, paths: int, levels: int, others: bool) -> None:
    """The least effect that `power_of` promises."""
    least = power_of(paths, levels, 5)
    effect = least.others if others else least.these
    assert effect is not None
    counts: Counts = {}
    power(rng, counts, paths, levels, effect)
    (times, of) = counts["shown for others" if others else "shown on these", "told"]
    _count(found, f"{100 * effect:.0f} points {'for others' if others else 'on these'}", "promised", times == of)


def metrics(
    rng: np.random.Generator, found: Counts, paths: int, failing: float, responds: float, slower: float
) -> None:
    """Three controllers and two clutters, three runs: four metrics, which vary by path and run.

    Args:
        failing: The controllers' share of failed runs on the hardest path: none, half, and all of it.
        responds: Deviation of the controllers' effect between paths, in deviations of a run.
        slower: Effect of the first controller on the first metric, likewise.
    """
    cells = np.array(list(product(range(paths), range(2), range(3))))
    path, clutter, controller = cells.T
    of_run, number = np.repeat(np.arange(len(cells)), 3), np.tile(np.arange(3), len(cells))
    hard = np.sort(rng.random(paths))
    reached = rng.random(len(of_run)) >= (failing * hard[path] * controller / 2)[of_run]
    values = {}
    for k in range(4):
        level = rng.normal(0, 2, paths)[path] + responds * rng.normal(0, 1, (paths, 3))[path, controller]
        level += slower * (k == 0) * (controller == 0)
        noise = rng.gamma(1.0, 1.0, len(of_run)) if k % 2 else rng.normal(0, 1, len(of_run))
        values[f"m{k}"] = ("s", level[of_run] + noise)
    rows = [{"controller": f"c{c}", "clutter": int(b)} for _, b, c in cells]
    sets = {"controller": path * 2 + clutter, "clutter": path * 3 + controller}
    effects = metric_effects(factors_of(rows)[0], sets, path, Runs(of_run, number, reached, values))
    truly = [each for each in effects if slower and (each.name, each.metric) == ("controller", "m0")]
    rest = [each for each in effects if each not in truly]
    if not responds:  # else the controllers do differ on these paths
        _count(found, "any false claim on these", "false", any(each.these.shown for each in rest))
    _count(found, "any false claim for others", "false", any(each.others.shown for each in rest))
    for each in truly:
        _count(found, "shown on these", "told", each.these.shown)
        _count(found, "shown for others", "told", each.others.shown)
    for each in effects:
        if each.interval is not None and not failing:
            high, low = (each.levels[int(end(each.means))] == "c0" for end in (np.argmax, np.argmin))
            truth = slower * (each in truly) * (int(high) - int(low))
            _count(found, "interval holds the difference", "covered", each.interval[0] <= truth <= each.interval[1])


PARTS: Final[dict[str, list[tuple[Any, ...]]]] = {
    "units": [
        *((paths, maps, levels, "path") for levels in (2, 3) for paths, maps in ((6, 1), (6, 3), (8, 3), (8, 5))),
        *((paths, maps, 2, "map") for paths, maps in ((1, 8), (3, 8))),
    ],
    "trends": [
        *((paths, change, differ, True) for paths in (6, 18) for change, differ in ((0.0, 0.0), (0.3, 0.0), (0.3, 0.2), (1.0, 0.0))),
        *((24, change, 0.0, False) for change in (0.0, 0.3, 1.0)),
    ],
    "power": [*product((4, 6, 10, 20), (2, 3), (0.0, 0.1, 0.3, 0.5, 1.0))],
    "promised": [(paths, levels, others) for paths, levels in product((6, 10, 20), (2, 3)) for others in (False, True)],
    "metrics": [
        *((paths, failing, 0.0, 0.0) for paths in (7, 12) for failing in (0.0, 0.8)),
        *((paths, failing, 1.0, 0.0) for paths in (7, 12) for failing in (0.0, 0.8)),
        *((paths, failing, 0.5, 1.5) for paths in (7, 12) for failing in (0.0, 0.8)),
    ],
}  # fmt: skip
DRAWN: Final = {each.__name__: each for each in (units, trends, power, promised, metrics)}


def chunk_of(cell: Cell, campaigns: int, seed: Sequence[int]) -> Counts:
    rng, found = np.random.default_rng(seed), Counts()
    for _ in range(campaigns):
        DRAWN[cell.part](rng, found, *cell.arguments)
    return found


def figures(parts: Sequence[str], campaigns: int, workers: int = 1, seed: int = SEED) -> Iterator[Figure]:
    """Draw all cells of the parts, and count."""
    cells = [Cell(part, arguments) for part in parts for arguments in PARTS[part]]
    with ProcessPoolExecutor(workers) as pool:
        jobs = [
            [
                pool.submit(chunk_of, cell, min(_CHUNK, campaigns - start), [seed, k, start])
                for start in range(0, campaigns, _CHUNK)
            ]
            for k, cell in enumerate(cells)
        ]
        for cell, chunks in zip(cells, jobs, strict=True):
            whole: Counts = {}
            for key, (times, of) in (item for chunk in chunks for item in chunk.result().items()):
                sums = whole.setdefault(key, [0, 0])
                sums[0], sums[1] = sums[0] + times, sums[1] + of
            names = DRAWN[cell.part].__code__.co_varnames[2:]
            words = ", ".join(f"{name} {value}" for name, value in zip(names, cell.arguments, strict=False))
            for (what, kind), (times, of) in whole.items():
                yield Figure(cell.part, words, what, kind, times, of)


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("parts", nargs="*", metavar="PART", help=f"of {', '.join(PARTS)}; default: all")
    parser.add_argument("--campaigns", type=int, default=500, metavar="N", help="of each kind")
    parser.add_argument("--workers", type=int, default=1, metavar="N")
    parser.add_argument("--seed", type=int, default=SEED)
    parser.add_argument("--json", metavar="FILE", help="also write the figures there")
    options = parser.parse_args()
    if unknown := set(options.parts) - set(PARTS):
        parser.error(f"expected parts of {', '.join(PARTS)}, got {', '.join(sorted(unknown))}")
    began, found = time.monotonic(), []
    for figure in figures(options.parts or list(PARTS), options.campaigns, options.workers, options.seed):
        print(figure, flush=True)
        found.append(figure)
    print(f"{len(found)} figures in {time.monotonic() - began:.0f} s")
    if options.json:
        rows = [{**asdict(each), "rate": each.rate, "error": each.error, "good": each.good} for each in found]
        with open(options.json, "w", encoding="utf-8") as file:
            json.dump(rows, file, indent=1)
    return 0 if all(each.good for each in found) else 1


if __name__ == "__main__":
    raise SystemExit(main())
