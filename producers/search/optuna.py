"""The strategy `optuna`: the samplers of Optuna, which drive toward the best point."""

from collections.abc import Sequence
from typing import TYPE_CHECKING, Annotated, Any, ClassVar, Final, Literal

from pydantic import Field

from vastflow.producers.campaign_file.search import SearchDimension
from vastflow.producers.model.numbers import Count
from vastflow.producers.search.space import Point
from vastflow.producers.search.strategy import Evaluation, Parameters, Strategy, missing_library

if TYPE_CHECKING:
    from optuna.distributions import BaseDistribution
    from optuna.samplers import BaseSampler
    from optuna.trial import Trial

_SEEDS: Final = 2**32


class OptunaParameters(Parameters):
    """Parameters of `optuna`."""

    sampler: Literal["tpe", "cmaes", "random"] = "tpe"
    """Tree-structured Parzen estimator, covariance matrix adaptation, or points drawn at random."""
    constant_liar: Annotated[bool, Field(strict=True)] = True
    """For `tpe`: whether points of one batch keep away from each other, as if pending ones were bad."""
    n_startup_trials: Count | None = None
    """Points drawn at random first; as many as the sampler's default where none is given."""


class Optuna(Strategy[OptunaParameters]):
    """Points of a sampler of Optuna; random ones as long as all objectives are equal.

    A batch's sampler is made anew, with a seed of the batch, so that nothing is carried from one to the next but what was told.
    """

    Parameters: ClassVar[type[Parameters]] = OptunaParameters
    library: ClassVar[str] = "optuna"

    def __init__(self, parameters: Any, problem: Any) -> None:
        super().__init__(parameters, problem)
        try:
            import optuna
        except ImportError:
            raise missing_library(self.library) from None
        optuna.logging.set_verbosity(optuna.logging.ERROR)
        self._study = optuna.create_study(direction=problem.direction)
        self._trials: list[Trial] = []
        dimensions = problem.space.dimensions
        self._distributions = {name: _distribution(each) for name, each in dimensions.items()}

    def ask(self, batch: int, count: int) -> Sequence[Point]:
        self._study.sampler = self._sampler(int(self.problem.draws(batch).integers(_SEEDS)))
        self._trials = [self._study.ask(self._distributions) for _ in range(count)]
        return [self._point(trial.params) for trial in self._trials]

    def tell(self, evaluations: Sequence[Evaluation]) -> None:
        from optuna.trial import TrialState

        for trial, evaluation in zip(self._trials, evaluations, strict=True):
            if evaluation.objective is None:
                self._study.tell(trial, state=TrialState.PRUNED)  # worse than those with an objective
            else:
                self._study.tell(trial, evaluation.objective)

    def _point(self, params: dict[str, Any]) -> Point:
        dimensions = self.problem.space.dimensions
        return {
            name: params[name] if each.values is None else each.values[params[name]]
            for name, each in dimensions.items()
        }

    def _sampler(self, seed: int) -> "BaseSampler":
        from optuna.samplers import CmaEsSampler, RandomSampler, TPESampler

        asked, startup = self.parameters, self.parameters.n_startup_trials
        found = {trial.value for trial in self._study.get_trials(deepcopy=False) if trial.value is not None}
        if (
            asked.sampler == "random" or len(found) == 1
        ):  # of equal points a sampler takes some for better, and stays there
            return RandomSampler(seed=seed)
        if asked.sampler == "cmaes":
            own = {} if startup is None else {"n_startup_trials": startup}
            return CmaEsSampler(seed=seed, warn_independent_sampling=False, **own)
        own = {} if startup is None else {"n_startup_trials": startup}
        return TPESampler(seed=seed, constant_liar=asked.constant_liar, **own)


def _distribution(dimension: SearchDimension) -> "BaseDistribution":
    """Return the distribution; a choice is its values' indices, for Optuna takes no mapping or list."""
    from optuna.distributions import CategoricalDistribution, FloatDistribution, IntDistribution

    if dimension.type == "bool":
        return CategoricalDistribution((False, True))
    if dimension.values is not None:
        return CategoricalDistribution(tuple(range(len(dimension.values))))
    assert dimension.low is not None and dimension.high is not None
    if dimension.type == "float":
        return FloatDistribution(dimension.low, dimension.high, log=dimension.log)
    step = dimension.step or 1
    low, high = int(dimension.low), int(dimension.high)
    return IntDistribution(low, low + (high - low) // step * step, log=dimension.log, step=step)
