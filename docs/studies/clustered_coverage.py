"""Measure the coverage of intervals for clusters that were not sampled.

Campaigns are drawn of clusters of 20 runs whose rates are beta-distributed with a given mean and intraclass correlation; 0 is independent
runs, 1 clusters that pass or fail wholly. *mixed* is another kind: clusters that always fail beside clusters with one rate, which no beta
distribution is. For each number of clusters are told:

- the least coverage, and where; of mixed clusters it is told beside, and nothing is asked: where none fails that was drawn, no interval
  can hold their rate that is much narrower than that of whole clusters;
- the width of intervals where runs are independent, over that of Clopper and Pearson's interval of all runs, at each rate;
- how many intervals are wider than Clopper and Pearson's of whole clusters.

    python docs/studies/clustered_coverage.py [--campaigns 1000]

Exit code 1 where the coverage is below 0.93, by more than four standard errors of the simulation, or an interval is too wide.
"""

import math
from collections.abc import Sequence
from itertools import product
from typing import Final

import numpy as np
import pandas as pd
from missions import parser_of
from numpy.typing import NDArray

from vastflow.oracles.statistics.intervals import clopper_pearson_intervals, clustered_interval

RUNS: Final = 20
LEAST: Final = 0.93
CLUSTERS: Final = (5, 10, 20, 30, 50)
RATES: Final = (0.5, 0.8, 0.9, 0.95, 0.98, 0.99)
CORRELATIONS: Final = (0.0, 0.05, 0.2, 0.5, 0.8, 1.0)
MIXED: Final = -1.0
"""Stands for a correlation: clusters that always fail, beside others that pass with a rate of 0.995 at most."""


def drawn(
    clusters: int, rate: float, correlation: float, campaigns: int, rng: np.random.Generator
) -> NDArray[np.int64]:
    """(campaigns, clusters) passes."""
    shape = campaigns, clusters
    if correlation == MIXED:
        most = max(0.995, rate)
        rates = np.where(rng.random(shape) < rate / most, most, 0.0)
    elif correlation == 0.0:
        rates = np.full(shape, rate)
    elif correlation == 1.0:
        rates = (rng.random(shape) < rate).astype(np.float64)
    else:
        size = (1 - correlation) / correlation
        rates = rng.beta(rate * size, (1 - rate) * size, shape)
    return rng.binomial(RUNS, rates)


def cells(
    campaigns: int,
    seed: int,
    clusters: Sequence[int] = CLUSTERS,
    rates: Sequence[float] = RATES,
    correlations: Sequence[float] = (*CORRELATIONS, MIXED),
) -> pd.DataFrame:
    """A row for each kind of campaign.

    `width` is the mean over that of the exact interval of all runs, as if they were independent. `too_wide` counts intervals that are wider than the exact one of whole clusters.
    """
    least = LEAST - 4 * math.sqrt(LEAST * (1 - LEAST) / campaigns)
    rows = []
    for (k, m), rate, correlation in product(enumerate(clusters), rates, correlations):
        rng = np.random.default_rng([seed, k, int(1000 * rate), int(100 * (correlation + 1))])
        # Campaigns that are alike but for the order of their clusters are asked once.
        passed = np.sort(drawn(m, rate, correlation, campaigns, rng), axis=1)
        kinds, times = np.unique(passed, axis=0, return_counts=True)
        found = [clustered_interval(kind, np.full(m, RUNS)) for kind in kinds]
        low, high = np.array([(each.low, each.high) for each in found if each is not None]).T
        sums = kinds.sum(axis=1)
        of_runs, of_clusters = (
            np.diff(clopper_pearson_intervals(sums / runs, np.full(len(sums), m * RUNS / runs)))[:, 0]
            for runs in (1, RUNS)
        )
        coverage = times[(low <= rate) & (rate <= high)].sum() / campaigns
        width = times @ (high - low) / (times @ of_runs)
        too_wide = times[high - low > of_clusters + 1e-9].sum()
        good = correlation == MIXED or (coverage >= least and not too_wide)
        rows.append((m, rate, correlation, coverage, width, too_wide, good))
    return pd.DataFrame(rows, columns=["clusters", "rate", "correlation", "coverage", "width", "too_wide", "good"])


def main() -> int:
    parser = parser_of(__doc__)
    parser.add_argument("--campaigns", type=int, default=1000, metavar="N", help="of each kind")
    parser.add_argument("--seed", type=int, default=18)
    options = parser.parse_args()
    found = cells(options.campaigns, options.seed)
    mixed = found.correlation == MIXED
    least = found.loc[found[~mixed].groupby("clusters").coverage.idxmin()].set_index("clusters")
    table = least[["coverage", "rate", "correlation"]]
    table = table.assign(mixed=found[mixed].groupby("clusters").coverage.min())
    widths = found[found.correlation == 0.0].pivot(index="clusters", columns="rate", values="width")
    table = table.join(widths.add_prefix("width at ")).assign(too_wide=found.groupby("clusters").too_wide.sum())
    print(table.to_string(float_format="{:.3f}".format))
    return 0 if found.good.all() else 1


if __name__ == "__main__":
    raise SystemExit(main())
