"""Floor plans and variations as files: their texts, and their names in faults."""

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Final

from vastflow.producers.floorplan.building import Building, build
from vastflow.producers.floorplan.syntax import parse
from vastflow.producers.floorplan.variation import Variation, parse_variation, variation_of
from vastflow.sim.model import files
from vastflow.sim.model.faults import Fault, FaultKind, FileError, Place, message_of

MOST_BYTES: Final = 1_000_000


@dataclass(frozen=True, slots=True)
class PlanFile:
    """A floor plan's text and file name, which identify it."""

    name: str
    text: str

    def called(self, name: str) -> "PlanFile":
        """The same text under another name."""
        return replace(self, name=name)

    def building(self) -> Building:
        """Return the building that the plan describes; raises as `build` does."""
        return build(parse(self.text, self.name))


@dataclass(frozen=True, slots=True)
class VariationFile:
    """A variation's text, the name of its file, and the plan that it imports by the path `imported`."""

    name: str
    text: str
    imported: str
    plan: PlanFile

    def called(self, name: str) -> "VariationFile":
        """The same texts under another name; the plan's follows from it."""
        return replace(self, name=name, plan=self.plan.called(str(Path(name).parent / self.imported)))

    def variation(self) -> Variation:
        """The variation on its valid plan; raises the faults of both."""
        plan = parse(self.plan.text, self.plan.name)
        build(plan)
        return variation_of(parse_variation(self.text, self.name), plan)


def _read_text(path: str | Path) -> str:
    try:
        return files.read_text(path, "a floor plan or variation file", MOST_BYTES)
    except files.Unreadable as error:
        kind: FaultKind = "missing" if isinstance(error, files.Missing) else "error"
        raise FileError([Fault(Place(str(path), *error.place), error.problem, error.expected, kind)]) from None


def read_plan_file(path: str | Path) -> PlanFile:
    """The file at `path`, unchecked; a FileError where it can't be read."""
    return PlanFile(str(path), _read_text(path))


def read_variation_file(path: str | Path) -> VariationFile:
    """The variation file at `path` and the plan that it imports, relative to its folder.

    Raises:
        FileError: one of the two can't be read, or the variation is not in its language.
    """
    path, text = Path(path), _read_text(path)
    variation = parse_variation(text, str(path))
    imported = path.parent / variation.imported
    try:
        plan = _read_text(imported)
    except FileError as error:
        fault = error.faults[0]
        what = f"{str(imported)!r}: {message_of(fault.problem, fault.expected)}"
        place = Place(str(path), *variation.imported_at, "import")
        raise FileError([Fault(place, what, "", fault.kind)]) from None
    return VariationFile(str(path), text, variation.imported, PlanFile(str(imported), plan))
