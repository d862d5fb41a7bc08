"""Constraints φ: named expressions that a configuration must fulfil."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Final, Protocol

from vastflow.producers.constraints.expression import ConstraintExpression, ExpressionName, NotEvaluable
from vastflow.producers.constraints.quantities import QUANTITIES, may_write_for, quantity
from vastflow.producers.model.configuration import ExcludedInstance, Partial
from vastflow.producers.model.producer import Producer
from vastflow.sim.model.digest import Value
from vastflow.sim.model.faults import Fault, FileError, Place

MOST_REPORTED: Final = 3
"""Instances in which a constraint can't be evaluated that are told of, for each constraint."""


NOWHERE: Final = Place("campaign", where="constraints")


@dataclass(frozen=True, slots=True)
class Constraint:
    """A named expression.

    Attributes:
        name: In the report, with the number of what it excluded.
    """

    name: str
    expression: ConstraintExpression
    place: Place = NOWHERE

    def touched_by(self, producer: Producer[Any]) -> bool:
        """Whether what it looks at can depend on what a producer writes."""
        return any(_touches(producer, name) for name in self.expression.names)


def _touches(producer: Producer[Any], name: ExpressionName) -> bool:
    keys = [key for key, _ in name.readings]
    if any(key in producer.writes for key in keys):
        return True
    if name.text.startswith("_"):
        return True  # provenance is declared nowhere
    return name.text in QUANTITIES and may_write_for(name.text, producer)


class Checker:
    """Evaluates constraints on configurations of one family, and keeps what it has computed of maps and paths."""

    def __init__(self, family: str) -> None:
        self._family = family
        self._faults: dict[str, list[Fault]] = {}

    def excluded(self, partial: Partial, constraints: Sequence[Constraint]) -> ExcludedInstance | None:
        """The first constraint that `partial` breaks, with what it looked at; None where it keeps them all.

        One that can't be evaluated is remembered for `raise_faults` and excludes nothing.
        """
        for constraint in constraints:
            looked: dict[str, Value] = {}
            try:
                if constraint.expression.holds(self._look(partial, looked)):
                    continue
            except NotEvaluable as error:
                self._remember(constraint, partial, str(error))
                continue
            return ExcludedInstance(self._family, partial.name, constraint.name, looked)
        return None

    def raise_faults(self) -> None:
        """Raise what could not be evaluated.

        Raises:
            FileError: constraint, instance and reason.
        """
        if self._faults:
            raise FileError(fault for faults in self._faults.values() for fault in faults[:MOST_REPORTED])

    def _remember(self, constraint: Constraint, partial: Partial, reason: str) -> None:
        what = f"constraint {constraint.name!r} can't be evaluated for {partial.name}: {reason}"
        right = "an expression that is true or false of every configuration; 'defined(name) implies …' where a name is not always there"
        faults = self._faults.setdefault(constraint.name, [])
        if len(faults) < MOST_REPORTED:
            faults.append(Fault(constraint.place, what, right))

    def _look(self, partial: Partial, looked: dict[str, Value]) -> Any:
        def look(name: ExpressionName) -> Any:
            value = looked[name.text] = self._value(name, partial)
            return value

        return look

    def _value(self, name: ExpressionName, partial: Partial) -> Any:
        for key, within in name.readings:
            if key in partial.values:
                return _inside(name, partial.values[key], within)
        if name.text in QUANTITIES:
            return quantity(name.text, partial)
        raise NotEvaluable(f"it has no {name.text!r}")


def _inside(name: ExpressionName, value: Any, within: Sequence[str | int]) -> Any:
    for part in within:
        in_map = isinstance(part, str) and isinstance(value, Mapping) and part in value
        in_list = isinstance(part, int) and isinstance(value, list | tuple) and part < len(value)
        if not (in_map or in_list):
            raise NotEvaluable(f"{name.text!r}: there is no {part!r} in {str(value)[:60]}")
        value = value[part]
    return value


class Gate(Protocol):
    """A condition on configurations: a constraint or the start check."""

    def touched_by(self, producer: Producer[Any]) -> bool:
        """Whether what it looks at can depend on what a producer writes."""


def step_of(constraint: Gate, producers: Sequence[Producer[Any]]) -> int:
    """Index of the producer after which all that a constraint names is written; -1: it is from the beginning."""
    return max((i for i, producer in enumerate(producers) if constraint.touched_by(producer)), default=-1)
