"""Reading scenario files: OpenSCENARIO DSL (ASAM OpenSCENARIO DSL 2), the part of it that is executed.

A file passes through three forms, each a set of frozen values: `syntax`, what is written, with places (`grammar`, `building`);
`declarations`, what names mean (`declaring`); `definition`, what scenarios do with names resolved, types agreed and units turned
into SI (`checking` and the checkers of members, expressions and what is done). This module leads
through them.
"""

from collections.abc import Mapping
from pathlib import Path
from typing import Final

from vastflow.sim.model import files
from vastflow.sim.model.faults import Fault, FileError, Place
from vastflow.sim.model.names import did_you_mean
from vastflow.sim.scenario.definition import ScenarioDefinition
from vastflow.sim.scenario.language import syntax
from vastflow.sim.scenario.language.checking import checked
from vastflow.sim.scenario.language.declarations import Declarations
from vastflow.sim.scenario.language.declaring import declared, library, library_names, parse

MOST_BYTES: Final = 500_000

ABSENT: Final[Mapping[str, str]] = {
    "osc.docker": "containers",
    "osc.kubernetes": "clusters",
    "osc.moveit2": "robot arms",
    "osc.pybullet": "another simulator",
    "osc.rosbridge": "ROS nodes behind a websocket",
}
"""Libraries that other tools have."""


def read_scenarios(path: Path) -> tuple[ScenarioDefinition, ...]:
    """Return the scenarios of a file, in its order, without those of imported files.

    Raises:
        FileError: every fault in the file and those that it imports; of each file that is not in the language at all, the
            first.
    """
    start = Place(str(path), 1, 1)
    return read_text(_content(path, start), str(path), path.parent)


def read_text(text: str, file: str, folder: Path) -> tuple[ScenarioDefinition, ...]:
    """Return the scenarios of a file with this text.

    Args:
        file: Its name for messages.
        folder: Where the files are that it imports.

    Raises:
        FileError: as for `read_scenarios`.
    """
    try:
        return _read(text, file, folder)
    except RecursionError:
        raise FileError([Fault(Place(file), "got an expression that is too long", "several shorter ones")]) from None


def files_of(path: Path) -> tuple[Path, ...]:
    """Return a file and all files that it imports, itself first, without libraries.

    Raises:
        FileError: one of them can't be read, or is not in the language.
    """
    found: dict[Path, Path] = {}
    _find(path, Place(str(path), 1, 1), found)
    return tuple(found.values())


def _find(path: Path, place: Place, found: dict[Path, Path]) -> None:
    if path.resolve() in found:
        return
    found[path.resolve()] = path
    for part in parse(_content(path, place), str(path)).imports:
        if part.is_file:
            _find(path.parent / part.target, part.place, found)


def _read(text: str, file: str, folder: Path) -> tuple[ScenarioDefinition, ...]:
    faults: list[Fault] = []
    parsed = parse(text, file)
    read: dict[Path, Declarations] = {(folder / Path(file).name).resolve(): Declarations()}
    declarations = _declarations(parsed, file, folder, read, faults)
    scenarios = [part for part in parsed.declarations if isinstance(part, syntax.Compound) and part.kind == "scenario"]
    if not scenarios:
        faults.append(Fault(Place(file, 1, 1), "got no scenario", "'scenario name:' and what it does"))
    definitions = [checked(scenario, declarations, faults) for scenario in scenarios]
    if faults:
        raise FileError(faults)
    return tuple(definition for definition in definitions if definition is not None)


def _declarations(
    text: syntax.File, file: str, folder: Path, read: dict[Path, Declarations], faults: list[Fault]
) -> Declarations:
    """Return the declarations of a file and its imports; a file in `read` that is being read has none yet."""
    imported = Declarations()
    for part in text.imports:
        clashing = imported.include(_imported(part, folder, read, faults))
        for name in clashing:
            faults.append(Fault(part.place, f"{name!r} is declared by an import above too", "one of the imports"))
    return declared(text, imported, file, faults)


def _imported(part: syntax.Import, folder: Path, read: dict[Path, Declarations], faults: list[Fault]) -> Declarations:
    if part.is_file:
        return _imported_file(part, folder, read, faults)
    if part.target in library_names():
        return library(part.target)
    if part.target in ABSENT:
        what = f"library {part.target} is about {ABSENT[part.target]}, which vastflow does not have"
        faults.append(Fault(part.place, what, "a scenario without it"))
    else:
        right = did_you_mean(part.target, library_names())
        faults.append(Fault(part.place, f"unknown library {part.target!r}", right))
    return Declarations()


def _imported_file(
    part: syntax.Import, folder: Path, read: dict[Path, Declarations], faults: list[Fault]
) -> Declarations:
    path = folder / part.target
    try:
        resolved = path.resolve()
        if resolved not in read:
            read[resolved] = Declarations()
            parsed = parse(_content(path, part.place), str(path))
            read[resolved] = _declarations(parsed, str(path), path.parent, read, faults)
    except FileError as error:
        faults.extend(error.faults)
        return Declarations()
    return read[resolved]


def _content(path: Path, place: Place) -> str:
    """Return the text of a file; `place` is that of its import."""
    try:
        return files.read_text(path, "a scenario file", MOST_BYTES)
    except files.Missing:
        raise FileError([Fault(place, f"there is no file {path}", "the path of a scenario file")]) from None
    except files.Unreadable as error:
        if error.place == files.START:
            raise FileError([Fault(place, f"{path}: {error.what}", error.right)]) from None
        raise FileError([Fault(Place(str(path), *error.place), error.what, error.right)]) from None
