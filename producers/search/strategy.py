"""The strategy: what proposes the points of a search, its proposals, and what was found at them."""

from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, ClassVar, Final, Generic, Literal, TypeAlias, TypeVar

import numpy as np
from pydantic import BaseModel, ConfigDict

from vastflow.producers.search.space import Point, Space
from vastflow.sim.model.faults import UserError
from vastflow.sim.plug_ins.registry import Registry

FAMILY: Final = "search"
"""Family of all points of a search, in tables and in the report."""
BASELINE: Final = "random"
"""The family of points that are drawn beside those of the strategy."""

Standing: TypeAlias = Literal["judged", "rejected", "not judged"]
"""`rejected`: nothing can be built there, so nothing was run. `not judged`: it was run, and its runs do not give the objective."""


@dataclass(frozen=True, slots=True)
class Proposal:
    """A point that a strategy wants to know of.

    Attributes:
        number: Number among all proposals, from 1; one of the baseline has that of the point beside which it is drawn.
        batch: From 0.
        family: `FAMILY`, or `BASELINE` where it is a point of the search beside.
    """

    number: int
    batch: int
    point: Point
    family: str = FAMILY

    @property
    def name(self) -> str:
        """Name of its configuration, such as `point-0017`."""
        return f"{'point' if self.family == FAMILY else self.family}-{self.number:04}"


@dataclass(frozen=True, slots=True)
class Evaluation:
    """The evaluation of a proposal.

    Attributes:
        objective: None unless `judged`.
        measures: Name to value of what the strategy asked beside; those that could not be had are missing.
        runs: Over which the objective was taken.
        simulated_s: Simulated time of these.
        reason: Why it is not judged; empty where it is.
    """

    proposal: Proposal
    standing: Standing
    objective: float | None = None
    measures: Mapping[str, float] = field(default_factory=dict)
    runs: int = 0
    simulated_s: float = 0.0
    reason: str = ""


class StrategyParameters(BaseModel):
    """Base of every strategy's parameter model: unknown keys are faults, values don't change."""

    model_config = ConfigDict(extra="forbid", frozen=True, use_attribute_docstrings=True)


@dataclass(frozen=True, slots=True)
class Problem:
    """The problem that a strategy searches; `per_batch` is the most points of a batch."""

    space: Space
    direction: Literal["maximize", "minimize"] = "maximize"
    seed: int = 0
    per_batch: int = 1

    def gain(self, objective: float) -> float:
        """The objective so that more is better."""
        return objective if self.direction == "maximize" else -objective

    def draws(self, batch: int) -> np.random.Generator:
        """The random generator of a batch, equal in every process."""
        return np.random.Generator(np.random.PCG64(np.random.SeedSequence([self.seed, batch])))


@dataclass(frozen=True, slots=True)
class Cell:
    """A cell of an archive, by its place on the grid, with the best point in it."""

    index: tuple[int, ...]
    evaluation: Evaluation


Parameters = StrategyParameters
P = TypeVar("P", bound=Parameters)


class Strategy(ABC, Generic[P]):
    """Proposes points, batch by batch, by what was found at those before.

    The points of a batch are a function of the parameters, the problem, and what was told before, in its order. So a search that is
    taken up again asks and tells from the beginning, and goes on as it would have.

    Attributes:
        Parameters: The pydantic model of what stands below `strategy_parameters` in the campaign file.
        library: Module that it needs and not everybody has; empty without one.
        reports: Names of its `metrics`.
    """

    Parameters: ClassVar[type[Parameters]]
    library: ClassVar[str] = ""
    reports: ClassVar[tuple[str, ...]] = ()

    def __init__(self, parameters: P, problem: Problem) -> None:
        self.parameters = parameters
        self.problem = problem

    @abstractmethod
    def ask(self, batch: int, count: int) -> Sequence[Point]:
        """Up to `count` points of the space, once for each batch from 0; none to end the search."""

    @abstractmethod
    def tell(self, evaluations: Sequence[Evaluation]) -> None:
        """Take the evaluations of the last batch's points, in the order of proposal."""

    @classmethod
    def measures(cls, parameters: P) -> Sequence[str]:
        """Return the dimensions or numbers of `extract` that it needs in addition to the objective."""
        return ()

    @property
    def metrics(self) -> Mapping[str, float]:
        """Numbers of its own, for `stopping: [{metric: ...}]`: those of `reports`, from the beginning."""
        return {}

    @property
    def archive(self) -> Sequence[Cell]:
        """Its cells that are filled, by index; none where it keeps no archive."""
        return ()


def asked(strategy: Strategy[Any], batch: int, count: int) -> list[Point]:
    """Return a strategy's proposals, checked: one outside of the space would be reported as inside.

    Raises:
        UserError: a point that is not in the space, or more points than asked for; and whatever the strategy's code raises.
    """
    name = type(strategy).__name__
    points = list(strategy.ask(batch, count))
    if len(points) > count:
        raise UserError(f"strategy {name} proposes {len(points)} points in batch {batch}. Expected at most {count}.")
    for point in points:
        if not (isinstance(point, Mapping) and strategy.problem.space.contains(point)):
            what = f"strategy {name} proposes {point!r} in batch {batch}, which is not in the search space"
            raise UserError(f"{what}. Expected a value of each dimension, of its type and within its bounds.")
    return points


STRATEGIES: Final[Registry[Strategy[Any]]] = Registry(
    "vastflow.strategies",
    "strategy",
    Strategy,  # type: ignore[type-abstract]
    "campaign file",
    is_beside_campaign=True,
)

find_strategy = STRATEGIES.find


def missing_library(name: str) -> UserError:
    """Return the error of a library that is not installed."""
    return UserError(f"The library {name} is not installed. Call pip install -e '.[search]' in the checkout.")
