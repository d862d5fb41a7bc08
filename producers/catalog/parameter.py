"""Producers of plain values: listed, or drawn from a distribution.

They read nothing, so that their values are drawn once and shared by every parent configuration.
"""

import math
from abc import abstractmethod
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Annotated, Any, Literal, Self, TypeAlias, TypeVar

import numpy as np
from pydantic import BeforeValidator, Field, JsonValue, PlainSerializer, TypeAdapter, ValidationInfo, model_validator

from vastflow.producers.model import producer
from vastflow.producers.model.configuration import Fragment, Rejection
from vastflow.producers.model.numbers import Count, NotNegative, Number, Seed
from vastflow.producers.model.producer import Draws, Producer
from vastflow.producers.places.ground import MAP_FILE_KEYS, map_value, serializable
from vastflow.sim.model.digest import Value, digest
from vastflow.sim.model.elementary import normals
from vastflow.sim.model.faults import Got, Invalid
from vastflow.sim.model.obstacle import lists_obstacles
from vastflow.sim.model.scenario import DIMENSION_OF_KEY, Dimension
from vastflow.sim.plug_ins.registry import plug_in_value
from vastflow.sim.reading.movers import MOVERS_KEY, movers_value
from vastflow.sim.system.robot import NOISE_MODEL_KEY
from vastflow.sim.world.environment import WORLD_KEY
from vastflow.sim.world.readers.own import world_value

ParameterName: TypeAlias = Annotated[str, Field(min_length=1)]
ParameterKind: TypeAlias = Literal["int", "integer", "float", "double", "number", "bool", "boolean", "str", "string"]
WHOLE = ("int", "integer")
FLAG = ("bool", "boolean")

_json_value: TypeAdapter[JsonValue] = TypeAdapter(JsonValue)


def _listed_value(value: Any, info: ValidationInfo) -> Any:
    name = info.data.get("name")
    if not isinstance(name, list):
        return _value(name, value, info)
    if not isinstance(value, list) or len(value) != len(name):
        raise ValueError(f"expected a list of {len(name)}, one for each of {', '.join(name)}, got {value!r}")
    return [_value(key, item, info) for key, item in zip(name, value, strict=True)]


def _value(name: str | None, value: Any, info: ValidationInfo) -> Any:
    if name in MAP_FILE_KEYS:
        return map_value(value, info)
    base = Path((info.context or {}).get("base", "."))
    if name == WORLD_KEY and isinstance(value, str):
        return world_value(value, base)
    if value is None:
        raise ValueError("expected text, a number, true or false, a list or a map, got nothing")
    if name == NOISE_MODEL_KEY:
        return plug_in_value(value, base)
    if name == MOVERS_KEY:
        return movers_value(value, base)
    _json_value.validate_python(value)
    digest(value)  # a ValueError where it has none
    return value


class ListParameters(producer.Parameters):
    """Parameters of `ParameterVariationList`."""

    name: ParameterName | Annotated[list[ParameterName], Field(min_length=1)]
    """Key to vary, or several that vary in lockstep."""
    values: Annotated[
        list[Annotated[Any, BeforeValidator(_listed_value), PlainSerializer(serializable, return_type=Any)]],
        Field(min_length=1),
    ]
    """The values in turn; with several names each value is a list, one item for each name. Values of `map_file`, `keepout_mask` and `speed_mask` are paths of maps."""


class ParameterVariationList(Producer[ListParameters]):
    """One configuration for each listed value."""

    Parameters = ListParameters

    reads = ()

    @property
    def writes(self) -> Mapping[str, Dimension | None]:
        """The named keys; lists of obstacles belong to the environment."""
        name, values = self.parameters.name, self.parameters.values
        columns = {name: values} if isinstance(name, str) else dict(zip(name, zip(*values, strict=True), strict=True))
        return {key: self.parameters.dimension or _dimension(key, column) for key, column in columns.items()}

    @property
    def most_choices(self) -> int:
        return len(self.parameters.values)

    def produce(self, inputs: Mapping[str, Value], draws: Draws) -> Iterator[Fragment | Rejection]:
        """Yield the values in the order of the file; draws nothing."""
        name = self.parameters.name
        for value in self.parameters.values:
            yield Fragment({name: value} if isinstance(name, str) else dict(zip(name, value, strict=True)))


def _dimension(key: str, values: Sequence[Value] = ()) -> Dimension:
    return DIMENSION_OF_KEY.get(key) or ("environment" if any(map(lists_obstacles, values)) else "system")


class DistributionParameters(producer.Parameters):
    """Base of the parameters of every distribution."""

    name: ParameterName
    """Key to vary."""
    num_variations: Count
    """Number of drawn values."""


D = TypeVar("D", bound=DistributionParameters)


class DistributionProducer(Producer[D]):
    """One configuration for each value drawn from a distribution."""

    reads = ()

    @property
    def writes(self) -> Mapping[str, Dimension | None]:
        name = self.parameters.name
        return {name: self.parameters.dimension or _dimension(name)}

    @property
    def most_choices(self) -> int:
        return self.parameters.num_variations

    def produce(self, inputs: Mapping[str, Value], draws: Draws) -> Iterator[Fragment | Rejection]:
        """Yield `num_variations` values; the k-th does not depend on their number."""
        for k in range(self.parameters.num_variations):
            yield Fragment({self.parameters.name: self._draw(draws(k))})

    @abstractmethod
    def _draw(self, rng: np.random.Generator) -> Value:
        """One value."""


class UniformParameters(DistributionParameters):
    """Parameters of `ParameterVariationDistributionUniform`."""

    min: Number
    """Lower bound, in the unit of the value; included for whole numbers."""
    max: Number
    """Upper bound, in the unit of the value; included for whole numbers. For `bool`, the probability of true."""
    type: ParameterKind = "float"
    """Type of the values; `str` writes the drawn number as text."""
    seed: Seed | None = None
    """Seed of the draws; 0 where none is given."""

    @model_validator(mode="after")
    def _check(self) -> Self:
        _check_bounds(self.type, self.min, self.max)
        if self.type in FLAG and not 0 <= self.min <= self.max <= 1:
            raise Invalid(f"'max' {self.max} is no probability", "for a bool, 'max' is the probability of true")
        return self


class ParameterVariationDistributionUniform(DistributionProducer[UniformParameters]):
    """One configuration for each value drawn uniformly between bounds."""

    Parameters = UniformParameters

    def _draw(self, rng: np.random.Generator) -> Value:
        asked = self.parameters
        if asked.type in WHOLE:
            return int(rng.integers(int(asked.min), int(asked.max), endpoint=True))
        if asked.type in FLAG:
            return bool(rng.random() < asked.max)
        value = float(rng.uniform(asked.min, asked.max))
        return str(value) if asked.type in ("str", "string") else value


class GaussianParameters(DistributionParameters):
    """Parameters of `ParameterVariationDistributionGaussian`."""

    mean: Number
    """Mean of the normal distribution, in the unit of the value."""
    std: NotNegative
    """Standard deviation of the normal distribution, in the unit of the value."""
    min: Number | None = None
    """Values below are set to this bound, not drawn again; no bound where none is given."""
    max: Number | None = None
    """Values above are set to this bound, not drawn again; no bound where none is given."""
    type: ParameterKind = "float"
    """Type of the values. Whole numbers are rounded; a `bool` is true from the mean upwards."""
    seed: Seed
    """Seed of the draws."""

    @model_validator(mode="after")
    def _check(self) -> Self:
        _check_bounds(self.type, self.min, self.max)
        return self


class ParameterVariationDistributionGaussian(DistributionProducer[GaussianParameters]):
    """One configuration for each value drawn from a normal distribution."""

    Parameters = GaussianParameters

    def _draw(self, rng: np.random.Generator) -> Value:
        asked = self.parameters
        value = max(
            asked.mean + asked.std * float(normals(rng, (1,), np.float64)[0]),
            -math.inf if asked.min is None else asked.min,
        )
        value = min(value, math.inf if asked.max is None else asked.max)
        if asked.type in WHOLE:
            return round(value)
        if asked.type in FLAG:
            return value >= asked.mean
        return str(value) if asked.type in ("str", "string") else value


def _check_bounds(kind: ParameterKind, low: float | None, high: float | None) -> None:
    if low is not None and high is not None and low > high:
        raise Invalid(f"'min' is {low} and 'max' {high}", "'min' must not be greater than 'max'")
    for name, bound in (("min", low), ("max", high)):
        if kind in WHOLE and bound is not None and not bound.is_integer():
            raise Invalid(Got(f"{name} {bound}"), "a whole number for type int")
