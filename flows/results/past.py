"""The past: the validated parts of an earlier campaign directory that show what has changed."""

import json
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Annotated, Any, Final, NotRequired, get_args

from pydantic import AfterValidator, ConfigDict, Field, Json, TypeAdapter, ValidationError, with_config
from pydantic_core import PydanticCustomError
from typing_extensions import TypedDict

from vastflow.flows.request.run_request import asked_of
from vastflow.flows.results.provenance import Stage
from vastflow.oracles.results.schema import table_rows
from vastflow.oracles.results.unusable import UnusableDirectory, reading
from vastflow.sim.model.files import read_json

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
    sample: int | None


class _StageSources(TypedDict):
    execute: str
    observe: str
    judge: str
    oracles: NotRequired[dict[str, str]]


@with_config(_EXACT)
class _Metadata(TypedDict):
    name: str
    created: str
    asked: _Asked
    numeric_class: str
    seed: int
    source: _StageSources
    oracles: list[_PlugIn]
    producers: dict[str, list[_PlugIn]]
    code: dict[str, _Source]


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
    checked_digest: str
    duplicate_of: str | None
    abstract: str
    timeout_s: float
    scenario: Json[_Parts]
    provenance: Json[dict[str, Any]]
    steps: Json[list[_Step]]


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
_CONFIGURATIONS: Final[TypeAdapter[Any]] = TypeAdapter(list[_Configuration])
_RUNS: Final[TypeAdapter[Any]] = TypeAdapter(list[_Run])


def _check(kind: TypeAdapter[Any], found: Any, file: str) -> None:
    """Raise `ValueError` with the place of a value that is of another kind than vastflow writes."""
    try:
        kind.validate_python(found)
    except ValidationError as error:
        first = error.errors(include_url=False, include_context=False, include_input=False)[0]
        place = ".".join(map(str, first["loc"]))
        raise ValueError(f"{file}: {f'{place}: ' if place else ''}{first['msg']}") from None


PARTS = ("environment", "task", "system")


@dataclass(frozen=True)
class Past:
    """A campaign directory with its `metadata.json`."""

    directory: Path
    metadata: Mapping[str, Any] = field(repr=False)

    @cached_property
    def rows(self) -> list[dict[str, Any]]:
        """Rows of `configurations.parquet`, JSON columns as text."""
        rows = table_rows(self.directory / "configurations.parquet")
        _check(_CONFIGURATIONS, rows, "configurations.parquet")
        return rows

    @cached_property
    def by_name(self) -> Mapping[str, dict[str, Any]]:
        """Configuration to its row."""
        return {row["name"]: row for row in self.rows}

    @cached_property
    def by_digest(self) -> Mapping[str, dict[str, Any]]:
        """Digest of a scenario as it is written to the row of the configuration that was run."""
        return {row["scenario_digest"]: row for row in self.rows if row["duplicate_of"] is None}

    @cached_property
    def by_key(self) -> Mapping[str, dict[str, Any]]:
        """The digest that stands for a scenario in keys to the row of the configuration that was run."""
        return {row["checked_digest"]: row for row in self.rows if row["duplicate_of"] is None}

    @cached_property
    def recorded(self) -> frozenset[tuple[str, int]]:
        """Configuration and index of every run that was recorded."""
        return frozenset((row["configuration"], row["run_index"]) for row in self._runs("runs.parquet"))

    @property
    def runs(self) -> int:
        """See `Asked.runs`."""
        return asked_of(self.metadata).runs

    def runs_of(self, name: str) -> int:
        """Runs that were wanted of a configuration that is no duplicate."""
        return self.wanted.get(name, 0) if asked_of(self.metadata).sequential else self.runs

    @cached_property
    def wanted(self) -> Mapping[str, int]:
        """Configuration to the runs that were wanted of it, where they ended by a rule."""
        wanted: dict[str, int] = {}
        for row in self._runs("verdicts.parquet"):
            wanted[row["configuration"]] = max(wanted.get(row["configuration"], 0), row["run_index"] + 1)
        return wanted

    def _runs(self, file: str) -> list[dict[str, Any]]:
        rows = table_rows(self.directory / file, "configuration", "run_index")
        _check(_RUNS, rows, file)
        return rows


def past_of(directory: Path) -> Past:
    """Read and check a campaign directory, or raise `UnusableDirectory`."""
    with reading(directory):
        past = Past(directory, read_json(directory / "metadata.json"))
        _check(_METADATA, past.metadata, "metadata.json")
        # Read all that is asked later, so that nothing else can be damaged then.
        _ = past.rows, past.recorded, past.wanted if asked_of(past.metadata).sequential else None
    return past


def newest_past(results: Path, name: str) -> Past | None:
    """The newest campaign of this name in a folder of campaign directories; damaged ones are passed over."""
    found = []
    for file in results.glob("[!.]*/metadata.json"):
        with suppress(OSError, ValueError, KeyError, TypeError):
            metadata = read_json(file)
            if metadata["name"] == name:
                found.append((str(metadata["created"]), file.stat().st_mtime_ns, file.parent))
    for _, _, directory in sorted(found, reverse=True):
        with suppress(UnusableDirectory):
            return past_of(directory)
    return None


def written_scenario(row: Mapping[str, Any]) -> dict[str, Any]:
    """Return the decoded dimensions and programs of a row's configuration."""
    said = {"abstract scenario": row["abstract"], "execution.timeout": row["timeout_s"]}
    return {**said, **json.loads(row["scenario"])}


def values_of(row: Mapping[str, Any]) -> dict[str, Any]:
    """Return everything recorded of a configuration, provenance included: key to plain value."""
    parts = written_scenario(row)
    return {**{key: value for part in PARTS for key, value in parts[part].items()}, **json.loads(row["provenance"])}


def writers(row: Mapping[str, Any]) -> dict[str, str]:
    """Map each key to the producer that wrote it last; fixed parameters are left out."""
    return {key: step["producer"] for step in json.loads(row["steps"]) for key in step["keys"]}
