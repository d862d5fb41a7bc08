"""Executed scenarios of a campaign directory with their files, recordings, and the names of their maps."""

import json
import re
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping
from contextlib import suppress
from dataclasses import replace
from functools import cached_property
from pathlib import Path
from typing import Any, Final

from vastflow.oracles.judgment.notebook import RunTables, run_tables
from vastflow.oracles.observation.situation import situation_of
from vastflow.oracles.observation.trace import trace_of
from vastflow.oracles.results.schema import behaviors_of, rows_of, table_rows
from vastflow.oracles.results.unusable import UnusableDirectory
from vastflow.sim.model.blocks import read_block, read_recordings
from vastflow.sim.model.digest import FileContent, Value, file_digest
from vastflow.sim.model.faults import message_of
from vastflow.sim.model.files import files_below, read_json
from vastflow.sim.model.names import did_you_mean
from vastflow.sim.model.recording import Recording
from vastflow.sim.model.scenario import Scenario, setup_of
from vastflow.sim.plug_ins.neighbors import PlugInError
from vastflow.sim.plug_ins.snapshot import PlugInFile, snapshot_of
from vastflow.sim.reading.abstract import abstract_content
from vastflow.sim.system.system import system_kind
from vastflow.sim.world.occupancy import OccupancyMap
from vastflow.sim.world.world import world_at, world_content

NAMED_FILES: Final = "files.json"
"""File in `environments/` with the places of files by digests that are not of their bytes, such as meshes."""

_DIGEST: Final = re.compile("[0-9a-f]{64}")


class KeptFiles:
    """The files of a campaign directory by the digests that scenarios have of them.

    Args:
        plug_ins: Whether plug-ins below `inputs` are found too, to execute what they are part of; nothing is executed to find them.
    """

    def __init__(self, directory: Path, *, plug_ins: bool = False) -> None:
        self._plug_ins = plug_ins
        self._directory = directory
        self.inputs = directory / "inputs"
        self._environments = directory / "environments"
        self._known: dict[str, FileContent] = {}

    def path(self, digest: str) -> Path:
        """Path of the file with a digest; raises as `content` does."""
        return Path(self.content(digest).path)

    def content(self, digest: str) -> FileContent:
        """Return the file with a digest, with the plug-ins that it names below `inputs` alone.

        Raises:
            ValueError: there is none.
        """
        if digest not in self._known:
            map_file = self._environments / digest / "map.yaml"
            contents = self._contents(map_file) if map_file.is_file() else ()
            found = next((each for each in contents if each.digest == digest), None) or self._found.get(digest)
            if found is None:
                raise ValueError(f"no file has the digest {digest[:12]}… that the scenario names")
            self._known[digest] = found
        return self._known[digest]

    def plug_in(self, digest: str, name: str) -> Value:
        """Return a plug-in as `plug_in_value` does; a name of nothing where it is not asked for, or not kept."""
        for file in files_below(self.inputs) if self._plug_ins else ():
            with suppress(PlugInError):
                if (
                    file.suffix == ".py"
                    and (found := snapshot_of(file, self.inputs, within=self.inputs)).digest == digest
                ):
                    return [PlugInFile(str(file), digest, {f"{file}:{name}": found}), name]
        return f"{digest}.py:{name}"

    @cached_property
    def _found(self) -> Mapping[str, FileContent]:
        files = [file for folder in (self.inputs, self._environments) for file in files_below(folder)]
        named = self._environments / NAMED_FILES
        places = read_json(named) if named.is_file() else {}
        return {
            **{
                digest: FileContent(str(self._environments / place), digest)
                for digest, place in places.items()
                if self._environments / place in files
            },
            **{content.digest: content for file in files for content in self._contents(file)},
        }

    def _contents(self, file: Path) -> Iterator[FileContent]:
        """Yield a file as bytes, scenario file, map or world, and Nav2 parameters; no plug-in is executed."""
        yield FileContent(str(file), file_digest(file))
        if file.suffix == ".osc":
            with suppress(ValueError):
                yield abstract_content(file)
        with suppress(ValueError):
            yield world_content(file, self._directory)
        if file.suffix in (".yaml", ".yml"):
            with suppress(ValueError):
                yield system_kind().file_content(file, within=self.inputs)


def kept_map(directory: Path, environment: str) -> OccupancyMap:
    """Return the ground that a campaign directory keeps of an environment; WorldError if it lies elsewhere or can't be used."""
    return world_at(directory / "environments" / environment / "map.yaml", directory).ground


def configuration_row(directory: Path, configuration: str) -> Mapping[str, Any]:
    """Return a row of `configurations.parquet`; raises `UnusableDirectory` if there is none of this name."""
    file = directory / "configurations.parquet"
    found: list[Mapping[str, Any]] = rows_of(file, "name", configuration).to_pylist()
    if not found:
        names = [row["name"] for row in table_rows(file, "name")]
        hint = did_you_mean(configuration, names, "it has none")
        raise UnusableDirectory(f"{directory}: {message_of(f'unknown configuration {configuration!r}', hint)}")
    return found[0]


def recordings_of(directory: Path, configuration: str) -> Mapping[int, Recording]:
    """Return the recordings of an executed configuration by run index; none where its file is missing."""
    file = directory / "recordings" / f"{configuration}.parquet"
    if not file.is_file():  # every run of it broke
        return {}
    of_all = behaviors_of(directory, configuration)
    index = of_all.pop("run_index", None)
    return {
        each.run.run_index: replace(
            each, behaviors={name: column[index == each.run.run_index] for name, column in of_all.items()}
        )
        for each in read_recordings(file)
    }


def scenario_of_row(row: Mapping[str, Any], files: KeptFiles) -> Scenario:
    """Rebuild the scenario of a row of `configurations.parquet`.

    Raises:
        ValueError: a file that the directory does not keep.
    """
    abstract = json.loads(row["abstract"]) if row["abstract"].startswith("{") else row["abstract"]
    content = _value(json.loads(row["scenario"]), files)
    programs = setup_of(content["programs"]) if "programs" in content else None
    parts = content["environment"], content["task"], content["system"], programs
    return Scenario(_value(abstract, files), row["timeout_s"], *parts)


def _value(value: Any, files: KeptFiles) -> Any:
    if isinstance(value, dict):
        if set(value) == {"file"} and _DIGEST.fullmatch(str(value["file"])):
            return files.content(value["file"])
        return {key: _value(item, files) for key, item in value.items()}
    if not isinstance(value, list):
        return value
    match value:
        case [{"file": str(digest)}, str(name)] if _DIGEST.fullmatch(digest):
            return files.plug_in(digest, name)
    return [_value(item, files) for item in value]


def environment_names(directory: Path, environments: Iterable[str | None]) -> dict[str, str]:
    """Digest to the name of the map's or world's file or floor plan; equal names are numbered."""
    files = {}
    for file in files_below(directory / "inputs"):
        with suppress(ValueError):
            files[world_content(file, directory).digest] = file.stem
    names = {digest: files.get(digest, digest[:8]) for digest in environments if digest}
    for digest in names:
        with suppress(ValueError, OSError, KeyError, TypeError):  # the provenance beside a map names its floor plan
            names[digest] = Path(str(read_json(directory / "environments" / digest / "provenance.json")["file"])).stem
    times, seen = Counter(names.values()), Counter[str]()
    for digest, name in names.items():
        if times[name] > 1:
            seen[name] += 1
            names[digest] = f"{name} {seen[name]}"
    return names


def recorded_tables(directory: Path | str, configuration: str) -> RunTables:
    """The tables of all recorded runs of a configuration.

    Raises:
        ValueError: the directory has no recordings of a configuration of this name.
    """
    directory = Path(directory)
    known = {row["name"]: row for row in table_rows(directory / "configurations.parquet")}
    files = [directory / folder / f"{configuration}.parquet" for folder in ("recordings", "traces")]
    if configuration not in known or not all(file.is_file() for file in files):
        recorded = ", ".join(sorted(file.stem for file in (directory / "recordings").glob("*.parquet"))) or "nothing"
        raise ValueError(f"{directory} has no recordings of {configuration!r}. It has those of {recorded}")
    scenario = scenario_of_row(known[configuration], KeptFiles(directory))
    recordings, observed = read_recordings(files[0]), read_block(files[1])
    traces = [trace_of(each, *derived) for each, derived in zip(recordings, observed, strict=True)]
    return run_tables(traces, situation_of(scenario))
