"""Repetitions: how often a configuration is run, a fixed number of times or until its class is shown."""

from collections.abc import Mapping
from typing import Annotated, Any, TypeAlias

from pydantic import Discriminator, Field, Tag, model_validator
from pydantic_core import PydanticCustomError

from vastflow.producers.quantities import Count, Number
from vastflow.producers.vast.section import Section

Rate: TypeAlias = Annotated[Number, Field(gt=0, lt=1)]


class Stop(Section):
    """When the class of a configuration counts as shown, by its runs that pass all oracles."""

    error: Annotated[Number, Field(gt=0, lt=0.5)] = 0.05
    """Probability of a wrong class, at most, whatever the true success rate."""
    systematic: Rate = 0.2
    """Success rate up to which a configuration fails systematically."""
    reliable: Rate = 0.8
    """Success rate from which on a configuration passes reliably."""

    @model_validator(mode="after")
    def _in_order(self) -> "Stop":
        if not self.systematic < self.reliable:
            raise PydanticCustomError(
                "order",
                "systematic is {systematic} and reliable {reliable}; systematic below reliable",
                {"systematic": self.systematic, "reliable": self.reliable},
            )
        return self


class Sequential(Section):
    """Runs of a configuration end when its class is shown: reliable, systematic or flaky."""

    min: Count = 5
    """Runs of every configuration."""
    max: Count
    """Runs after which a configuration is undecided."""
    stop: Stop
    """When a class counts as shown; `{}` takes the error and the bounds of the paper."""

    @model_validator(mode="after")
    def _room(self) -> "Sequential":
        if self.min > self.max:
            raise PydanticCustomError(
                "order", "min is {min} and max {max}; min of max or less", {"min": self.min, "max": self.max}
            )
        return self


def _kind(value: Any) -> str:
    return "sequential" if isinstance(value, Mapping | Sequential) else "number"


Repetitions: TypeAlias = Annotated[
    Annotated[Count, Tag("number")] | Annotated[Sequential, Tag("sequential")], Discriminator(_kind)
]
