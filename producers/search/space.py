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
    if dimension.type == "bool":
        return 2
    if dimension.values is not None:
        return len(dimension.values)
    low, high = _bounds(dimension)
    if dimension.type == "float":
        return 1 if low == high else None
    return int(high - low) // (dimension.step or 1) + 1


def _bounds(dimension: SearchDimension) -> tuple[float, float]:
    assert dimension.low is not None and dimension.high is not None
    return dimension.low, dimension.high


def _value(dimension: SearchDimension, u: float) -> Value:
    if dimension.type in ("choice", "bool"):
        values: Sequence[Value] = (False, True) if dimension.values is None else dimension.values
        return values[min(int(u * len(values)), len(values) - 1)]
    low, high = _bounds(dimension)
    if dimension.type == "float":
        found = (
            math.exp(math.log(low) + u * (math.log(high) - math.log(low))) if dimension.log else low + u * (high - low)
        )
        return low if u == 0.0 else high if u == 1.0 else min(max(found, low), high)
    if dimension.log:
        edges = math.log(low - 0.5), math.log(high + 0.5)
        return int(min(max(round(math.exp(edges[0] + u * (edges[1] - edges[0]))), low), high))
    count, step = levels_of(dimension) or 1, dimension.step or 1
    return int(low) + min(int(u * count), count - 1) * step


def _coordinate(dimension: SearchDimension, value: Value) -> float:
    if dimension.type in ("choice", "bool"):
        values: Sequence[Value] = (False, True) if dimension.values is None else dimension.values
        return (values.index(value) + 0.5) / len(values)
    low, high = _bounds(dimension)
    assert isinstance(value, int | float)
    if dimension.type == "int":
        if dimension.log:
            edges = math.log(low - 0.5), math.log(high + 0.5)
            return (math.log(value) - edges[0]) / (edges[1] - edges[0])
        return ((value - low) / (dimension.step or 1) + 0.5) / (levels_of(dimension) or 1)
    if low == high:
        return 0.5
    if dimension.log:
        return (math.log(value) - math.log(low)) / (math.log(high) - math.log(low))
    return (value - low) / (high - low)


def _contains(dimension: SearchDimension, value: Value) -> bool:
    if dimension.type == "bool":
        return isinstance(value, bool)
    if dimension.values is not None:
        return value in dimension.values
    low, high = _bounds(dimension)
    if isinstance(value, bool) or not isinstance(value, int if dimension.type == "int" else int | float):
        return False
    return low <= value <= high and (dimension.type == "float" or (value - low) % (dimension.step or 1) == 0)
