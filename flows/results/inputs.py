"""Input files of a campaign: captured when it is read, and laid out again later."""

import os
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from pydantic import BaseModel

from vastflow.flows.request.campaign_file import read_campaign
from vastflow.flows.request.run_request import Asked
from vastflow.oracles.judgment.oracle import Oracle
from vastflow.oracles.results.unusable import UnusableDirectory
from vastflow.producers.campaign import Campaign
from vastflow.producers.campaign_file.postprocessing import steps_of
from vastflow.producers.campaign_file.visualization import visualization_of
from vastflow.producers.floorplan.files import PlanFile, VariationFile
from vastflow.sim.model.digest import FileContent, digest, file_digest
from vastflow.sim.model.faults import FileError
from vastflow.sim.model.files import copy_file, files_below, read_bytes
from vastflow.sim.plug_ins.loading import check_permitted, snapshot_behind
from vastflow.sim.plug_ins.snapshot import PlugInFile, Snapshot, plug_ins_in
from vastflow.sim.scenario.language.reading import files_of
from vastflow.sim.system.keys import FILE_KEY, RECORDING_KEY
from vastflow.sim.world.readers.registry import files_of_world, reader_of
from vastflow.sim.world.world import World, world_at
from vastflow.tasks.engine.evaluation import content_of, files_in, producers_in
from vastflow.tasks.store.artifact import inside


@dataclass(frozen=True)
class Inputs:
    """Everything that was read; a user may edit the files while the campaign runs.

    Attributes:
        files: Place below `inputs/` to content: maps with their pictures, Nav2 parameter files, the scenario file and
            what it imports, floor plans and their variations, run files, plug-ins with all that they use.
        worlds: Digest to the world of a map, or of another file.
        places: File from elsewhere, relative to the campaign file's folder, to its place below `inputs/`. A map of the
            user's folder of maps is kept as if it lay beside the campaign file, for there it is looked for first.
    """

    campaign: bytes = field(repr=False)
    files: Mapping[str, bytes] = field(repr=False)
    worlds: Mapping[str, World] = field(repr=False)
    places: Mapping[str, str] = field(default_factory=dict)

    def write(self, directory: Path) -> None:
        """Write `campaign.vast` and `inputs/` into the campaign directory."""
        (directory / "campaign.vast").write_bytes(self.campaign)
        write_files(directory / "inputs", self.files)


def write_files(folder: Path, files: Mapping[str, bytes]) -> None:
    """Write files by their places below a folder."""
    for place, content in files.items():
        (folder / place).parent.mkdir(parents=True, exist_ok=True)
        (folder / place).write_bytes(content)


def inputs_of(campaign: Campaign, oracles: Iterable[Oracle[Any]]) -> Inputs:
    """Read the files of `campaign`; call at once after loading it."""
    base = campaign.path.parent
    chain = [producer for family in campaign.families for producer in family.producers]
    producers = [each for producer in chain for each in (producer, *producers_in(producer.parameters))]
    fixed = [dict(family.values) for family in campaign.families]
    plug_in_files = plug_ins_in([*fixed, *(content_of(producer.parameters) for producer in producers)])
    parameter_files = files_in(*(values.pop(key, None) for values in fixed for key in (FILE_KEY, RECORDING_KEY)))
    map_files = files_in(*fixed, *(p.parameters for p in producers))
    code = {each.digest for each in plug_in_files if reader_of(Path(each.path)) is None}
    map_files = {key: file for key, file in map_files.items() if key not in code}
    kept = _Kept(base)
    for parameter_file in map(Path, parameter_files.values()):
        kept.keep(parameter_file)
    for content in plug_in_files:
        kept.keep_beside(content)
    for path in map(Path, map_files.values()):
        together, borrowed = files_of_world(path), campaign.borrowed_maps.get(str(path))
        beside = path if borrowed is None else base / borrowed
        kept.keep(*together, at=[beside.parent / os.path.relpath(file, path.parent) for file in together])
    others = [base / name for producer in producers for name in _plan_files(producer.parameters)]
    others += files_of(Path(campaign.abstract.path)) if isinstance(campaign.abstract, FileContent) else []
    others += [Path(file.path) for _, file in (campaign.programs.files if campaign.programs else ())]
    others += [file for step in steps_of(campaign.spec.results_processing.postprocessing) for file in step.files(base)]
    named = visualization_of(campaign.spec.evaluation.visualization)
    others += [base / step.file for step in named if (base / step.file).is_file()]
    for other in dict.fromkeys(others):
        kept.keep(other)
    for plug_in in (*producers, *oracles):
        if (snapshot := snapshot_behind(type(plug_in))) is not None:
            kept.keep_snapshot(snapshot)
    worlds = {key: world_at(Path(file)) for key, file in map_files.items()}
    return Inputs(read_bytes(campaign.path), kept.files, worlds, kept.places)


@dataclass
class _Kept:
    """The files read so far, see `Inputs`."""

    base: Path
    files: dict[str, bytes] = field(default_factory=dict)
    places: dict[str, str] = field(default_factory=dict)

    def keep(self, *together: Path, at: Sequence[Path] | None = None) -> None:
        """Keep files by their places below `base` or `at`; others in a folder named by content."""
        contents = [read_bytes(path) for path in together]
        elsewhere, home = digest([content.hex() for content in contents])[:12], self.base.resolve()
        for path, content in zip(at or together, contents, strict=True):
            inside = path.resolve().is_relative_to(home)
            name = path.resolve().relative_to(home) if inside else Path(elsewhere, path.name)
            self.files[name.as_posix()] = content
            if not inside:
                # by links as they are named
                self.places[Path(os.path.relpath(path, self.base)).as_posix()] = name.as_posix()

    def keep_snapshot(self, snapshot: Snapshot) -> None:
        """Keep a plug-in with all that it uses, as they were when it was loaded."""
        for place in snapshot.files:
            path, home = snapshot.origin / place, Path(os.path.abspath(self.base))
            name = path.relative_to(home) if path.is_relative_to(home) else Path(snapshot.digest[:12], place)
            self.files[name.as_posix()] = snapshot.read(place)
            if not path.is_relative_to(home):
                self.places[Path(os.path.relpath(path, home)).as_posix()] = name.as_posix()

    def keep_beside(self, content: PlugInFile) -> None:
        """Keep a parameter file's plug-ins where the kept parameter file names them."""
        home = Path(os.path.abspath(content.path)).parent
        kept = self.places.get(Path(os.path.relpath(content.path, self.base)).as_posix())
        for snapshot in content.plug_ins.values():
            if kept is None:
                self.keep_snapshot(snapshot)
                continue
            for place in snapshot.files:
                path = snapshot.origin / place
                name = Path(os.path.normpath(Path(kept).parent / os.path.relpath(path, home))).as_posix()
                self.files[name] = snapshot.read(place)
                self.places[Path(os.path.relpath(path, self.base)).as_posix()] = name


def _plan_files(parameters: BaseModel) -> Iterator[str]:
    for field_name in type(parameters).model_fields:
        value = getattr(parameters, field_name)
        for each in value if isinstance(value, tuple) else (value,):
            if isinstance(each, VariationFile):
                yield from (each.name, each.plan.name)
            elif isinstance(each, PlanFile):
                yield each.name


@dataclass(frozen=True)
class Replica:
    """A campaign file that reads as it did.

    Attributes:
        map_dir: Folder of the maps that the file names from the root of the file system, for those that are no longer there.
    """

    file: Path
    map_dir: Path


@contextmanager
def replica(directory: Path, asked: Asked) -> Iterator[Replica]:
    """A copy of the campaign file and its inputs, in a folder for as long as the body takes.

    Raises:
        UnusableDirectory: an input is not in the directory, or one that the file names from the root of the file
            system is another one by now.
    """
    with TemporaryDirectory(prefix="vastflow-") as folder:
        try:
            laid_out = _laid_out(directory, asked, Path(folder))
        except (OSError, ValueError) as error:
            raise UnusableDirectory(f"{directory}: its inputs can't be read: {error}") from None
        kept = {read_bytes(path) for path in files_below(directory / "inputs")}
        try:
            found = inputs_of(*read_campaign(laid_out.file, laid_out.map_dir))
        except FileError as error:
            words = str(error).replace(str(laid_out.file), str(directory / "campaign.vast")).replace(folder, "")
            raise UnusableDirectory(f"{directory}: its inputs can't be read any more: {words}") from None
        if other := sorted(name for name, content in found.files.items() if content not in kept):
            raise UnusableDirectory(
                f"{directory}: {', '.join(other)} is another file now than in its inputs. Put back the one that was used, "
                "or run the campaign file itself"
            )
        yield laid_out


def _laid_out(directory: Path, asked: Asked, folder: Path) -> Replica:
    """Copy the inputs into `folder`; those outside of the campaign file's folder stay outside of its copy."""
    above = max((Path(place).parts.count("..") for place in asked.places), default=0)
    root = folder / "campaign"
    base = root.joinpath(*["campaign"] * above)
    base.mkdir(parents=True)
    inputs, outside = directory / "inputs", set(asked.places.values())
    for path in files_below(inputs):
        name = path.relative_to(inputs).as_posix()
        if name not in outside:
            copy_permitted(path, base / name)
    for place, name in asked.places.items():
        if (inputs / name) in files_below(inputs):
            target = os.path.relpath(os.path.normpath(base / place), folder)
            copy_permitted(inside(inputs, name), inside(folder, target))
    file = inside(base, asked.file)
    copy_permitted(directory / "campaign.vast", file)
    return Replica(file, root)


def copy_permitted(source: Path, target: Path) -> None:
    """Copy a file that is executed; raises as `copy_file`, and if `code_from` does not permit it."""
    copy_file(source, target)
    check_permitted(source, file_digest(target))
