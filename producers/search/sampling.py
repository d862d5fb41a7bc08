"""Strategies that look at nothing that was found: `random`, `sobol`, and `halton`."""

from abc import abstractmethod
from collections.abc import Sequence
from typing import ClassVar, TypeVar

import numpy as np
from numpy.typing import NDArray

from vastflow.producers.search.space import Point
from vastflow.producers.search.strategy import Evaluation, Parameters, Problem, Strategy

P = TypeVar("P", bound=Parameters)


class SamplingParameters(Parameters):
    """Empty parameters."""


class Random(Strategy[SamplingParameters]):
    """Points drawn independently and evenly: what every other strategy is compared with."""

    Parameters: ClassVar[type[Parameters]] = SamplingParameters

    def ask(self, batch: int, count: int) -> Sequence[Point]:
        space = self.problem.space
        return [space.decoded(unit) for unit in self.problem.draws(batch).random((count, len(space.dimensions)))]

    def tell(self, evaluations: Sequence[Evaluation]) -> None:
        pass


class _Sequence(Strategy[P]):
    """Points of a sequence that fills the space more evenly than random ones, and goes on from batch to batch."""

    def __init__(self, parameters: P, problem: Problem) -> None:
        super().__init__(parameters, problem)
        self._asked = 0

    @abstractmethod
    def _units(self, first: int, last: int) -> NDArray[np.float64]:
        """(last - first, d) points of the unit cube."""

    def ask(self, batch: int, count: int) -> Sequence[Point]:
        units = self._units(self._asked, self._asked + count)
        self._asked += count
        return [self.problem.space.decoded(unit) for unit in units]

    def tell(self, evaluations: Sequence[Evaluation]) -> None:
        pass


class Sobol(_Sequence[SamplingParameters]):
    """Sobol's sequence, scrambled by Owen's method: best where the number of points is a power of two."""

    Parameters: ClassVar[type[Parameters]] = SamplingParameters

    def _units(self, first: int, last: int) -> NDArray[np.float64]:
        from scipy.stats.qmc import Sobol as Points  # takes a third of a second

        points = Points(len(self.problem.space.dimensions), scramble=True, rng=self.problem.draws(0))
        units: NDArray[np.float64] = points.random_base2(max(0, (last - 1).bit_length()))[first:last]
        return units


class HaltonParameters(Parameters):
    """Parameters of `halton`."""

    scramble: bool = True
    """Whether the sequence depends on the seed; else it is the textbook's."""


class Halton(_Sequence[HaltonParameters]):
    """Halton's sequence: even whatever the number of points."""

    Parameters: ClassVar[type[Parameters]] = HaltonParameters

    def _units(self, first: int, last: int) -> NDArray[np.float64]:
        from scipy.stats.qmc import Halton as Points  # takes a third of a second

        scramble, dimensions = self.parameters.scramble, len(self.problem.space.dimensions)
        points = Points(dimensions, scramble=scramble, rng=self.problem.draws(0))
        units: NDArray[np.float64] = points.fast_forward(first).random(last - first)
        return units
