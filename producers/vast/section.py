"""What the sections of a campaign file are made of."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Annotated, Any, TypeAlias

from pydantic import BaseModel, BeforeValidator, ConfigDict, GetJsonSchemaHandler, PlainValidator, WithJsonSchema
from pydantic.json_schema import JsonSchemaValue
from pydantic_core import CoreSchema, PydanticCustomError

from vastflow.producers.faults import NOT_EXECUTED, shown


class Section(BaseModel):
    """A mapping of the campaign file with known keys; the text below a field is its description for editors."""

    model_config = ConfigDict(extra="forbid", frozen=True, use_attribute_docstrings=True)


@dataclass(frozen=True, slots=True)
class Unexecuted:
    """Marks a field that the format has and this version does nothing with.

    Attributes:
        consequence: What that means for the user, such as what is done in its place; may be empty.
    """

    consequence: str = ""

    def __get_pydantic_json_schema__(self, schema: CoreSchema, handler: GetJsonSchemaHandler) -> JsonSchemaValue:
        return {**handler(schema), "$comment": NOT_EXECUTED}


def _or_empty_list(value: Any) -> Any:
    return [] if value is None else value


def _or_empty_map(value: Any) -> Any:
    return {} if value is None else value


EmptyIsList = BeforeValidator(_or_empty_list)
"""`variations:` with nothing below it is an empty list, as in YAML editors half-way through a file."""
EmptyIsMap = BeforeValidator(_or_empty_map)


def _single_key(value: Any) -> dict[str, Any]:
    if not isinstance(value, Mapping) or not value:
        raise PydanticCustomError("entry", "found {found}; 'name: value'", {"found": shown(value)})
    if len(value) > 1:
        first, second, *_ = value
        raise PydanticCustomError(
            "second_key",
            "a second key in an entry of one; indent it below {first}, or begin its own entry with '- '",
            {"key": second, "first": repr(first)},
        )
    return dict(value)


def _named(value: Any) -> dict[str, dict[str, Any]]:
    if isinstance(value, str):
        return {value: {}}
    ((name, parameters),) = _single_key(value).items()
    if parameters is not None and not isinstance(parameters, Mapping):
        raise PydanticCustomError(
            "parameters", "found {found}; its parameters as a mapping", {"found": shown(parameters), "at": name}
        )
    return {name: dict(parameters or {})}


_SINGLE_KEY_SCHEMA = {"type": "object", "minProperties": 1, "maxProperties": 1}

SingleKeys: TypeAlias = Annotated[
    list[Annotated[dict[str, Any], PlainValidator(_single_key), WithJsonSchema(_SINGLE_KEY_SCHEMA)]], EmptyIsList
]
"""A list of `- name: value`."""
NamedSteps: TypeAlias = Annotated[
    list[
        Annotated[
            dict[str, dict[str, Any]],
            PlainValidator(_named),
            WithJsonSchema({"anyOf": [{"type": "string"}, _SINGLE_KEY_SCHEMA]}),
        ]
    ],
    EmptyIsList,
]
"""A list of `- name` or `- name: {parameters}`; always `{name: parameters}` once read."""
FreeForm: TypeAlias = Annotated[dict[str, Any], EmptyIsMap]
"""Any mapping."""
