"""Matched sets: does a factor change the outcome on these very situations (Cochran, Mantel and Haenszel)."""

from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import Final

import numpy as np
from numpy.typing import NDArray

from vastflow.oracles.statistics.intervals import Floats, wilson_intervals

DRAWS: Final = 9999
_SEED: Final = 1959
_CHUNK: Final = 333
_ENOUGH: Final = 100


@dataclass(frozen=True, eq=False)
class Matched:
    """Runs of a factor's L levels in S sets that are equal in everything but the factor.

    Attributes:
        failed, runs: (S, L). Only sets with runs at two levels or more.
        values: (L,) the numbers behind the levels, where they are numbers.
    """

    failed: Floats = field(repr=False)
    runs: Floats = field(repr=False)
    values: Floats | None = field(default=None, repr=False)

    @property
    def p_value(self) -> float:
        """Of no effect in any set: failures fall on a set's runs at random (multivariate hypergeometric), sets independent.

        Two levels: exact, by convolution. More: `DRAWS` draws of the generalized statistic Q (Landis, Heyman and Koch 1978) and, of
        numbers, of their linear trend T; the smaller of the p-values of both is the statistic.
        """
        some = (self.failed.sum(axis=1) % self.runs.sum(axis=1)) > 0
        if not some.any():
            return 1.0
        failed, runs = self.failed[some], self.runs[some]
        return _exact(failed, runs) if runs.shape[1] == 2 else _drawn(failed, runs, self.values)

    def difference(self, level: int, base: int) -> tuple[float, tuple[float, float]] | None:
        """Mantel and Haenszel's difference of the failure rates of two levels; None where no set has both.

        The interval is Newcombe's (1998, method 10), of the rates with Mantel and Haenszel's weights.
        """
        n, m = self.runs[:, level], self.runs[:, base]
        both = (n > 0) & (m > 0)
        if not both.any():
            return None
        weights = n[both] * m[both] / (n[both] + m[both])
        p, q = (float(weights @ (self.failed[both, k] / self.runs[both, k]) / weights.sum()) for k in (level, base))
        size = np.array([n[both].sum(), m[both].sum()])
        one, two = wilson_intervals(np.array([p, q]) * size, size).tolist()
        down, up = np.hypot(p - one[0], two[1] - q), np.hypot(one[1] - p, q - two[0])
        return p - q, (max(-1.0, p - q - float(down)), min(1.0, p - q + float(up)))


def matched(
    failed: Floats, runs: Floats, codes: NDArray[np.int64], sets: NDArray[np.int64], values: Floats | None
) -> Matched | None:
    """The matched sets among (m,) configurations; None where there are none.

    Args:
        codes: (m,) level of each, -1 for none.
        sets: (m,) equal for configurations that are equal in all but the factor.
        values: (L,) as of `Matched`.
    """
    some = codes >= 0
    _, at = np.unique(sets[some], return_inverse=True)
    tables = np.zeros((2, int(at.max(initial=-1)) + 1, int(codes.max()) + 1))
    for table, counts in zip(tables, (failed, runs), strict=True):
        np.add.at(table, (at, codes[some]), counts[some])
    kept = (tables[1] > 0).sum(axis=1) > 1
    return Matched(tables[0, kept], tables[1, kept], values) if kept.any() else None


def _exact(failed: Floats, runs: Floats) -> float:
    """Share of all ways for failures to fall whose count at the first level is as far from the expected one."""
    from scipy.stats import hypergeom

    whole, total = runs.sum(axis=1), failed.sum(axis=1)
    chances = np.ones(1)
    for n, m, size in zip(runs[:, 0], total, whole, strict=True):
        chances = np.convolve(chances, hypergeom.pmf(np.arange(n + 1), size, m, n))
    away = np.abs(np.arange(len(chances)) - float((runs[:, 0] * total / whole).sum()))
    observed = abs(float(failed[:, 0].sum() - (runs[:, 0] * total / whole).sum()))
    return min(1.0, float(chances[away >= observed - 1e-9].sum()))


def _drawn(failed: Floats, runs: Floats, values: Floats | None) -> float:
    from scipy.stats import chi2

    whole, total = runs.sum(axis=1), failed.sum(axis=1)
    expected = (runs * (total / whole)[:, None]).sum(axis=0)
    scale = total * (whole - total) / (whole**2 * (whole - 1))
    variance = np.diag((scale * whole) @ runs) - (runs * scale[:, None]).T @ runs
    inverse = np.linalg.pinv(variance, hermitian=True)
    degrees = np.linalg.matrix_rank(variance, hermitian=True)
    centered = None if values is None or not np.isfinite(values).all() else values - values.mean()
    steep = 0.0 if centered is None else float(centered @ variance @ centered)

    def statistic(sums: Floats) -> Floats:
        """(D,) the logarithm of the smaller p-value, of (D, L) failures; by chi-squared, which need not hold."""
        away = sums - expected
        found = chi2.logsf(np.einsum("ij,jk,ik->i", away, inverse, away), degrees)
        if centered is not None and steep > 0.0:
            found = np.minimum(found, chi2.logsf((away @ centered) ** 2 / steep, 1))
        return np.asarray(found)

    observed = float(statistic(failed.sum(axis=0)[None])[0]) + 1e-9
    larger = drawn = 0
    for sums in _assignments(runs.astype(np.int64), total.astype(np.int64), np.random.default_rng(_SEED)):
        larger, drawn = larger + int((statistic(sums) <= observed).sum()), drawn + len(sums)
        if larger >= _ENOUGH:  # far from showing anything; more draws would tell the same (Besag and Clifford 1991)
            break
    return (1 + larger) / (1 + drawn)


def _assignments(runs: NDArray[np.int64], total: NDArray[np.int64], rng: np.random.Generator) -> Iterator[Floats]:
    """(`_CHUNK`, L) failures at each level over all sets, `DRAWS` in all: level by level, hypergeometric."""
    for _ in range(DRAWS // _CHUNK):
        left = np.broadcast_to(total, (_CHUNK, len(total)))
        rest = runs.sum(axis=1)
        sums = np.empty((_CHUNK, runs.shape[1]))
        for level, n in enumerate(runs.T):
            rest = rest - n
            taken = rng.hypergeometric(n, rest, left)
            sums[:, level] = taken.sum(axis=1)
            left = left - taken
        yield sums
