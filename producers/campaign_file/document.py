"""YAML files as plain data with the place of each key and value, and pydantic's errors as faults."""

import math
import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, Final, Literal, get_args

from pydantic import BaseModel, ValidationError
from pydantic_core import ErrorDetails
from yaml.constructor import ConstructorError, SafeConstructor
from yaml.nodes import MappingNode, Node, ScalarNode, SequenceNode

from vastflow.producers.model.faults import MISSING_FILE, Location, path_text, shown
from vastflow.sim.model.faults import Complaint, Fault, FaultKind, FileError, Got, Invalid, Place, Problem
from vastflow.sim.model.files import TextPlace, Unreadable, place_of, read_text, yaml_node
from vastflow.sim.model.names import did_you_mean

TAG: Final = "tag:yaml.org,2002:"
EXPONENT: Final = re.compile(r"[-+]?(\d+(\.\d*)?|\.\d+)[eE][-+]?\d+")
OCTAL_OR_BASE_60: Final = re.compile(r"[-+]?(0[0-7_]+|[0-9][0-9_]*(:[0-5]?[0-9])+(\.[0-9_]*)?)")
MEANING: Final = {"bool": "true or false", "int": "a whole number", "float": "a number"}


@dataclass(frozen=True)
class Document:
    """The first document of a YAML file.

    Attributes:
        file: The file's name as the user gave it.
        data: Mappings with text keys, lists, text, whole numbers of 64 bits, finite floats, booleans, None.
        keys, values: Place of each key, and of each value.
        faults: Faults that could be stepped over: duplicate keys, values that can't be read.
        notes: Values that YAML 1.1 reads otherwise than one would think.
        text: Content of the file.
    """

    file: str
    data: dict[str, Any]
    keys: Mapping[Location, TextPlace]
    values: Mapping[Location, TextPlace]
    faults: tuple[Fault, ...] = ()
    notes: tuple[Fault, ...] = ()
    text: str = field(default="", repr=False)

    def known(self, location: Location) -> Location:
        """The part of `location` that the file has; elements that lead nowhere, as unions add them, are left out."""
        found: Location = ()
        for part in location:
            if (*found, part) in self.values:
                found = (*found, part)
        return found

    def value(self, location: Location) -> Any:
        """Return the value at a location; None if the file has none there."""
        found: Any = self.data
        for part in location if location in self.values else ():
            found = found[part]
        return found if location in self.values else None

    def place(self, location: Location, at: Literal["key", "value"] = "value") -> TextPlace:
        """Line and column of the value or its key, or of the nearest thing above that the file has."""
        found = self.known(location)
        return (self.keys.get(found) if at == "key" else None) or self.values[found]

    def fault(
        self,
        location: Location,
        problem: Problem,
        expected: str = "",
        at: Literal["key", "value"] = "value",
        kind: FaultKind = "error",
    ) -> Fault:
        """Return a fault at a location of this file."""
        return Fault(Place(self.file, *self.place(location, at), path_text(location)), problem, expected, kind)

    def note(self, kind: FaultKind, location: Location, problem: Problem, expected: str = "") -> Fault:
        """Return a note on the key at a location of this file."""
        return self.fault(location, problem, expected, "key", kind)


def read_document(path: str | Path) -> Document:
    """Read the first document of a YAML 1.1 file with its positions.

    Numbers such as `1e3`, which YAML 1.1 takes for text, are numbers; dates stay text as they are written.

    Raises:
        FileError: no such file, not YAML, empty, not a mapping.
    """
    file = str(path)
    try:
        text = read_text(path, "a .vast file")
        node = yaml_node(text)
    except Unreadable as error:
        raise FileError([Fault(Place(file, *error.place), error.problem, error.expected)]) from None
    if node is None or (isinstance(node, ScalarNode) and node.tag == f"{TAG}null"):
        raise FileError([Fault(Place(file), "the file is empty", "A campaign needs at least 'configuration'")])
    if not isinstance(node, MappingNode):
        found = "a list" if isinstance(node, SequenceNode) else shown(node.value)
        right = "a mapping with the sections of a campaign, such as configuration and execution"
        raise FileError([Fault(Place(file, *place_of(node)), Got(found), right)])
    walk = _Walk(file)
    data = walk.value(node, ())
    faults, notes = (tuple(f for f in walk.faults if f.kind == kind) for kind in ("error", "warning"))
    return Document(file, data, walk.keys, walk.values, faults, notes, text)


class _Walk:
    """One walk over a composed node graph; `value` of the root fills the positions and faults."""

    def __init__(self, file: str) -> None:
        self.keys: dict[Location, TextPlace] = {}
        self.values: dict[Location, TextPlace] = {}
        self.faults: list[Fault] = []
        self._file = file
        self._constructor = SafeConstructor()

    def value(self, node: Node, location: Location) -> Any:
        self.values[location] = place_of(node)
        if isinstance(node, ScalarNode):
            return self._scalar(node, location)
        if isinstance(node, MappingNode) and node.tag == f"{TAG}map":
            return self._mapping(node, location)
        if isinstance(node, SequenceNode) and node.tag == f"{TAG}seq":
            return [self.value(item, (*location, i)) for i, item in enumerate(node.value)]
        self._fault(node, location, Got(f"the tag {node.tag.replace(TAG, '!!')}"), "no tag")
        return None

    def _mapping(self, node: MappingNode, location: Location) -> dict[str, Any]:
        data: dict[str, Any] = {}
        own = [pair for pair in node.value if pair[0].tag != f"{TAG}merge"]
        for i, (key_node, value_node) in enumerate([*own, *self._merged(node, location)]):
            key = self._key(key_node, location)
            if key in data and i < len(own):
                first, _ = self.keys[(*location, key)]
                what = f"duplicate key {key!r}, given in line {first} already"
                self._fault(key_node, (*location, key), what, "keep one of them")
            elif key is not None and key not in data:
                self.keys[(*location, key)] = place_of(key_node)
                data[key] = self.value(value_node, (*location, key))
        return data

    def _merged(self, node: MappingNode, location: Location) -> Iterator[tuple[Node, Node]]:
        """Pairs that `<<` brings in, the nearest first."""
        for key_node, value_node in node.value:
            if key_node.tag != f"{TAG}merge":
                continue
            for source in value_node.value if isinstance(value_node, SequenceNode) else [value_node]:
                if not isinstance(source, MappingNode):
                    self._fault(value_node, (*location, "<<"), Got("another value to merge"), "an alias of a mapping")
                    continue
                yield from (pair for pair in source.value if pair[0].tag != f"{TAG}merge")
                yield from self._merged(source, location)

    def _key(self, node: Node, location: Location) -> str | None:
        """The key as it is written: `on`, `1` and `2024-01-01` are text here."""
        if isinstance(node, ScalarNode) and node.value and node.tag.startswith(TAG):
            return str(node.value)
        found = shown(node.value) if isinstance(node, ScalarNode) else "a list or mapping"
        self._fault(node, location, Got(found), "text as a key")
        return None

    def _scalar(self, node: ScalarNode, location: Location) -> Any:
        kind, text = node.tag.removeprefix(TAG), node.value
        if kind in ("str", "timestamp", "value", "merge"):
            is_number = not node.style and EXPONENT.fullmatch(text) and math.isfinite(float(text))
            return float(text) if is_number else text
        if kind == "null":
            return None
        try:
            found = self._constructor.construct_object(node) if kind in MEANING else None
        except (ConstructorError, ValueError, KeyError, IndexError, OverflowError):
            self._fault(node, location, Got(shown(text)), f"{MEANING[kind]}, or quotes round a text")
            return None
        if found is None:
            self._fault(node, location, Got(f"the tag {node.tag.replace(TAG, '!!')}"), "no tag")
        elif kind == "float" and not math.isfinite(found):
            self._fault(node, location, Got(text), "a finite number")
        elif kind == "int" and not -(2**63) <= found < 2**63:
            self._fault(node, location, Got(shown(text)), "a whole number of at most 64 bits")
        else:
            if kind != "bool" and OCTAL_OR_BASE_60.fullmatch(text):
                what = f"YAML 1.1 reads {text} as {found}"
                self._fault(node, location, what, f"write {found}, or put a text in quotes", "warning")
            return found
        return None

    def _fault(self, node: Node, location: Location, what: Problem, right: str, kind: FaultKind = "error") -> None:
        place = Place(self._file, *place_of(node), path_text(location))
        self.faults.append(Fault(place, what, right, kind))


EXPECTED: Final[Mapping[str, str]] = {
    "int_type": "a whole number",
    "int_parsing": "a whole number",
    "int_from_float": "a whole number",
    "float_type": "a number",
    "float_parsing": "a number",
    "finite_number": "a finite number",
    "string_type": "text",
    "string_too_short": "text of {min_length} characters or more",
    "string_too_long": "text of {max_length} characters or fewer",
    "string_pattern_mismatch": "text of the form {pattern}",
    "bool_type": "true or false",
    "bool_parsing": "true or false",
    "list_type": "a list",
    "tuple_type": "a list",
    "dict_type": "a mapping",
    "model_type": "a mapping",
    "model_attributes_type": "a mapping",
    "none_required": "nothing",
    "greater_than": "a number greater than {gt:g}",
    "greater_than_equal": "{ge:g} or more",
    "less_than": "a number less than {lt:g}",
    "less_than_equal": "{le:g} or less",
    "too_short": "{min_length} or more entries",
    "too_long": "{max_length} or fewer entries",
    "literal_error": "{expected}",
}
"""Type of a pydantic error to what would be right; the braces are the error's context."""


def faults_of(document: Document, base: Location, model: type[BaseModel], error: ValidationError) -> list[Fault]:
    """The faults behind `error`, which `model` raised on the value at `base`.

    An error's location may lead through elements that are no part of the file (pydantic adds the branches of a
    union); of a union's errors the deepest are kept, and those of one place become one fault.
    """
    located = [(document.known((*base, *detail["loc"])), detail) for detail in error.errors(include_url=False)]
    merged: dict[tuple[Location, Problem, str], list[Fault]] = {}
    for found, detail in located:
        is_branch = len(found) < len(base) + len(detail["loc"])
        is_branch &= detail["type"] not in ("missing", "extra_forbidden")
        if is_branch and any(len(other) > len(found) and other[: len(found)] == found for other, _ in located):
            continue
        fault = _fault(document, found, model, detail)
        merged.setdefault((found, fault.problem, "" if is_branch else fault.expected), []).append(fault)
    expected = [" or ".join(dict.fromkeys(fault.expected for fault in same)) for same in merged.values()]
    return [replace(same[-1], expected=words) for same, words in zip(merged.values(), expected, strict=True)]


def _fault(document: Document, found: Location, model: type[BaseModel], detail: ErrorDetails) -> Fault:
    kind, context, given = detail["type"], detail.get("ctx", {}), detail["input"]
    if kind == "extra_forbidden":
        known = _model_at(model, detail["loc"][:-1]).model_fields
        fault = document.fault(found, f"unknown key {found[-1]!r}", did_you_mean(str(found[-1]), known), "key")
        return replace(fault, place=replace(fault.place, where=path_text(found[:-1])))
    if kind == "missing":
        name = str(detail["loc"][-1])
        field = _model_at(model, detail["loc"][:-1]).model_fields.get(name)
        about = " ".join(((field and field.description) or "").split(";")[0].split(". ")[0].split())
        return document.fault(found, f"{name!r} is missing", about, "key")
    if kind == "second_key":
        return document.fault((*found, str(context["key"])), *_complaint(detail), "key")
    if "at" in context:
        found = document.known((*found, str(context["at"])))
    if kind in EXPECTED:
        right = EXPECTED[kind].format(**context)
        if kind == "literal_error" and isinstance(given, str):
            values = [part.strip("' ") for part in right.replace(" or ", ", ").split(",")]
            return document.fault(found, f"unknown value {given!r}", did_you_mean(given, values))
        if kind == "string_type" and isinstance(given, int | float):
            right = "text in quotes"
        return document.fault(found, Got(shown(given)), right)
    # A mapping begins below the key that names it, and the fault is one of the whole.
    whole_mapping = "at" not in context and isinstance(given, Mapping)
    kind_of_fault: FaultKind = "missing" if kind == MISSING_FILE else "error"
    return document.fault(found, *_complaint(detail), "key" if whole_mapping else "value", kind_of_fault)


def _complaint(detail: ErrorDetails) -> Complaint:
    """Return a validator's own message; of a plain text it is the problem."""
    error = detail.get("ctx", {}).get("error")
    if isinstance(error, Invalid):
        return error.problem, error.expected
    return " ".join(str(error if isinstance(error, Exception) else detail["msg"]).split()), ""


def _model_at(model: type[BaseModel], location: tuple[int | str, ...]) -> type[BaseModel]:
    """The model of the value at `location`, through lists, unions, and mappings."""
    for part in location:
        field = model.model_fields.get(str(part))
        model = (next(_models_in(field.annotation), None) if field else None) or model
    return model


def _models_in(annotation: Any) -> Iterator[type[BaseModel]]:
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        yield annotation
    for argument in get_args(annotation):
        yield from _models_in(argument)
