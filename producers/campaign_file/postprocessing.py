"""Steps of postprocessing that a campaign file names: what runs, what recordings have already, what can't be done."""

import ast
from collections.abc import Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final, Literal, TypeAlias

from vastflow.producers.campaign_file.document import Document
from vastflow.producers.model.faults import NOT_EXECUTED, Location
from vastflow.sim.model.faults import Complaint, Fault, Got, message_of
from vastflow.sim.model.files import is_file, read_bytes
from vastflow.sim.model.names import did_you_mean
from vastflow.sim.plug_ins.neighbors import PlugInError, neighbors_of

COMMAND: Final = "command"
CONFIG: Final = "/config/"
"""Prefix of paths in the campaign's folder, as in RoboVAST's containers."""

RECORDED: Final[Mapping[str, str]] = {
    "rosbags_tf_to_csv": "`vastflow export` writes poses.csv for each run",
    "rosbags_bt_to_csv": "`vastflow export` writes behaviors.csv for each run",
    "rosbags_to_csv": "`vastflow export` writes recording.csv for each run, with pose, speed and commands",
    "rosbags_action_to_csv": "runs.parquet has how the action ended, behaviors.csv its status",
    "rosbags_rosout_to_csv": "`vastflow export` writes the scenario's log for each run",
    "rosbags_to_webm": "`vastflow replay` shows a run in moving pictures",
    "rosbags_process": "`vastflow export` writes tables for each run",
}
"""Steps of RoboVAST that read ROS bags, and what there is in their place."""

UNTOUCHED: Final[Mapping[str, str]] = {"compress": "the campaign directory stays as it is"}

StepKind: TypeAlias = Literal["command", "plug-in", "recorded", "not executed", "unknown"]


def plug_in_complaint(reference: str, base: Path) -> str | None:
    """Return the fault of `file.py:Class`, relative to `base`; None if the file has such a class.

    Nothing is executed: a name that the file imports or assigns counts, whatever stands behind it.
    """
    name, _, class_name = reference.rpartition(":")
    if not is_file(base / name):
        return f"there is no file {name!r}"
    try:
        module = ast.parse(read_bytes(base / name))
    except (SyntaxError, ValueError, RecursionError) as error:
        return f"{name} can't be read as Python: {' '.join(str(error).split())}"
    for node in ast.walk(module):
        match node:
            case ast.ClassDef(name=found) | ast.Name(id=found, ctx=ast.Store()) if found == class_name:
                return None
            case ast.ImportFrom(names=aliases) | ast.Import(names=aliases):
                if class_name in [alias.asname or alias.name.partition(".")[0] for alias in aliases]:
                    return None
    return f"no class {class_name!r} in {name}"


@dataclass(frozen=True, slots=True)
class ProcessingStep:
    """A step of `results_processing.postprocessing`, called `file.py:Class`, `command`, or as in RoboVAST."""

    name: str
    parameters: Mapping[str, Any]

    @property
    def kind(self) -> StepKind:
        """The treatment of the step."""
        if ".py:" in self.name:
            return "plug-in"
        if self.name == COMMAND:
            return "command"
        return "recorded" if self.name in RECORDED else "not executed" if self.name in UNTOUCHED else "unknown"

    @property
    def file(self) -> str:
        """The file that a plug-in or command runs, as named in the campaign file; may be empty."""
        if self.kind == "plug-in":
            return self.name.rpartition(":")[0].removeprefix(CONFIG)
        script = self.parameters.get("script")
        return script.removeprefix(CONFIG) if isinstance(script, str) else ""

    @property
    def instead(self) -> str:
        """The substitute for a step that does not run."""
        return {**RECORDED, **UNTOUCHED}.get(self.name, "")

    def complaint(self, base: Path) -> Complaint | None:
        """Return the reason why a step can't run, if known before it runs."""
        if self.kind == "plug-in":
            missing = plug_in_complaint(f"{self.file}:{self.name.rpartition(':')[2]}", base)
            return (missing, "") if missing else None
        if self.kind == "unknown":
            known = [*RECORDED, *UNTOUCHED, COMMAND]
            return f"unknown step {self.name!r}", did_you_mean(self.name, [*known, "file.py:Class"])
        if self.kind != "command":
            return None
        if not self.file:
            return "'script' is missing", "name the file that the command runs"
        arguments = self.parameters.get("args")
        if arguments is not None and not isinstance(arguments, list):
            return Got(f"args: {arguments!r}"), "a list"
        is_there = (base / self.file).is_file()
        return None if is_there else (f"there is no script {self.file!r}", "")

    def files(self, base: Path) -> Iterator[Path]:
        """Yield the existing files that the step runs, imports, or takes as arguments."""
        file = base / self.file
        if not self.file or not file.is_file():
            return
        arguments = self.parameters.get("args") if self.kind != "plug-in" else None
        given = [each for each in (arguments if isinstance(arguments, list) else ()) if isinstance(each, str) and each]
        used = [file, *(base / each for each in given if (base / each).is_file())]
        if self.kind == "plug-in":
            with suppress(PlugInError):  # `complaint` says what is wrong with it
                found = neighbors_of(file)
                used = [*found.modules, *found.data]
        yield from used


def steps_of(named: Sequence[Mapping[str, Mapping[str, Any]]]) -> tuple[ProcessingStep, ...]:
    """The steps of a section of a campaign file, in order."""
    return tuple(ProcessingStep(name, parameters) for entry in named for name, parameters in entry.items())


def step_notes(document: Document, steps: Sequence[ProcessingStep], base: Path, location: Location) -> Iterator[Fault]:
    """Yield notes on the steps; an impossible step is no fault, because it costs no run."""
    for k, step in enumerate(steps):
        where = document.known((*location, k, step.name))
        if step.instead:
            yield document.note("not executed", where, f"{step.name}: {NOT_EXECUTED}", step.instead)
        elif complaint := step.complaint(base):
            yield document.note(
                "warning", where, message_of(*complaint), "the campaign runs without it, and ends with 3"
            )
