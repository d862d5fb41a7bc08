"""Reading scenario files: OpenSCENARIO DSL (ASAM OpenSCENARIO DSL 2), the part of it that is executed.

A file passes through three forms, each a set of frozen values: `syntax`, what is written, with places (`grammar`, `building`);
`declarations`, what names mean (`declaring`); `definition`, what scenarios do with names resolved, types agreed and units turned
into SI (`checking`, which extends `members` and `expressions`). This module leads through them.
"""

from collections.abc import Mapping
from pathlib import Path
from typing import Final

from vastflow.sim.model import files
from vastflow.sim.model.faults import Fault, FileError, Got, Place
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
    """Return the scenarios of a file in order, imported files excluded.

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
        folder: Folder to which the paths of its imports are relative.

    Raises:
        FileError: as for `read_scenarios`.
    """
    reader = _Reader((folder / Path(file).name).resolve())
    try:
        parsed = parse(text, file)
        declarations = reader.declarations(parsed, file, folder)
        scenarios = [
            each for each in parsed.declarations if isinstance(each, syntax.Compound) and each.kind == "scenario"
        ]
        if not scenarios:
            reader.faults.append(Fault(Place(file, 1, 1), Got("no scenario"), "'scenario name:' and what it does"))
        definitions = [checked(scenario, declarations, reader.faults) for scenario in scenarios]
    except RecursionError:
        raise FileError([Fault(Place(file), Got("an expression that is too long"), "several shorter ones")]) from None
    if reader.faults:
        raise FileError(reader.faults)
    return tuple(definition for definition in definitions if definition is not None)


def files_of(path: Path) -> tuple[Path, ...]:
    """Return a file and all files that it imports, itself first, without libraries.

    Raises:
        FileError: one of them can't be read, or is not in the language.
    """
    found: dict[Path, Path] = {}
    waiting = [(path, Place(str(path), 1, 1))]
    while waiting:
        file, place = waiting.pop(0)
        if file.resolve() not in found:
            found[file.resolve()] = file
            imports = parse(_content(file, place), str(file)).imports
            waiting[:0] = [(file.parent / part.target, part.place) for part in imports if part.is_file]
    return tuple(found.values())


class _Reader:
    """Reads the declarations of a file and its imports, each file once, and collects faults."""

    def __init__(self, file: Path) -> None:
        self.faults: list[Fault] = []
        self._read = {file: Declarations()}  # one that is being read has none yet

    def declarations(self, text: syntax.File, file: str, folder: Path) -> Declarations:
        imported = Declarations()
        for part in text.imports:
            for name in imported.include(self._imported(part, folder)):
                what = f"{name!r} is declared by an import above too"
                self.faults.append(Fault(part.place, what, "keep one of the imports"))
        return declared(text, imported, file, self.faults)

    def _imported(self, part: syntax.Import, folder: Path) -> Declarations:
        path, name = folder / part.target, part.target
        if part.is_file:
            try:
                if (key := path.resolve()) not in self._read:
                    self._read[key] = Declarations()
                    parsed = parse(_content(path, part.place), str(path))
                    self._read[key] = self.declarations(parsed, str(path), path.parent)
                return self._read[key]
            except FileError as error:
                self.faults += error.faults
        elif name in library_names():
            return library(name)
        elif name in ABSENT:
            what = f"library {name} is about {ABSENT[name]}, which vastflow does not have"
            self.faults.append(Fault(part.place, what, "write the scenario without it"))
        else:
            self.faults.append(Fault(part.place, f"unknown library {name!r}", did_you_mean(name, library_names())))
        return Declarations()


def _content(path: Path, place: Place) -> str:
    """Return the text of a file; `place` is the place of its import."""
    try:
        return files.read_text(path, "a scenario file", MOST_BYTES)
    except files.Missing:
        raise FileError([Fault(place, f"there is no file {path}", "expected a scenario file")]) from None
    except files.Unreadable as error:
        if error.place == files.START:
            raise FileError([Fault(place, f"{path}: {error}")]) from None
        raise FileError([Fault(Place(str(path), *error.place), error.problem, error.expected)]) from None
