"""Abstract scenarios: OpenSCENARIO files by name or by content."""

import functools
from collections.abc import Mapping
from dataclasses import fields, is_dataclass, replace
from importlib.util import find_spec
from pathlib import Path
from typing import Any, Final, TypeAlias

from pydantic import BaseModel

from vastflow.sim.model.digest import FileContent, Value, digest
from vastflow.sim.model.faults import Place, ScenarioError
from vastflow.sim.scenario.definition import ScenarioDefinition
from vastflow.sim.scenario.language.reading import read_scenarios


def plain_value(part: Any) -> Value:
    """Return a value with its dataclasses and pydantic models as mappings of class name and fields.

    A property is left out: what computes it must be code that a run depends on, not code that reads.
    """
    if isinstance(part, FileContent):
        return part
    if isinstance(part, Place):  # without `where`: stored digests of definitions know none
        return {"": "Place", "file": part.file, "line": part.line, "column": part.column}
    if isinstance(part, Mapping):
        return {key: plain_value(value) for key, value in part.items()}
    if isinstance(part, tuple | list):
        return [plain_value(item) for item in part]
    if isinstance(part, set | frozenset):
        return sorted(part)
    is_data = is_dataclass(part) and not isinstance(part, type)
    if not is_data and not isinstance(part, BaseModel):
        value: Value = part
        return value
    names = [field.name for field in fields(part)] if is_data else type(part).model_fields
    return {"": type(part).__name__, **{name: plain_value(getattr(part, name)) for name in names}}


BUILTIN: Final = "builtin:"
SHIPPED: Final = ("navigate_to_pose", "navigate_through_poses", "follow_waypoints", "obstacle_appears")
"""Names that follow `builtin:`; each is a file of `campaigns/scenarios`."""

CACHED_DEFINITIONS: Final = 32

Abstract: TypeAlias = str | FileContent
"""`builtin:` and a name, or a scenario file whose digest is that of what it defines, see `abstract_content`."""


def shipped_file(name: str) -> Path:
    """A file that is shipped with vastflow's scenarios."""
    spec = find_spec("vastflow.campaigns.scenarios")  # a folder of data: of an editable install `files` finds none
    places = [Path(place) / name for place in (spec.submodule_search_locations or () if spec else ())]
    return next(place for place in places if place.is_file())


def hall_file() -> Path:
    """The map for scenarios that launch a simulation with a map of its own."""
    return shipped_file("hall.yaml")


def abstract_content(file: Path) -> FileContent:
    """Return a scenario file as a value: its definition with line numbers, independent of its folder.

    Raises:
        FileError: what is wrong in the file, or in one that it imports.
        ScenarioError: not one scenario.
    """
    return FileContent(str(file), definition_digest(_read(file)))


def definition_of(abstract: Abstract) -> ScenarioDefinition:
    """Return the definition of an abstract scenario, read once for many scenarios.

    Raises:
        ScenarioError: no such name, or a file that changed since its content was taken.
        FileError: a file that is wrong.
    """
    return _defined(abstract, abstract.path if isinstance(abstract, FileContent) else "")


@functools.lru_cache(maxsize=CACHED_DEFINITIONS)
def _defined(abstract: Abstract, path: str) -> ScenarioDefinition:
    if isinstance(abstract, FileContent):
        definition = _read(Path(path))
        if definition_digest(definition) != abstract.digest:
            raise ScenarioError(f"{path} changed since the campaign was read. Run the campaign again.")
        return definition
    if abstract not in (known := [BUILTIN + each for each in SHIPPED]):
        raise ScenarioError(f"expected one of {', '.join(known)}, got {abstract!r}")
    return _read(shipped_file(f"{abstract.removeprefix(BUILTIN)}.osc"))


def _read(file: Path) -> ScenarioDefinition:
    """Return the scenario that no other of the file inherits from; its places have file names, not paths."""
    scenarios = read_scenarios(file)
    bases = {base for scenario in scenarios for base in scenario.bases}
    last = [scenario for scenario in scenarios if scenario.name not in bases]
    if len(last) != 1:
        names = ", ".join(scenario.name for scenario in last)
        raise ScenarioError(f"{file}: expected one scenario to run, got {names}")
    definition: ScenarioDefinition = _by_name(last[0])
    return definition


@functools.lru_cache(maxsize=CACHED_DEFINITIONS)
def content_digest(abstract: Abstract) -> str:
    """Return the digest of an abstract scenario's definition.

    Raises:
        ScenarioError, FileError: see `definition_of`.
    """
    return abstract.digest if isinstance(abstract, FileContent) else definition_digest(definition_of(abstract))


def definition_digest(definition: ScenarioDefinition) -> str:
    return digest(plain_value(definition))


def _by_name(part: Any) -> Any:
    if isinstance(part, Place):
        return replace(part, file=Path(part.file).name)
    if is_dataclass(part) and not isinstance(part, type):
        return replace(part, **{f.name: _by_name(getattr(part, f.name)) for f in fields(part)})
    if isinstance(part, Mapping):
        return {key: _by_name(value) for key, value in part.items()}
    return tuple(_by_name(item) for item in part) if isinstance(part, tuple) else part
