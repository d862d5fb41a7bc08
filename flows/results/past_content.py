"""What a past must hold: the values of its `metadata.json` and of its rows that today's campaign is compared with."""

from collections.abc import Mapping, Sequence
from typing import Annotated, Any, Final, NotRequired, get_args

from pydantic import AfterValidator, ConfigDict, Field, Json, TypeAdapter, ValidationError, with_config
from pydantic_core import PydanticCustomError
from typing_extensions import TypedDict

from vastflow.flows.results.ingredients import Stage

_EXACT: Final = ConfigDict(strict=True)


class _Source(TypedDict):
    files: dict[str, str]
    libraries: dict[str, str]


class _PlugIn(TypedDict):
    name: str
    parameters: Any
    source: str


class _Asked(TypedDict):
    file: str
    runs: int
    only: list[str]
    places: dict[str, str]
    sample: NotRequired[int | None]
    map_dir: NotRequired[str | None]
    as_v1: NotRequired[bool]


class _Counts(TypedDict):
    runs: int
    configurations: Annotated[int, Field(gt=0)]


@with_config(_EXACT)
class _Metadata(TypedDict):
    name: str
    created: str
    asked: _Asked
    numeric_class: str
    seed: int
    oracles: list[_PlugIn]
    producers: dict[str, list[_PlugIn]]
    code: dict[str, _Source]


@with_config(_EXACT)
class _WithoutIngredients(TypedDict):
    name: str
    created: str
    asked: _Asked
    code: NotRequired[dict[str, Any]]


@with_config(_EXACT)
class _WithoutWhatWasAsked(TypedDict):
    name: str
    created: str
    counts: _Counts
    code: NotRequired[dict[str, Any]]


class _Parts(TypedDict):
    environment: dict[str, Any]
    task: dict[str, Any]
    system: dict[str, Any]
    programs: NotRequired[dict[str, Any] | None]


class _Step(TypedDict):
    producer: str
    keys: list[str]


@with_config(_EXACT)
class _Configuration(TypedDict):
    name: str
    family: str
    scenario_digest: str
    checked_digest: NotRequired[str | None]
    duplicate_of: str | None
    abstract: str
    timeout_s: float
    scenario: Json[_Parts]
    provenance: Json[dict[str, Any]]
    steps: NotRequired[Json[list[_Step]] | None]


@with_config(_EXACT)
class _Run(TypedDict):
    configuration: str
    run_index: Annotated[int, Field(ge=0)]


def _with_sources(found: _Metadata) -> _Metadata:
    """Each stage and plug-in finds its source in `code`."""
    plug_ins = [*found["oracles"], *(each for family in found["producers"].values() for each in family)]
    if lacking := {*get_args(Stage), *(each["source"] for each in plug_ins)} - found["code"].keys():
        raise PydanticCustomError("no_source", f"code: has no {min(lacking)}")
    return found


_METADATA: Final[TypeAdapter[Any]] = TypeAdapter(Annotated[_Metadata, AfterValidator(_with_sources)])
_EARLIER: Final[TypeAdapter[Any]] = TypeAdapter(_WithoutIngredients)
_EARLIEST: Final[TypeAdapter[Any]] = TypeAdapter(_WithoutWhatWasAsked)
_CONFIGURATIONS: Final[TypeAdapter[Any]] = TypeAdapter(list[_Configuration])
_RUNS: Final[TypeAdapter[Any]] = TypeAdapter(list[_Run])


class OtherContent(ValueError):
    """A value that no version wrote there; says where it stands."""


def check_metadata(metadata: Any) -> None:
    """Raises `OtherContent` where a value of `metadata.json` is of another kind than any version wrote."""
    found = metadata if isinstance(metadata, Mapping) else {}
    code = found.get("code")
    with_ingredients = isinstance(code, Mapping) and "execute" in code
    _check(_METADATA if with_ingredients else _EARLIER if "asked" in found else _EARLIEST, metadata, "metadata.json")


def check_configurations(rows: Sequence[Mapping[str, Any]], file: str) -> None:
    """Raises `OtherContent` where a row is none of `configurations.parquet`, or a JSON text in it is another."""
    _check(_CONFIGURATIONS, rows, file)


def check_runs(rows: Sequence[Mapping[str, Any]], file: str) -> None:
    """Raises `OtherContent` where a row names no run."""
    _check(_RUNS, rows, file)


def _check(kind: TypeAdapter[Any], found: Any, file: str) -> None:
    try:
        kind.validate_python(found)
    except ValidationError as error:
        first = error.errors(include_url=False, include_context=False, include_input=False)[0]
        place = ".".join(map(str, first["loc"]))
        raise OtherContent(f"{file}: {f'{place}: ' if place else ''}{first['msg']}") from None
