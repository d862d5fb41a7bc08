"""The files a campaign was asked for with, kept as they were when it was read."""

import os
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from pydantic import BaseModel

from vastflow.oracles.oracle import Oracle
from vastflow.producers.campaign import Campaign
from vastflow.producers.floorplan.files import PlanFile, VariationFile
from vastflow.producers.postprocessing import steps_of
from vastflow.sim.digest import FileContent, digest
from vastflow.sim.files import read_text, yaml_value
from vastflow.sim.maps.occupancy import OccupancyMap
from vastflow.sim.nav.parameters.parameter_file import FILE_KEY, ParameterFile, plug_ins_in
from vastflow.sim.osc.reading import files_of
from vastflow.sim.plug_ins.loading import snapshot_behind
from vastflow.sim.plug_ins.snapshot import Snapshot
from vastflow.sim.reading.map_file import load_map
from vastflow.tasks.evaluation import files_in, producers_in


@dataclass(frozen=True)
class Inputs:
    """Everything that was read; a user may edit the files while the campaign runs.

    Attributes:
        campaign: The campaign file.
        files: Place below `inputs/` to content: maps with their pictures, Nav2 parameter files, the scenario file and
            what it imports, floor plans and their variations, run files, plug-ins with all that they use.
        maps: Digest to map.
        places: File from elsewhere, relative to the campaign file's folder, to its place below `inputs/`. A map of the
            user's folder of maps is kept as if it lay beside the campaign file, for there it is looked for first.
    """

    campaign: bytes = field(repr=False)
    files: Mapping[str, bytes] = field(repr=False)
    maps: Mapping[str, OccupancyMap] = field(repr=False)
    places: Mapping[str, str] = field(default_factory=dict)

    def write(self, directory: Path) -> None:
        """Write `campaign.vast` and `inputs/` into the campaign directory."""
        (directory / "campaign.vast").write_bytes(self.campaign)
        for name, content in self.files.items():
            file = directory / "inputs" / name
            file.parent.mkdir(parents=True, exist_ok=True)
            file.write_bytes(content)


def inputs_of(campaign: Campaign, oracles: Iterable[Oracle[Any]]) -> Inputs:
    """Read the files of `campaign`; to be called as soon as it is loaded."""
    base = campaign.path.parent
    chain = [producer for family in campaign.families for producer in family.producers]
    producers = [each for producer in chain for each in (producer, *producers_in(producer.parameters))]
    fixed = [dict(family.values) for family in campaign.families]
    controllers = plug_ins_in(fixed)
    parameter_files = files_in(*(values.pop(FILE_KEY, None) for values in fixed))
    map_files = files_in(*fixed, *(p.parameters for p in producers))
    files: dict[str, bytes] = {}
    places: dict[str, str] = {}
    for parameter_file in map(Path, parameter_files.values()):
        _keep(files, places, base, parameter_file)
    for content in controllers:
        _keep_beside(files, places, base, content)
    for path in map_files.values():
        borrowed = campaign.borrowed_maps.get(path)
        beside = Path(path) if borrowed is None else base / borrowed
        picture = _picture(Path(path))
        _keep(files, places, base, Path(path), Path(path).parent / picture, at=[beside, beside.parent / picture])
    for plan_file in dict.fromkeys(name for producer in producers for name in _plan_files(producer.parameters)):
        _keep(files, places, base, base / plan_file)
    if isinstance(campaign.abstract, FileContent):
        for scenario_file in files_of(Path(campaign.abstract.path)):
            _keep(files, places, base, scenario_file)
    for _, run_file in campaign.programs.files if campaign.programs else ():
        _keep(files, places, base, Path(run_file.path))
    for plug_in in (*producers, *oracles):
        if (snapshot := snapshot_behind(type(plug_in))) is not None:
            _keep_snapshot(files, places, base, snapshot)
    for step in steps_of(campaign.spec.results_processing.postprocessing):
        for step_file in step.files(base):
            _keep(files, places, base, step_file)
    maps = {key: load_map(file) for key, file in map_files.items()}
    return Inputs(campaign.path.read_bytes(), files, maps, places)


def _keep_snapshot(files: dict[str, bytes], places: dict[str, str], base: Path, snapshot: Snapshot) -> None:
    """Keep a plug-in with all that it uses, as they were when it was loaded."""
    for place in snapshot.files:
        path, home = snapshot.origin / place, Path(os.path.abspath(base))
        name = path.relative_to(home) if path.is_relative_to(home) else Path(snapshot.digest[:12], place)
        files[name.as_posix()] = snapshot.read(place)
        if not path.is_relative_to(home):
            places[Path(os.path.relpath(path, home)).as_posix()] = name.as_posix()


def _keep_beside(files: dict[str, bytes], places: dict[str, str], base: Path, content: ParameterFile) -> None:
    """Keep a parameter file's plug-ins where the kept parameter file names them."""
    home = Path(os.path.abspath(content.path)).parent
    kept = places.get(Path(os.path.relpath(content.path, base)).as_posix())
    for snapshot in content.plug_ins.values():
        if kept is None:
            _keep_snapshot(files, places, base, snapshot)
            continue
        for place in snapshot.files:
            name = os.path.normpath(Path(kept).parent / os.path.relpath(snapshot.origin / place, home))
            files[Path(name).as_posix()] = snapshot.read(place)


def _plan_files(parameters: BaseModel) -> Iterator[str]:
    """Floor plans and their variations among a producer's parameters, as the campaign file names them."""
    for field_name in type(parameters).model_fields:
        value = getattr(parameters, field_name)
        for each in value if isinstance(value, tuple) else (value,):
            if isinstance(each, VariationFile):
                yield from (each.name, each.plan.name)
            elif isinstance(each, PlanFile):
                yield each.name


def _picture(map_file: Path) -> str:
    return str(yaml_value(read_text(map_file))["image"])


def _keep(
    files: dict[str, bytes], places: dict[str, str], base: Path, *together: Path, at: Sequence[Path] | None = None
) -> None:
    """Keep files at their places below `base`, or as if they lay `at` others; those elsewhere, in a folder named by content."""
    contents = [path.read_bytes() for path in together]
    elsewhere = digest([content.hex() for content in contents])[:12]
    for path, content in zip(at or together, contents, strict=True):
        inside = path.resolve().is_relative_to(base.resolve())
        name = path.resolve().relative_to(base.resolve()) if inside else Path(elsewhere, path.name)
        files[name.as_posix()] = content
        if not inside:
            places[Path(os.path.relpath(path, base)).as_posix()] = name.as_posix()  # by links as they are named
