"""The `search` section of a campaign file: read and checked, not executed by this version."""

from typing import Annotated, Any, Literal, Self

from pydantic import Field, model_validator
from pydantic_core import PydanticCustomError

from vastflow.producers.quantities import Count, NotNegative, Number, Positive, Seed
from vastflow.producers.vast.section import NamedSteps, Section, SingleKeys


class SearchDimension(Section):
    """A parameter that is searched over."""

    type: Literal["float", "int", "choice", "bool"]
    low: Number | None = None
    high: Number | None = None
    log: bool = False
    step: Annotated[int, Field(strict=True, ge=1)] | None = None
    values: Annotated[list[Any], Field(min_length=1)] | None = None

    @model_validator(mode="after")
    def _check(self) -> Self:
        if self.type == "choice" and self.values is None:
            raise PydanticCustomError("dimension", "a choice without values; values: [...]")
        if self.type in ("float", "int"):
            if self.low is None or self.high is None:
                raise PydanticCustomError("dimension", "a range without both bounds; low and high")
            if self.low > self.high:
                raise PydanticCustomError(
                    "dimension",
                    "low {low} is greater than high {high}; low <= high",
                    {"low": self.low, "high": self.high},
                )
        return self


class Extract(Section):
    """The plug-in that turns a batch's runs into objectives."""

    plugin: str
    params: dict[str, Any] = Field(default_factory=dict)


class Objective(Section):
    """A number that the search drives."""

    name: str
    direction: Literal["maximize", "minimize"] = "maximize"


class Budget(Section):
    """How much the search may spend."""

    batches: Count | None = None
    time: Positive | str | None = None


class NoImprovement(Section):
    """Stop when the objective stands still."""

    patience: Count
    min_delta: NotNegative = 0.0


class StopMetric(Section):
    """Stop when a metric passes a value."""

    name: str
    op: str
    value: Number


class Stopping(Section):
    """When the search ends before its budget is spent."""

    target_objective: Number | None = None
    no_improvement: NoImprovement | None = None
    metric: StopMetric | None = None


class SearchSpec(Section):
    """Families that an optimiser proposes, in place of `configuration`."""

    strategy: str
    """`random`, `optuna`, `qd` or `file.py:Class`."""
    search_space: dict[str, SearchDimension]
    extract: Extract | None = None
    objectives: list[Objective] = Field(default_factory=list)
    per_batch: Count = 1
    budget: Budget | None = None
    stopping: Stopping | None = None
    seed: Seed | None = None
    variations: SingleKeys = Field(default_factory=list)
    """Producers as in a family; `$name` stands for a searched parameter."""
    parameters: SingleKeys = Field(default_factory=list)
    postprocessing: NamedSteps = Field(default_factory=list)
    strategy_parameters: dict[str, Any] = Field(default_factory=dict)

    @model_validator(mode="after")
    def _ends(self) -> Self:
        if self.budget is None and self.stopping is None:
            raise PydanticCustomError("endless", "neither budget nor stopping; at least one of them")
        return self
