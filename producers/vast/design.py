"""Designs: which combinations of the producers' choices become configurations."""

from typing import Annotated, Any, Final, Literal, Self

from pydantic import BeforeValidator, Field, model_validator
from pydantic_core import PydanticCustomError

from vastflow.producers.faults import shown
from vastflow.producers.quantities import Count, Seed
from vastflow.producers.vast.section import Section

MOST_STRENGTH: Final = 6


class TWay(Section):
    """Every combination of the choices of any `strength` producers, in few configurations."""

    strength: Annotated[int, Field(ge=1, le=MOST_STRENGTH, strict=True)] = 2
    """How many producers' choices are combined with each other in all ways."""


class Sample(Section):
    """A number of combinations, spread over all of them."""

    method: Literal["lhs", "sobol", "random"]
    """`lhs`: Latin hypercube, every choice of a producer about equally often; `sobol`: scrambled Sobol sequence;
    `random`: independently of each other."""
    size: Count
    """How many."""
    seed: Seed = 0
    """Seed of the sample."""


def _named(value: Any) -> Any:
    if value is None or value == "cartesian":
        return {"cartesian": {}}
    if isinstance(value, str):
        right = "cartesian, 't_way: {strength: 2}' or 'sample: {method: lhs, size: 100}'"
        raise PydanticCustomError("design", "found {found}; {right}", {"found": shown(value), "right": right})
    if isinstance(value, dict):
        return {key: {} if item is None else item for key, item in value.items()}
    return value


class DesignSpec(Section):
    """Which combinations become configurations: one of these."""

    cartesian: Section | None = None
    """Every combination."""
    t_way: TWay | None = None
    """Few combinations, in which every possible one of any `strength` producers' choices occurs."""
    sample: Sample | None = None
    """A number of combinations, spread over all of them."""

    @model_validator(mode="after")
    def _one(self) -> Self:
        given = [name for name in type(self).model_fields if getattr(self, name) is not None]
        if len(given) != 1:
            found = " and ".join(given) or "nothing"
            raise PydanticCustomError("design", "found {found}; one of cartesian, t_way and sample", {"found": found})
        return self


Design = Annotated[DesignSpec, BeforeValidator(_named, json_schema_input_type=Literal["cartesian"] | DesignSpec)]
CARTESIAN: Final = DesignSpec(cartesian=Section())
