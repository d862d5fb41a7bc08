"""Pydantic's errors as faults of the file: where it stands, what was found, what would be right."""

from collections.abc import Iterator, Mapping
from dataclasses import replace
from typing import Any, Final, get_args

from pydantic import BaseModel, ValidationError
from pydantic_core import ErrorDetails

from vastflow.producers.faults import MISSING_FILE, Fault, Location, path_text, shown
from vastflow.producers.vast.document import Document
from vastflow.sim.model.names import did_you_mean

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
    "greater_than": "greater than {gt:g}",
    "greater_than_equal": "{ge:g} or more",
    "less_than": "less than {lt:g}",
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
        key = (found, fault.what)
        if key in merged and _is_branch(found, base, detail):
            fault = _either(merged[key], fault)
        elif key in merged:
            key = (found, f"{fault.what}; {fault.right}")
        merged[key] = fault
    return list(merged.values())


def _is_branch(found: Location, base: Location, detail: ErrorDetails) -> bool:
    return detail["type"] not in ("missing", "extra_forbidden") and len(found) < len(base) + len(detail["loc"])


def _either(first: Fault, second: Fault) -> Fault:
    if second.right in first.right.split(" or "):
        return first
    right = f"{first.right} or {second.right}"
    return Fault(first.file, first.line, first.column, first.where, first.what, right)


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
            right = "text; put it in quotes"
        return document.fault(found, f"found {shown(detail['input'])}", right)
    # A mapping begins below the key that names it, and the fault is one of the whole.
    whole_mapping = "at" not in context and isinstance(detail["input"], Mapping)
    fault = document.fault(found, *_parted(detail), at="key" if whole_mapping else "value")
    return replace(fault, missing=kind == MISSING_FILE)


def _at_key(document: Document, place: Location, where: Location, what: str, right: str) -> Fault:
    return Fault(document.file, *document.place(place, "key"), path_text(where), what, right)


def _parted(detail: ErrorDetails) -> tuple[str, str]:
    """What and right of a validator's own message, which separates the two by a semicolon."""
    error = detail.get("ctx", {}).get("error")
    message = " ".join(str(error if isinstance(error, Exception) else detail["msg"]).split())
    what, semicolon, right = message.partition("; ")
    return (what, right) if semicolon else (f"found {shown(detail['input'])}", message)


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
