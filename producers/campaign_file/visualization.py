"""Notebooks that a campaign file names in `evaluation.visualization`: which level each is for, and whether it can run."""

import importlib.util
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Final, Literal, TypeAlias, get_args

from vastflow.producers.campaign_file.document import Document
from vastflow.producers.model.faults import NOT_EXECUTED
from vastflow.sim.model.faults import Complaint, Fault, Got, message_of
from vastflow.sim.model.files import Unreadable, is_file, read_json

if TYPE_CHECKING:
    from vastflow.producers.campaign_file.spec import Notebooks

Level: TypeAlias = Literal["run", "config", "campaign"]
LEVELS: Final[tuple[Level, ...]] = get_args(Level)
EXTRA: Final = ("ipykernel", "nbclient", "nbconvert", "nbformat")
INSTEAD: Final = "name one for the campaign, which has all batches"


def missing_library() -> str:
    """Return the first library of the extra `notebook` that is not installed, else nothing."""
    return next((name for name in EXTRA if importlib.util.find_spec(name) is None), "")


@dataclass(frozen=True, slots=True)
class VisualizationStep:
    """A notebook of one tab, executed for each run, for each configuration, or once."""

    index: int
    tab: str
    level: Level
    file: str

    @property
    def name(self) -> str:
        """The notebook and its level."""
        return f"{self.file} ({self.level})"

    def complaint(self, base: Path) -> Complaint | None:
        """Return the reason why the notebook can't run, if known before it runs; nothing of it is executed."""
        path = base / self.file
        if not is_file(path):
            return f"there is no notebook {self.file!r}", ""
        try:
            found = read_json(path)
            if found["nbformat"] != 4 or not all(
                cell["cell_type"] and cell["source"] is not None for cell in found["cells"]
            ):
                raise ValueError
        except (Unreadable, ValueError, TypeError, LookupError, OSError):
            return Got(f"{self.file!r} that is no notebook"), "JSON of nbformat 4"
        if name := missing_library():
            return f"{name} is missing", "call pip install 'vastflow[notebook]'"
        return None


def visualization_of(tabs: Sequence[Mapping[str, "Notebooks"]]) -> tuple[VisualizationStep, ...]:
    """Return the notebooks of the section, in order, those of runs first in each tab."""
    return tuple(
        VisualizationStep(k, tab, level, file)
        for k, entry in enumerate(tabs)
        for tab, named in entry.items()
        for level in LEVELS
        if (file := getattr(named, level))
    )


def visualization_notes(document: Document, tabs: Sequence[Mapping[str, "Notebooks"]], base: Path) -> Iterator[Fault]:
    """Yield notes on notebooks that can't run; none is a fault, because it costs no run."""
    for step in visualization_of(tabs):
        if complaint := step.complaint(base):
            where = document.known(("evaluation", "visualization", step.index, step.tab, step.level))
            yield document.note(
                "warning", where, message_of(*complaint), "the campaign runs without it, and ends with 3"
            )
    for k, entry in enumerate(tabs):
        for tab in (tab for tab, named in entry.items() if named.batch):
            where = document.known(("evaluation", "visualization", k, tab, "batch"))
            yield document.note("not executed", where, f"batch: {NOT_EXECUTED}", INSTEAD)
