"""The strategy `boundary`: find where the objective crosses a level, in one to three dimensions.

A Gaussian process over the unit cube, whose points are chosen by the straddle (B. Bryan et al., NIPS 18 (2005) 163): where it is
uncertain on which side of the level the objective is.
"""

import itertools
from collections.abc import Mapping, Sequence
from typing import Any, ClassVar, Final

import numpy as np

from vastflow.producers.model.numbers import Number, Positive
from vastflow.producers.search.gaussian_process import Floats, likelihood, predicted
from vastflow.producers.search.space import Point, levels_of
from vastflow.producers.search.strategy import Evaluation, Parameters, Strategy

MOST_DIMENSIONS: Final = 3
BAND: Final = 1.96
"""Standard deviations to both sides of the curve that the band has: 95 %."""

_CANDIDATES: Final = 512
_FIRST: Final = 8
"""Points that fill the space first, for each dimension."""
_SCALES: Final = (0.08, 0.15, 0.3, 0.6, 1.2)
"""Correlation lengths of which each dimension has one, as a share of its range."""


class BoundaryParameters(Parameters):
    """Parameters of `boundary`."""

    level: Number = 0.5
    """Level of the objective, in its unit."""
    noise: Positive = 0.5
    """Standard deviation of the objective over single runs, in its unit: of a rate at 50 % it is 0.5."""


class Boundary(Strategy[BoundaryParameters]):
    """Points near the level set of the objective, where it is least known."""

    Parameters: ClassVar[type[Parameters]] = BoundaryParameters
    reports: ClassVar[tuple[str, ...]] = ("undecided",)

    def __init__(self, parameters: Any, problem: Any) -> None:
        super().__init__(parameters, problem)
        self._units: list[Floats] = []
        self._values: list[float] = []
        self._variances: list[float] = []

    def ask(self, batch: int, count: int) -> Sequence[Point]:
        from scipy.stats.qmc import Sobol

        space, d = self.problem.space, len(self.problem.space.dimensions)
        candidates = Sobol(d, scramble=True, rng=self.problem.draws(batch)).random_base2(_CANDIDATES.bit_length() - 1)
        if len(self._units) < _FIRST * d:
            return [space.decoded(unit) for unit in candidates[:count]]
        units, values, variances = list(self._units), list(self._values), list(self._variances)
        scales, chosen = self._scales(), []
        for _ in range(count):  # each as if those before it had been found as expected
            mean, deviation = predicted(np.array(units), np.array(values), np.array(variances), scales, candidates)
            best = int(np.argmax(BAND * deviation - np.abs(mean)))
            chosen.append(candidates[best])
            units, values = [*units, candidates[best]], [*values, float(mean[best])]
            variances = [*variances, float(np.median(self._variances))]
        return [space.decoded(unit) for unit in chosen]

    def tell(self, evaluations: Sequence[Evaluation]) -> None:
        for each in evaluations:
            if each.objective is not None:
                self._units.append(self.problem.space.encoded(each.proposal.point))
                self._values.append(each.objective - self.parameters.level)
                self._variances.append(self.parameters.noise**2 / max(1, each.runs))

    @property
    def metrics(self) -> Mapping[str, float]:
        """`undecided`: the share of the space in which the side of the level is not known at 95 %."""
        if not self._units:
            return {"undecided": 1.0}
        mean, deviation = self.surface(self.lattice())
        return {"undecided": float(np.mean(np.abs(mean) < BAND * deviation))}

    def surface(self, units: Floats) -> tuple[Floats, Floats]:
        """Return mean and standard deviation of the objective less the level at (n, d) coordinates of the unit cube."""
        known = np.array(self._units), np.array(self._values), np.array(self._variances)
        return predicted(*known, self._scales(), units)

    def lattice(self) -> Floats:
        """(n, d) coordinates of a lattice over the space."""
        d = len(self.problem.space.dimensions)
        steps = {1: 201, 2: 41}.get(d, 17)
        axes = [np.linspace(0.0, 1.0, steps)] * d
        return np.stack([axis.ravel() for axis in np.meshgrid(*axes, indexing="ij")], axis=-1)

    def _scales(self) -> Floats:
        d, known = len(self._units[0]), (np.array(self._units), np.array(self._values), np.array(self._variances))
        found = [np.array(scales) for scales in itertools.product(_SCALES, repeat=d)]
        return max(found, key=lambda scales: likelihood(*known, scales))


def boundary_complaint(dimensions: Mapping[str, Any]) -> str | None:
    """Return what `boundary` can't take of a space; None if it takes all."""
    if len(dimensions) > MOST_DIMENSIONS:
        return f"boundary searches 1 to {MOST_DIMENSIONS} dimensions, got {len(dimensions)}"
    unordered = [name for name, each in dimensions.items() if each.type in ("choice", "bool") or levels_of(each) == 1]
    return f"boundary searches ranges of numbers, and {unordered[0]!r} is none" if unordered else None
