"""The space of a search: its typed dimensions, and their coding as the unit cube."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from vastflow.producers.campaign_file.search import SearchDimension
from vastflow.sim.model.digest import Value

Point: TypeAlias = Mapping[str, Value]
"""Name of each dimension to its value, in the file's order."""
Unit: TypeAlias = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class Space:
    """The space of a search; each dimension is an axis of the unit cube.

    A range of numbers goes from 0 at `low` to 1 at `high`, also on a logarithmic scale; countable values share it equally.

    Attributes:
        dimensions: Name to domain, in the file's order.
    """

    dimensions: Mapping[str, SearchDimension]

    @property
    def size(self) -> int | None:
        """The number of points; None if a dimension is continuous."""
        levels = [levels_of(each) for each in self.dimensions.values()]
        return None if None in levels else math.prod(level for level in levels if level is not None)

    def decoded(self, unit: Sequence[float] | Unit) -> Point:
        """The point at (d,) coordinates of the unit cube, what is outside of it brought to its border."""
        inside = np.clip(np.asarray(unit, dtype=np.float64), 0.0, 1.0).tolist()
        return {name: _value(each, u) for (name, each), u in zip(self.dimensions.items(), inside, strict=True)}

    def encoded(self, point: Point) -> Unit:
        """The (d,) coordinates of a point; of a value that can be counted the middle of its part."""
        return np.array([_coordinate(each, point[name]) for name, each in self.dimensions.items()])

    def contains(self, point: Point) -> bool:
        """Whether it has a value of each dimension's type and domain, and no others."""
        return point.keys() == self.dimensions.keys() and all(
            _contains(each, point[name]) for name, each in self.dimensions.items()
        )


def levels_of(dimension: SearchDimension) -> int | None:
    """Return the number of values; None if they are continuous, unless there is but one."""
    if dimension.type == "float":
        return 1 if dimension.low == dimension.high else None
    return len(_values(dimension))


def _values(dimension: SearchDimension) -> Sequence[Value]:
    """The values of a dimension of another type than `float`, in order."""
    if dimension.type == "bool":
        return (False, True)
    if dimension.values is not None:
        return dimension.values
    low, high = _bounds(dimension)
    return range(int(low), int(high) + 1, dimension.step or 1)


def _bounds(dimension: SearchDimension) -> tuple[float, float]:
    assert dimension.low is not None and dimension.high is not None
    return dimension.low, dimension.high


def _is_scaled(dimension: SearchDimension) -> bool:
    """Whether values lie along a scale of real numbers, in place of sharing the axis equally."""
    return dimension.type == "float" or dimension.log


def _scale(dimension: SearchDimension) -> tuple[float, float]:
    """The ends of the scale; an integer on a logarithmic scale takes half a step to both sides."""
    low, high = _bounds(dimension)
    half = 0.5 if dimension.type == "int" else 0.0
    return (math.log(low - half), math.log(high + half)) if dimension.log else (low, high)


def _value(dimension: SearchDimension, u: float) -> Value:
    if not _is_scaled(dimension):
        values = _values(dimension)
        return values[min(int(u * len(values)), len(values) - 1)]
    (low, high), (start, stop) = _bounds(dimension), _scale(dimension)
    along = start + u * (stop - start)
    found = min(max(math.exp(along) if dimension.log else along, low), high)
    if dimension.type == "int":
        return round(found)
    return low if u == 0.0 else high if u == 1.0 else found


def _coordinate(dimension: SearchDimension, value: Value) -> float:
    if not _is_scaled(dimension):
        values = _values(dimension)
        return (values.index(value) + 0.5) / len(values)
    assert isinstance(value, int | float)
    start, stop = _scale(dimension)
    return 0.5 if start == stop else ((math.log(value) if dimension.log else value) - start) / (stop - start)


def _contains(dimension: SearchDimension, value: Value) -> bool:
    if dimension.type == "choice":
        return value in _values(dimension)
    if (dimension.type == "bool") != isinstance(value, bool):
        return False
    if dimension.type == "float":
        low, high = _bounds(dimension)
        return isinstance(value, int | float) and low <= value <= high
    return isinstance(value, int) and value in _values(dimension)
