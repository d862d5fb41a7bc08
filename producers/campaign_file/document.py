"""A YAML file as plain data, where each key and value of it stands, and pydantic's errors as faults there."""

import math
import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, Final, Literal, get_args

from pydantic import BaseModel, ValidationError
from pydantic_core import ErrorDetails
from yaml.constructor import SafeConstructor
from yaml.nodes import MappingNode, Node, ScalarNode, SequenceNode

from vastflow.producers.model.faults import MISSING_FILE, Location, path_text, shown
from vastflow.sim.model.faults import Fault, FaultKind, FileError, Place, parted
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
        keys, values: Where they stand.
        faults: What was found and could be stepped over: duplicate keys, values that can't be read.
        notes: Values that YAML 1.1 reads otherwise than one would think.
        text: What the file holds.
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
        """Return the value at a location that the file has."""
        found: Any = self.data
        for part in location:
            found = found[part]
        return found

    def place(self, location: Location, at: Literal["key", "value"] = "value") -> TextPlace:
        """Line and column of the value or its key, or of the nearest thing above that the file has."""
        found = self.known(location)
        return (self.keys.get(found) if at == "key" else None) or self.values[found]

    def fault(
        self,
        location: Location,
        problem: str,
        expected: str = "",
        at: Literal["key", "value"] = "value",
        kind: FaultKind = "error",
    ) -> Fault:
        """Return a fault at a location of this file."""
        return Fault(Place(self.file, *self.place(location, at), path_text(location)), problem, expected, kind)

    def note(self, kind: FaultKind, location: Location, problem: str, expected: str = "") -> Fault:
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
        raise FileError([Fault(Place(file, *error.place, "file"), error.what, error.right)]) from None
    if node is None or (isinstance(node, ScalarNode) and node.tag == f"{TAG}null"):
        raise FileError([Fault(Place(file, 1, 1, "file"), "empty", "a campaign, at least its configuration")])
    if not isinstance(node, MappingNode):
        found = "a list" if isinstance(node, SequenceNode) else shown(node.value)
        right = "a mapping with the sections of a campaign, such as configuration and execution"
        raise FileError([Fault(Place(file, *place_of(node), "file"), f"got {found}", right)])
    walk = _Walk(file)
    data = walk.value(node, ())
    return Document(file, data, walk.keys, walk.values, tuple(walk.faults), tuple(walk.notes), text)


class _Walk:
    """One walk over a composed node graph; `value` of the root fills the positions, faults and notes."""

    def __init__(self, file: str) -> None:
        self.keys: dict[Location, TextPlace] = {}
        self.values: dict[Location, TextPlace] = {}
        self.faults: list[Fault] = []
        self.notes: list[Fault] = []
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
        self._fault(node, location, f"got the tag {_tag(node)}", "no tag")
        return None

    def _mapping(self, node: MappingNode, location: Location) -> dict[str, Any]:
        data: dict[str, Any] = {}
        for key_node, value_node in node.value:
            if key_node.tag == f"{TAG}merge":
                continue
            key = self._key(key_node, location)
            if key is None:
                continue
            if key in data:
                first, _ = self.keys[(*location, key)]
                self._fault(
                    key_node, (*location, key), "a second time the same key", f"one; the first is in line {first}"
                )
                continue
            self._enter(data, key, key_node, value_node, location)
        for key_node, value_node in self._merged(node, location):
            key = self._key(key_node, location)
            if key is not None and key not in data:
                self._enter(data, key, key_node, value_node, location)
        return data

    def _enter(self, data: dict[str, Any], key: str, key_node: Node, value_node: Node, location: Location) -> None:
        self.keys[(*location, key)] = place_of(key_node)
        data[key] = self.value(value_node, (*location, key))

    def _merged(self, node: MappingNode, location: Location) -> Iterator[tuple[Node, Node]]:
        """Pairs that `<<` brings in, the nearest first."""
        for key_node, value_node in node.value:
            if key_node.tag != f"{TAG}merge":
                continue
            for source in value_node.value if isinstance(value_node, SequenceNode) else [value_node]:
                if not isinstance(source, MappingNode):
                    self._fault(value_node, (*location, "<<"), "got no mapping to merge", "an alias of another mapping")
                    continue
                yield from (pair for pair in source.value if pair[0].tag != f"{TAG}merge")
                yield from self._merged(source, location)

    def _key(self, node: Node, location: Location) -> str | None:
        """The key as it is written: `on`, `1` and `2024-01-01` are text here."""
        if isinstance(node, ScalarNode) and node.value and node.tag.startswith(TAG):
            return str(node.value)
        found = shown(node.value) if isinstance(node, ScalarNode) else "a list or mapping"
        self._fault(node, location, f"got {found} as a key", "a key is text")
        return None

    def _scalar(self, node: ScalarNode, location: Location) -> Any:
        kind, text = node.tag.removeprefix(TAG), node.value
        plain = not node.style
        if kind in ("str", "timestamp", "value", "merge"):
            return float(text) if plain and EXPONENT.fullmatch(text) and math.isfinite(float(text)) else text
        if kind == "null":
            return None
        try:
            if kind == "bool":
                return self._constructor.construct_yaml_bool(node)
            if kind in ("int", "float"):
                return self._number(node, kind, location)
        except (ValueError, KeyError, IndexError, OverflowError):
            pass
        else:
            self._fault(node, location, f"got the tag {_tag(node)}", "no tag")
            return None
        self._fault(node, location, f"got {shown(text)}", f"{MEANING[kind]}, or quotes round a text")
        return None

    def _number(self, node: ScalarNode, kind: str, location: Location) -> int | float | None:
        number = (
            self._constructor.construct_yaml_int(node)
            if kind == "int"
            else self._constructor.construct_yaml_float(node)
        )
        if isinstance(number, float) and not math.isfinite(number):
            self._fault(node, location, f"got {node.value}", "a finite number")
            return None
        if isinstance(number, int) and not -(2**63) <= number < 2**63:
            self._fault(node, location, f"got {shown(node.value)}", "a whole number of at most 64 bits")
            return None
        if OCTAL_OR_BASE_60.fullmatch(node.value):
            what = f"got {node.value}, which YAML 1.1 reads as {number}"
            place, where = place_of(node), path_text(location)
            self.notes.append(
                Fault(Place(self._file, *place, where), what, f"write {number}, or quotes for a text", "warning")
            )
        return number

    def _fault(self, node: Node, location: Location, what: str, right: str) -> None:
        self.faults.append(Fault(Place(self._file, *place_of(node), path_text(location)), what, right))


def _tag(node: Node) -> str:
    return str(node.tag).replace(TAG, "!!")


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
    """The faults behind `error`, which `model` raised on what stands at `base`.

    An error's location may lead through elements that are no part of the file (pydantic adds the branches of a
    union); of a union's errors the deepest are kept, and those of one place become one fault.
    """
    located = [(document.known((*base, *detail["loc"])), detail) for detail in error.errors(include_url=False)]
    merged: dict[tuple[Location, str], Fault] = {}
    for found, detail in located:
        if _is_branch(found, base, detail) and any(
            len(other) > len(found) and other[: len(found)] == found for other, _ in located
        ):
            continue
        fault = _fault(document, base, found, model, detail)
        key = (found, fault.problem)
        if key in merged and _is_branch(found, base, detail):
            fault = _either(merged[key], fault)
        elif key in merged:
            key = (found, f"{fault.problem}; {fault.expected}")
        merged[key] = fault
    return list(merged.values())


def _is_branch(found: Location, base: Location, detail: ErrorDetails) -> bool:
    return detail["type"] not in ("missing", "extra_forbidden") and len(found) < len(base) + len(detail["loc"])


def _either(first: Fault, second: Fault) -> Fault:
    if second.expected in first.expected.split(" or "):
        return first
    return replace(first, expected=f"{first.expected} or {second.expected}")


def _fault(document: Document, base: Location, found: Location, model: type[BaseModel], detail: ErrorDetails) -> Fault:
    kind, context = detail["type"], detail.get("ctx", {})
    if kind == "extra_forbidden":
        known = _model_at(model, detail["loc"][:-1]).model_fields
        return _at_key(document, found, found[:-1], f"unknown key {found[-1]!r}", did_you_mean(str(found[-1]), known))
    if kind == "missing":
        name = str(detail["loc"][-1])
        field = _model_at(model, detail["loc"][:-1]).model_fields.get(name)
        about = (field.description or "").split(";")[0].split(". ")[0].rstrip(".") if field else ""
        right = f"{name}: {' '.join(about.split())[:1].lower()}{' '.join(about.split())[1:] or '...'}"
        return _at_key(document, found, found, f"no {name!r}", right)
    if kind == "second_key":
        location = (*found, str(context["key"]))
        return _at_key(document, location, location, *_parted(detail))
    if "at" in context:
        found = document.known((*found, str(context["at"])))
    if kind in EXPECTED:
        right = EXPECTED[kind].format(**context)
        if kind == "literal_error" and isinstance(detail["input"], str):
            right = _nearest(detail["input"], right)
        if kind == "string_type" and isinstance(detail["input"], int | float):
            right = "text in quotes"
        return document.fault(found, f"got {shown(detail['input'])}", right)
    # A mapping begins below the key that names it, and the fault is one of the whole.
    whole_mapping = "at" not in context and isinstance(detail["input"], Mapping)
    fault = document.fault(found, *_parted(detail), at="key" if whole_mapping else "value")
    return replace(fault, kind="missing") if kind == MISSING_FILE else fault


def _at_key(document: Document, place: Location, where: Location, what: str, right: str) -> Fault:
    return Fault(Place(document.file, *document.place(place, "key"), path_text(where)), what, right)


def _parted(detail: ErrorDetails) -> tuple[str, str]:
    """Split a validator's own message into the problem and what would be right."""
    got = f"got {shown(detail['input'])}"
    error = detail.get("ctx", {}).get("error")
    message = " ".join(str(error if isinstance(error, Exception) else detail["msg"]).split())
    problem, expected = parted(message)
    return (
        (problem, expected)
        if expected or problem.startswith("expected ") or ": expected " in problem
        else (got, problem)
    )


def _nearest(found: str, expected: str) -> str:
    names = [part.strip("' ") for part in expected.replace(" or ", ", ").split(",")]
    hint = did_you_mean(found, names)
    return hint if hint.startswith("did") else expected


def _model_at(model: type[BaseModel], location: tuple[int | str, ...]) -> type[BaseModel]:
    """The model of what stands at `location`, through lists, unions and mappings."""
    for part in location:
        field = model.model_fields.get(str(part))
        inner = next(_models_in(field.annotation), None) if field else None
        model = inner or model
    return model


def _models_in(annotation: Any) -> Iterator[type[BaseModel]]:
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        yield annotation
    for argument in get_args(annotation):
        yield from _models_in(argument)
