"""Constraints φ: named expressions that a configuration must satisfy, read and evaluated."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, Final

from vastflow.producers.campaign_file.document import Document
from vastflow.producers.constraints.expression import ConstraintExpression, ExpressionName, NotEvaluable, expression_of
from vastflow.producers.constraints.quantities import QUANTITIES, may_write_for, quantity
from vastflow.producers.model.configuration import ExcludedInstance, Partial
from vastflow.producers.model.faults import Location, path_text, shown
from vastflow.producers.model.producer import Producer
from vastflow.producers.places.start_check import StartCheck
from vastflow.sim.model.digest import Value
from vastflow.sim.model.faults import Fault, FileError, Got, Place
from vastflow.sim.model.names import did_you_mean

MOST_REPORTED: Final = 3
"""Instances in which a constraint can't be evaluated that are told of, for each constraint."""
MOST_NAME: Final = 60
NOWHERE: Final = Place("campaign", where="constraints")


@dataclass(frozen=True, slots=True)
class Constraint:
    """A named expression; the report counts its exclusions by name."""

    name: str
    expression: ConstraintExpression
    place: Place = NOWHERE

    def touched_by(self, producer: Producer[Any]) -> bool:
        """Whether its quantities can depend on a producer's keys."""
        return any(
            any(key in producer.writes for key, _ in name.readings)
            or name.text.startswith("_")  # provenance is declared nowhere
            or (name.text in QUANTITIES and may_write_for(name.text, producer))
            for name in self.expression.names
        )


class Checker:
    """Evaluates constraints on configurations of one family, and remembers what can't be evaluated."""

    def __init__(self, family: str) -> None:
        self._family = family
        self._faults: dict[str, list[Fault]] = {}

    def excluded(self, partial: Partial, constraints: Sequence[Constraint]) -> ExcludedInstance | None:
        """The first constraint that `partial` violates, with its values; None if there is none.

        One that can't be evaluated is remembered for `raise_faults` and excludes nothing.
        """
        for constraint in constraints:
            looked: dict[str, Value] = {}
            try:
                if not constraint.expression.holds(_looking(partial, looked)):
                    return ExcludedInstance(self._family, partial.name, constraint.name, looked)
            except NotEvaluable as error:
                what = f"constraint {constraint.name!r} can't be evaluated for {partial.name}: {error}"
                right = "it must be true or false of every configuration: write 'defined(name) implies …' where a name is not always there"
                faults = self._faults.setdefault(constraint.name, [])
                if len(faults) < MOST_REPORTED:
                    faults.append(Fault(constraint.place, what, right))
        return None

    def raise_faults(self) -> None:
        """Raise what could not be evaluated.

        Raises:
            FileError: constraint, instance and reason.
        """
        if self._faults:
            raise FileError(fault for faults in self._faults.values() for fault in faults)


def _looking(partial: Partial, looked: dict[str, Value]) -> Callable[[ExpressionName], Any]:
    """Return a function that looks up names in a configuration and caches the values."""

    def look(name: ExpressionName) -> Any:
        for key, within in name.readings:
            if key in partial.values:
                value: Any = partial.values[key]
                for part in within:
                    in_map = isinstance(part, str) and isinstance(value, Mapping) and part in value
                    in_list = isinstance(part, int) and isinstance(value, list | tuple) and part < len(value)
                    if not (in_map or in_list):
                        raise NotEvaluable(f"{name.text!r}: there is no {part!r} in {str(value)[:60]}")
                    value = value[part]
                break
        else:
            if name.text not in QUANTITIES:
                raise NotEvaluable(f"it has no {name.text!r}")
            value = quantity(name.text, partial)
        looked[name.text] = value
        return value

    return look


def step_of(gate: Constraint | StartCheck, producers: Sequence[Producer[Any]]) -> int:
    """Index of the producer after which all that a condition names is written; -1: it is from the beginning."""
    return max((i for i, producer in enumerate(producers) if gate.touched_by(producer)), default=-1)


def read_constraints(document: Document, location: Location) -> tuple[list[Constraint], list[Fault]]:
    """The valid constraints at `location`, a list of `- name: expression` or a mapping, and faults."""
    constraints: list[Constraint] = []
    faults: list[Fault] = []
    seen: set[str] = set()
    for where, name, text in _entries(document, location, faults):
        if name in seen:
            faults.append(document.fault(where, f"duplicate constraint {name!r}", "choose another name", "key"))
            continue
        seen.add(name)
        if not name.strip() or len(name) > MOST_NAME:
            faults.append(document.fault(where, Got(shown(name)), f"a name of 1 to {MOST_NAME} characters", "key"))
        elif not isinstance(text, str):
            faults.append(document.fault(where, Got(shown(text)), "an expression such as 'robot_radius < 0.3'"))
        else:
            place = Place(document.file, *document.place(where), path_text(where))
            try:
                constraints.append(Constraint(name, expression_of(text), place))
            except FileError as error:
                (fault,) = error.faults
                inside = place_inside(document.text, document.place(where), text, fault.place.column - 1)
                faults.append(replace(fault, place=Place(document.file, *inside, path_text(where))))
    return constraints, faults


def unknown_names(document: Document, constraint: Constraint, written: set[str]) -> Iterator[Fault]:
    """Yield a fault for each name that is neither a key of `written` nor a quantity."""
    place, text = constraint.place, constraint.expression.text
    for name in constraint.expression.names:
        keys = [key for key, _ in name.readings]
        if name.text.startswith("_") or name.text in QUANTITIES or not written.isdisjoint(keys):
            continue
        line, column = place_inside(document.text, (place.line, place.column), text, name.offset)
        what = f"nothing in this family writes {name.text!r}"
        yield Fault(replace(place, line=line, column=column), what, did_you_mean(keys[-1], {*written, *QUANTITIES}))


def place_inside(source: str, place: tuple[int, int], text: str, offset: int) -> tuple[int, int]:
    """Line and column of the character `offset` of a YAML scalar that begins at `place` of `source` and reads `text`.

    YAML folds lines, so the characters are matched by those that are no white space.
    """
    lines = source.splitlines()
    row, column = place[0] - 1, place[1] - 1
    if row >= len(lines):
        return place
    opening = lines[row][column : column + 1]
    if opening in ("|", ">"):
        row, column = row + 1, 0
    elif opening in ("'", '"'):
        column += 1
    before = sum(not letter.isspace() for letter in text[:offset])
    at_end = not text[offset:].strip()
    # The last character and one further, where what is wrong is that the text ends.
    for i, (r, c, letter) in enumerate(_letters(lines, row, column, opening)):
        if at_end and i == before - 1:
            return r + 1, c + 2
        if not at_end and i == before:
            return (r + 1, c + 1) if letter == text[offset:].lstrip()[0] else place
    return place


def _letters(lines: Sequence[str], row: int, column: int, opening: str) -> Iterator[tuple[int, int, str]]:
    for r in range(row, len(lines)):
        c = column if r == row else 0
        while c < len(lines[r]):
            letter = lines[r][c]
            if opening == '"' and letter == "\\":
                c += 1
                letter = lines[r][c : c + 1]
            elif opening == "'" and lines[r][c : c + 2] == "''":
                c += 1
            if letter and not letter.isspace():
                yield r, c, letter
            c += 1


def _entries(document: Document, location: Location, faults: list[Fault]) -> Iterator[tuple[Location, str, Any]]:
    match document.value(location):
        case dict() as entries:
            yield from (((*location, name), name, text) for name, text in entries.items())
        case [*entries]:
            for k, entry in enumerate(entries):
                if isinstance(entry, dict) and len(entry) == 1:
                    yield from (((*location, k, name), name, text) for name, text in entry.items())
                else:
                    faults.append(document.fault((*location, k), Got(shown(entry)), "'name: \"expression\"'"))
        case other if other is not None:
            right = "a list of named expressions, '- name: \"expression\"'"
            faults.append(document.fault(location, Got(shown(other)), right))
