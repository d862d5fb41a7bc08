"""Looks at a configuration's runs: when they end by a stopping rule, and rates that hold although they do."""

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache, cached_property
from typing import Final, TypeAlias

import numpy as np
from numpy.typing import ArrayLike, NDArray

from vastflow.oracles.statistics.classes import StoppingRule
from vastflow.oracles.statistics.intervals import Floats, Interval, counts, wilson

MOST_ROUNDS: Final = 16
"""Maximum number of looks. Between two of them there are as many runs as this allows, and one if possible: up to 21 runs
from a minimum of 5. A round costs about a hundred task runs and a moment in which workers wait for the last run, a run
more of every configuration costs more."""
_RATES: Final = np.clip(np.linspace(0.0, 1.0, 201), 1e-6, 1 - 1e-6)
"""Rates for which effective numbers of runs are computed."""

Mean: TypeAlias = tuple[float, Interval]
"""A rate, and its interval for runs of these same configurations."""


@dataclass(frozen=True)
class Looks:
    """Looks at a configuration's first runs, and says whether it wants more.

    Looks are on a fixed grid, and each uses the runs before it alone. So the number of runs follows from the judgments, whatever
    else is known, whoever computed it and in which order.
    """

    rule: StoppingRule

    @property
    def most(self) -> int:
        """Runs that no configuration exceeds."""
        return self.rule.max_runs

    @cached_property
    def looks(self) -> tuple[int, ...]:
        """Numbers of runs after which it is looked, in order: from the rule's least to its most."""
        least, most = self.rule.min_runs, self.rule.max_runs
        step = max(1, -(-(most - least) // MOST_ROUNDS))
        return (*range(least, most, step), most)

    def wanted(self, judgments: Mapping[int, str]) -> int:
        """Return the number of runs a configuration wants, given the known judgments.

        Where all of these are among `judgments` it wants no more. A look at which nothing could be decided, however the runs before
        it end, is passed over: that saves a round and changes no outcome.

        Args:
            judgments: Run index to `pass`, `fail` or `not judged`, which is no evidence; any other runs, later ones too.
        """
        runs = passed = judged = 0
        while True:
            look = _next(self, runs, passed, judged)
            for run in range(runs, look):
                said = judgments.get(run)
                if said is None:
                    return look
                passed += said == "pass"
                judged += said != "not judged"
            runs = look
            if runs >= self.most or self.rule.decided[judged, passed]:
                return runs

    def rates(self, passed: ArrayLike, judged: ArrayLike) -> Floats:
        """Unbiased rates of configurations whose runs ended at a look; NaN without judged runs.

        Passes over runs are biased, as runs end where things look clear. The unbiased rate is the share of the sequences to the same end that begin
        with a pass (Girshick, Mosteller and Savage, Ann. Math. Statist. 17 (1946) 13). For a fixed number of runs both are the same.

        Args:
            passed, judged: (m,) counts, one entry a configuration; with unjudged runs the rate is an approximation.
        """
        x, n = counts(passed, judged)
        at = np.minimum(n, self.most).astype(np.int64), np.minimum(x, self.most).astype(np.int64)
        with np.errstate(invalid="ignore"):
            found: Floats = np.where((n <= self.most) & (self._reach[0][at] > 0), self._unbiased[at], x / n)
        return found

    def effective_runs(self, rate: float, judged: ArrayLike) -> Floats:
        """Fixed runs of each configuration (m,) that would tell a mean `rate` as precisely as those of the rule.

        The variance is the largest that configurations with this mean rate can have together. A configuration that did not end at a
        look, since runs were not judged, has at most its judged runs.
        """
        n, found = np.asarray(judged), np.interp(rate, _RATES, self._effective)
        ended = np.isin(n, np.flatnonzero((self._ends & (self._reach[0] > 0)).any(axis=1)))
        return np.asarray(np.where(ended, found, np.minimum(n, found)), dtype=np.float64)

    @cached_property
    def _ends(self) -> NDArray[np.bool_]:
        """(most + 1, most + 1) whether runs end at (judged, passed), if they come there."""
        ends = np.zeros_like(self.rule.decided)
        ends[[*self.looks]] = self.rule.decided[[*self.looks]]
        ends[self.most] = True
        return ends

    @cached_property
    def _reach(self) -> Floats:
        """(2, most + 1, most + 1) shares of a coin's sequences that reach (judged, passed).

        First of all sequences, then of those that begin with a pass.
        """
        reach = np.zeros((2, self.most + 1, self.most + 1))
        going = np.zeros((2, self.most + 2))
        going[0, 0] = 1.0
        for n in range(1, self.most + 1):
            going = (going + np.roll(going, 1, axis=1)) / 2
            if n == 1:
                going[1, 1] = 0.5
            reach[:, n] = going[:, :-1]
            going[:, :-1][:, self._ends[n]] = 0.0
        return reach

    @cached_property
    def _unbiased(self) -> Floats:
        """(most + 1, most + 1) rates by judged runs and passes; 0 where no sequence comes."""
        every, begun = self._reach
        found: Floats = np.divide(begun, every, out=np.zeros_like(every), where=every > 0)
        return found

    @cached_property
    def _effective(self) -> Floats:
        """Effective runs of a configuration at each of `_RATES`."""
        n, x = np.nonzero(self._ends & (self._reach[0] > 0))
        p = _RATES[:, None]
        chance = np.exp(np.log(self._reach[0][n, x]) + x * np.log(2 * p) + (n - x) * np.log(2 * (1 - p)))
        variance = (chance * (self._unbiased[n, x] - p) ** 2).sum(axis=1)
        hull: list[tuple[float, float]] = []  # the least concave function above: mixtures of rates reach no more
        for p_c, v_c in zip(_RATES.tolist(), variance.tolist(), strict=True):
            while len(hull) > 1:
                (p_a, v_a), (p_b, v_b) = hull[-2:]
                if (v_b - v_a) * (p_c - p_a) > (v_c - v_a) * (p_b - p_a):
                    break
                hull.pop()
            hull.append((p_c, v_c))
        return np.asarray(_RATES * (1 - _RATES) / np.interp(_RATES, *np.array(hull).T))


@cache
def _next(looks: Looks, runs: int, passed: int, judged: int) -> int:
    def may_decide(more: int) -> bool:
        return any(looks.rule.decided[judged + k, passed : passed + k + 1].any() for k in range(more + 1))

    later = (look for look in looks.looks if look > runs)
    return next(look for look in later if look >= looks.most or may_decide(look - runs))


def mean_rate(rates: ArrayLike, runs: ArrayLike, looks: Looks | None = None) -> Mean | None:
    """The mean of configurations' rates, and its interval for runs of these same configurations; None without judged runs.

    The interval is Wilson's at Kish's effective number of runs, m² / Σ (1 / n): with equal numbers of runs, that of the pooled rate. It holds for
    unequal rates too, whose mean varies less. Coverage and width are in `docs/studies/truth_headline.py` and docs/statistics.md.

    Args:
        rates: (m,) by configuration; of those that ended by a rule, as of `Looks.rates`.
        runs: (m,) judged runs; configurations without any are in no mean.
        looks: If runs ended by a rule: then each configuration has the rule's `effective_runs`.
    """
    each, n = (np.asarray(a, dtype=np.float64) for a in (rates, runs))
    each, n = each[n > 0], n[n > 0]
    if not len(n):
        return None
    rate = min(max(float(each.sum() / len(n)), 0.0), 1.0)
    worth = n if looks is None else looks.effective_runs(rate, n)
    effective = float(len(n) ** 2 / (1.0 / worth).sum())
    return rate, wilson(rate * effective, effective)
