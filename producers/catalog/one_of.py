"""The producer that offers alternatives: the union of what other producers yield."""

from collections.abc import Iterator, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Annotated, Any, Final, TypeAlias, get_args

from pydantic import Field, PlainSerializer, PlainValidator, ValidationError, ValidationInfo, WithJsonSchema
from pydantic_core import ErrorDetails, InitErrorDetails, PydanticCustomError
from pydantic_core.core_schema import ErrorType

from vastflow.producers.model import producer
from vastflow.producers.model.configuration import Fragment, Rejection
from vastflow.producers.model.producer import Draws, Producer, evaluate, find_producer
from vastflow.sim.model.digest import Value
from vastflow.sim.model.faults import Fault, Invalid
from vastflow.sim.model.names import did_you_mean
from vastflow.sim.model.scenario import Dimension
from vastflow.sim.plug_ins.neighbors import PlugInError

PYDANTICS_OWN: Final = frozenset(get_args(ErrorType))
PRECEDENCE: Final[tuple[Dimension | None, ...]] = ("environment", "task", None, "system")
"""Precedence of the dimensions that children give one key: a list without obstacles belongs to the environment if another
has some."""


def _child(value: Any, info: ValidationInfo) -> Producer[Any]:
    if isinstance(value, Producer):
        return value
    if not isinstance(value, Mapping) or len(value) != 1:
        raise ValueError(f"expected one 'Producer: {{parameters}}', got {value!r}")
    ((name, given),) = value.items()
    try:
        kind = find_producer(name, Path((info.context or {}).get("base", ".")))
    except PlugInError as error:
        raise PydanticCustomError("child", "{error}", {"error": error, "at": name}) from error
    try:
        return kind(kind.Parameters.model_validate({} if given is None else given, context=info.context))
    except ValidationError as error:
        details = [_below(name, kind, detail) for detail in error.errors()]
        raise ValidationError.from_exception_data(kind.__name__, details) from None


def _below(name: str, kind: type[Producer[Any]], detail: ErrorDetails) -> InitErrorDetails:
    """Return a child's error at its place below the child's name; errors about keys become text."""
    key = str(detail["loc"][-1]) if detail["loc"] else ""
    context = detail.get("ctx", {})
    what: str | PydanticCustomError = detail["type"]
    if detail["type"] == "extra_forbidden" and len(detail["loc"]) == 1:
        unknown = Invalid(f"unknown key {key!r}", did_you_mean(key, kind.Parameters.model_fields))
        what = PydanticCustomError("child", "{error}", {"error": unknown})
    elif detail["type"] == "missing":
        what = PydanticCustomError("child", "{error}", {"error": Invalid(f"{key!r} is missing", "it has no default")})
    elif detail["type"] not in PYDANTICS_OWN:
        what = PydanticCustomError(detail["type"], "{said}", {**context, "said": detail["msg"]})
    return InitErrorDetails(type=what, loc=(name, *detail["loc"]), input=detail["input"], ctx=context)


Child: TypeAlias = Annotated[
    Producer[Any],
    PlainValidator(_child),
    PlainSerializer(lambda child: {type(child).__name__: child.parameters.model_dump(mode="json")}, return_type=Any),
    WithJsonSchema({"type": "object", "minProperties": 1, "maxProperties": 1}),
]


class OneOfParameters(producer.Parameters):
    """Parameters of `OneOfVariation`."""

    variations: list[Child] = Field(min_length=1)
    """The alternatives, `- Producer: {parameters}`; a producer is a known name or `file.py:Class`."""


class OneOfVariation(Producer[OneOfParameters]):
    """Every configuration of each child, one child after the other: a union, not a product.

    A child sees what it reads and draws from its own seed, so it yields what it would yield alone.
    """

    Parameters = OneOfParameters

    @property
    def children(self) -> tuple[Producer[Any], ...]:
        """The alternatives in order."""
        return tuple(self.parameters.variations)

    @property
    def reads(self) -> tuple[str, ...]:
        return tuple(dict.fromkeys(key for child in self.children for key in child.reads))

    @property
    def needs(self) -> tuple[str, ...]:
        return tuple(dict.fromkeys(key for child in self.children for key in child.needs))

    @property
    def writes(self) -> Mapping[str, Dimension | None]:
        """The keys that any child writes; of different dimensions for a key, the first of `PRECEDENCE`."""
        tags: dict[str, Dimension | None] = {}
        for child in self.children:
            for key, tag in child.writes.items():
                tags[key] = min(tags.get(key, tag), tag, key=PRECEDENCE.index)
        return {key: self.parameters.dimension or tag for key, tag in tags.items()}

    @property
    def notes(self) -> tuple[Fault, ...]:
        return tuple(dict.fromkeys(note for child in self.children for note in child.notes))

    @property
    def most_choices(self) -> int | None:
        choices = [child.most_choices for child in self.children]
        return sum(n or 0 for n in choices) if None not in choices else None

    @property
    def remarks(self) -> tuple[str, ...]:
        return tuple(remark for child in self.children for remark in child.remarks)

    def produce(self, inputs: Mapping[str, Value], draws: Draws) -> Iterator[Fragment | Rejection]:
        """Yield the children's instances and rejections; the latter name the child. Draws no random numbers."""
        for child in self.children:
            for item in evaluate(child, {key: inputs[key] for key in child.reads if key in inputs}):
                if isinstance(item, Rejection):
                    item = replace(item, reason=f"{type(child).__name__}: {item.reason}")
                yield item
