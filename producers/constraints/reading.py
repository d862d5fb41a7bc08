"""Constraints as they stand in a campaign file, with places inside of their text."""

from collections.abc import Iterator, Sequence
from dataclasses import replace
from typing import Any, Final

from vastflow.producers.campaign_file.document import Document
from vastflow.producers.constraints.constraint import Constraint
from vastflow.producers.constraints.expression import ExpressionName, expression_of
from vastflow.producers.constraints.quantities import QUANTITIES
from vastflow.producers.model.faults import Location, path_text, shown
from vastflow.sim.model.faults import Fault, FileError, Place
from vastflow.sim.model.names import did_you_mean

RIGHT: Final = "a list of named expressions, '- name: \"expression\"'"
MOST_NAME: Final = 60


def read_constraints(document: Document, location: Location) -> tuple[list[Constraint], list[Fault]]:
    """The constraints at `location`, a list of `- name: expression` or a mapping, and what is wrong with the others."""
    constraints: list[Constraint] = []
    faults: list[Fault] = []
    seen: set[str] = set()
    for where, name, text in _entries(document, location, faults):
        if name in seen:
            faults.append(document.fault(where, f"a second constraint {name!r}", "another name", "key"))
            continue
        seen.add(name)
        if not name.strip() or len(name) > MOST_NAME:
            faults.append(document.fault(where, f"got {shown(name)}", f"a name of 1 to {MOST_NAME} characters", "key"))
            continue
        if not isinstance(text, str):
            faults.append(document.fault(where, f"got {shown(text)}", "an expression such as 'robot_radius < 0.3'"))
            continue
        try:
            expression = expression_of(text)
        except FileError as error:
            (fault,) = error.faults
            place = place_inside(document.text, document.place(where), text, fault.place.column - 1)
            faults.append(replace(fault, place=Place(document.file, *place, path_text(where))))
            continue
        line, column = document.place(where)
        constraints.append(Constraint(name, expression, Place(document.file, line, column, path_text(where))))
    return constraints, faults


def unknown_names(constraint: Constraint, written: set[str]) -> Iterator[tuple[ExpressionName, str, str]]:
    """Names that are neither a key of `written` nor a quantity, with what is wrong and what would be right."""
    for name in constraint.expression.names:
        keys = [key for key, _ in name.readings]
        if name.text.startswith("_") or name.text in QUANTITIES or not written.isdisjoint(keys):
            continue
        right = did_you_mean(keys[-1], {*written, *QUANTITIES})
        yield name, f"{name.text!r} is written by nothing in this family", right


def fault_of(document: Document, constraint: Constraint, offset: int, what: str, right: str) -> Fault:
    """A fault at a character of a constraint's expression."""
    place = constraint.place
    inside = place_inside(document.text, (place.line, place.column), constraint.expression.text, offset)
    return Fault(Place(place.file, *inside, place.where), what, right)


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
    if document.known(location) != location:
        return
    found = document.value(location)
    if isinstance(found, dict):
        for name, text in found.items():
            yield (*location, name), name, text
    elif isinstance(found, list):
        for k, entry in enumerate(found):
            if isinstance(entry, dict) and len(entry) == 1:
                ((name, text),) = entry.items()
                yield (*location, k, name), name, text
            else:
                faults.append(document.fault((*location, k), f"got {shown(entry)}", "'name: \"expression\"'"))
    elif found is not None:
        faults.append(document.fault(location, f"got {shown(found)}", RIGHT))
