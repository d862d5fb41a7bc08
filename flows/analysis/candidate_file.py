"""A candidate as a campaign file: one family of fixed values."""

import os
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, Final

import yaml

from vastflow.flows.analysis.failing import Failing
from vastflow.flows.request.campaign_file import read_campaign
from vastflow.flows.results.inputs import Inputs, copy_permitted, inputs_of
from vastflow.oracles.judgment.oracle import Oracle
from vastflow.producers.campaign import Campaign
from vastflow.producers.campaign_file.scenario import abstract_scenario_of
from vastflow.producers.campaign_file.scenario_values import dimension_of
from vastflow.producers.instantiation.instantiate import instantiate
from vastflow.producers.minimization.minimize import Candidate, Candidates, NotBuilt
from vastflow.producers.model.configuration import Configuration
from vastflow.producers.places.start_check import StartCheck
from vastflow.sim.model.digest import FileContent
from vastflow.sim.model.faults import FileError, message_of
from vastflow.sim.model.files import copy_file, files_below
from vastflow.sim.system.keys import FILE_KEY, MASK_KEYS
from vastflow.sim.world.environment import MAP_KEY, WORLD_KEY
from vastflow.sim.world.readers.registry import files_of_world

FAMILY: Final = "minimal"
FILE: Final = "minimal.vast"
_MAPS: Final[Mapping[str, str]] = {MAP_KEY: "map", **{key: key for key in (WORLD_KEY, *MASK_KEYS)}}
"""Keys of maps and worlds to their folders beside the campaign file."""
_OTHERS: Final = ("local", FILE_KEY)
"""Keys of `execution` that are among the values."""


@dataclass(frozen=True)
class BuiltCandidate:
    """A candidate, read from its campaign file with this text."""

    campaign: Campaign = field(repr=False)
    oracles: tuple[Oracle[Any], ...] = field(repr=False)
    configuration: Configuration
    text: str = field(repr=False)

    def candidates(self, failing: Failing) -> Candidates:
        """Return the maker of scenarios of other candidates, for which this one is the whole."""
        abstract, _ = abstract_scenario_of(self.campaign.document, self.campaign.path.parent)
        assert abstract is not None  # or it could not have been read
        start_check = StartCheck(FAMILY, {}) if failing.start_check == "footprint" else None
        return Candidates(failing.subject, self.configuration.scenario, abstract, start_check)

    @property
    def inputs(self) -> Inputs:
        """The files that the campaign file needs."""
        return inputs_of(self.campaign, self.oracles)


@dataclass(frozen=True)
class CandidateFiles:
    """A folder for campaign files, with the files of the campaign directory."""

    failing: Failing
    folder: Path

    def built(self, candidate: Candidate, runs: int = 1, comment: str = "") -> BuiltCandidate:
        """Write a candidate's campaign file and read it as `vastflow run` does; raises NotBuilt where that fails."""
        try:
            values = self.failing.subject.reduced(candidate.kept, dict(candidate.levels))
        except ValueError as error:
            raise NotBuilt(str(error)) from None
        text = comment + self._text(values, runs)
        file = self.folder / FILE
        file.write_text(text, encoding="utf-8")
        try:
            campaign, oracles = read_campaign(file)
            made = instantiate(campaign)
        except FileError as error:
            raise NotBuilt(message_of(error.faults[0].problem, error.faults[0].expected)) from None
        if not made.configurations:
            raise NotBuilt(made.rejections[0].reason if made.rejections else "it has no configuration")
        return BuiltCandidate(campaign, oracles, made.configurations[0], text)

    def _text(self, values: dict[str, Any], runs: int) -> str:
        failing, subject = self.failing, self.failing.subject
        execution = dict(placed(failing.campaign.get("execution") or {}, failing.places))
        execution = {key: value for key, value in execution.items() if key not in _OTHERS} | {"runs": runs}
        if FILE_KEY in values:
            execution[FILE_KEY] = placed(failing.campaign["execution"][FILE_KEY], failing.places)
            del values[FILE_KEY]
        for key, content in _maps_of(values).items():
            values[key] = _place(failing.directory, key, content).as_posix()
        tags = {key: subject.dimensions[key] for key in values}
        family: dict[str, Any] = {
            "name": FAMILY,
            "parameters": [{key: _plain(value, failing.directory)} for key, value in values.items()],
            "dimensions": {key: tag for key, tag in tags.items() if dimension_of(key, values[key], None) != tag},
            "start_check": failing.start_check,
        }
        name = (failing.campaign.get("metadata") or {}).get("name") or failing.directory.name
        data: dict[str, Any] = {
            "version": 1,
            "metadata": {"name": f"{name}-{failing.name}-minimal"},
            "configuration": [{key: value for key, value in family.items() if value}],
            "execution": execution,
        }
        if oracles := (failing.campaign.get("evaluation") or {}).get("oracles"):
            data["evaluation"] = {"oracles": placed(oracles, failing.places)}
        return yaml.safe_dump(data, sort_keys=False, allow_unicode=True, width=120)


@contextmanager
def candidate_files(failing: Failing) -> Iterator[CandidateFiles]:
    """Yield a temporary folder for candidates."""
    with TemporaryDirectory(prefix="vastflow-") as place:
        folder = Path(place).resolve()
        for file in files_below(inputs := failing.directory / "inputs"):
            copy_permitted(file, folder / file.relative_to(inputs))
        for key, content in _maps_of(failing.subject.values).items():
            beside = folder / _place(failing.directory, key, content).parent
            for file in files_of_world(Path(content.path)) if beside == folder / _MAPS[key] else ():
                copy_file(file, beside / file.name)
        yield CandidateFiles(failing, folder)


def placed(value: Any, places: Mapping[str, str]) -> Any:
    """Return a value of the campaign file with the kept paths of files from outside of its folder."""
    if isinstance(value, dict):
        return {placed(key, places): placed(item, places) for key, item in value.items()}
    if isinstance(value, list):
        return [placed(item, places) for item in value]
    if not isinstance(value, str):
        return value
    file, separator, kind = value.partition(".py:")
    path = os.path.normpath(f"{file}.py" if separator else file)
    return value if path not in places else f"{places[path]}:{kind}" if separator else places[path]


def _maps_of(values: Mapping[str, Any]) -> dict[str, FileContent]:
    return {key: values[key] for key in _MAPS if isinstance(values.get(key), FileContent)}


def _place(directory: Path, key: str, content: FileContent) -> Path:
    """Return the place of a map or world beside the campaign file.

    A world keeps its place among the inputs, where what it includes lies too.
    """
    path, inputs = Path(content.path), directory / "inputs"
    beside = key == WORLD_KEY and path.is_relative_to(inputs)
    return path.relative_to(inputs) if beside else Path(_MAPS[key], path.name)


def _plain(value: Any, directory: Path) -> Any:
    match value:
        case [FileContent() as file, str() as name]:  # a plug-in
            return f"{Path(file.path).relative_to(directory / 'inputs').as_posix()}:{name}"
    if isinstance(value, Mapping):
        return {key: _plain(item, directory) for key, item in value.items()}
    return [_plain(item, directory) for item in value] if isinstance(value, list | tuple) else value
