"""Strategies that look at nothing that was found: `random`, `sobol`, and `halton`."""

from collections.abc import Sequence
from typing import Any, ClassVar

from vastflow.producers.search.evaluation import Evaluation
from vastflow.producers.search.space import Point
from vastflow.producers.search.strategy import Parameters, Strategy


class SamplingParameters(Parameters):
    """There are none."""


class Random(Strategy[SamplingParameters]):
    """Points drawn independently and evenly: what every other strategy is compared with."""

    Parameters: ClassVar[type[Parameters]] = SamplingParameters

    def ask(self, batch: int, count: int) -> Sequence[Point]:
        """See `Strategy`."""
        space = self.problem.space
        return [space.decoded(unit) for unit in self.problem.draws(batch).random((count, len(space.dimensions)))]

    def tell(self, evaluations: Sequence[Evaluation]) -> None:
        """See `Strategy`."""


class Sobol(Strategy[SamplingParameters]):
    """Points of Sobol's sequence, scrambled by Owen's method: they fill the space more evenly than random ones, best where their
    number is a power of two."""

    Parameters: ClassVar[type[Parameters]] = SamplingParameters

    def __init__(self, parameters: Any, problem: Any) -> None:
        super().__init__(parameters, problem)
        self._asked = 0

    def ask(self, batch: int, count: int) -> Sequence[Point]:
        """See `Strategy`."""
        from scipy.stats.qmc import Sobol as Sequence_  # takes a third of a second

        space, last = self.problem.space, self._asked + count
        sequence = Sequence_(len(space.dimensions), scramble=True, rng=self.problem.draws(0))
        units = sequence.random_base2(max(0, (last - 1).bit_length()))[self._asked : last]
        self._asked = last
        return [space.decoded(unit) for unit in units]

    def tell(self, evaluations: Sequence[Evaluation]) -> None:
        """See `Strategy`."""


class HaltonParameters(Parameters):
    """Parameters of `halton`."""

    scramble: bool = True
    """Whether the sequence depends on the seed; else it is the textbook's."""


class Halton(Strategy[HaltonParameters]):
    """Points of Halton's sequence: they fill the space more evenly than random ones, whatever their number."""

    Parameters: ClassVar[type[Parameters]] = HaltonParameters

    def __init__(self, parameters: Any, problem: Any) -> None:
        super().__init__(parameters, problem)
        self._asked = 0

    def ask(self, batch: int, count: int) -> Sequence[Point]:
        """See `Strategy`."""
        from scipy.stats.qmc import Halton as Sequence_  # takes a third of a second

        space = self.problem.space
        sequence = Sequence_(len(space.dimensions), scramble=self.parameters.scramble, rng=self.problem.draws(0))
        units = sequence.fast_forward(self._asked).random(count)
        self._asked += count
        return [space.decoded(unit) for unit in units]

    def tell(self, evaluations: Sequence[Evaluation]) -> None:
        """See `Strategy`."""
