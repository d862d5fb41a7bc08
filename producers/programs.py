"""What a campaign file gives the programs of its runs: files, environment, commands before and after."""

from collections.abc import Sequence
from pathlib import Path, PurePosixPath
from typing import Final

from vastflow.producers.abstract_scenario import AbstractScenario
from vastflow.producers.faults import Fault, Location, Note
from vastflow.producers.vast.document import Document
from vastflow.producers.vast.spec import ExecutionSpec
from vastflow.sim.model.digest import FileContent, file_digest
from vastflow.sim.model.files import is_file
from vastflow.sim.model.scenario import ProcessSetup, RunFiles
from vastflow.sim.reading.script import calls_of
from vastflow.sim.scenario.programs.actions import PROCESSES
from vastflow.sim.scenario.programs.folders import CONFIG, RunFileError, below_config, files_matching, unmatched

KEYS: Final = ("run_files", "env", "pre_command", "post_command")


def programs_of(
    document: Document, base: Path, execution: ExecutionSpec, abstract: AbstractScenario
) -> tuple[ProcessSetup | None, list[Note], list[Fault]]:
    """The setup of a campaign whose scenario starts programs, else None with a note on each key that then does nothing.

    Files named by `pre_command` and `post_command` that lie below the campaign file's folder are run files too: what is in
    them counts.
    """
    given = [key for key in KEYS if getattr(execution, key)]
    if not _starts_programs(abstract):
        why = "the scenario starts no program"
        return None, [document.note("not executed", ("execution", key), "has no effect", why) for key in given], []
    scripts, notes, faults = _scripts(document, base, execution)
    try:
        files = run_files(base, execution.run_files)
    except RunFileError as error:
        what, _, right = str(error).partition("; ")
        return None, [], [*faults, document.fault(("execution", "run_files"), what, right)]
    notes += [
        document.note("warning", ("execution", "run_files"), f"no file matches {pattern!r}")
        for pattern in unmatched(files, execution.run_files)
    ]
    environment = {name: _text(value) for entry in execution.env for name, value in entry.items()}
    folder = PurePosixPath(execution.scenario_file or "").parent
    own = {path: FileContent(str(base / path), file_digest(base / path)) for path in scripts}
    setup = ProcessSetup(
        tuple(sorted({**own, **dict(files)}.items())),
        environment,
        execution.pre_command or "",
        execution.post_command or "",
        "" if folder == PurePosixPath() else folder.as_posix(),
    )
    return setup, notes, faults


def _scripts(document: Document, base: Path, execution: ExecutionSpec) -> tuple[list[str], list[Note], list[Fault]]:
    """The files below `base` that `pre_command` and `post_command` name, and what there is to say of what they name."""
    found: list[str] = []
    notes: list[Note] = []
    faults: list[Fault] = []
    for key in ("pre_command", "post_command"):
        command = getattr(execution, key) or ""
        program = command if _is_file(base, command) else _program(command)
        if program is None or (key == "post_command" and "/" not in program and not _is_file(base, program)):
            continue  # nothing, or a program that PATH leads to
        where: Location = ("execution", key)
        if _is_file(base, program):
            found.append(str(below_config(program)))
        elif PurePosixPath(program).is_absolute() and not PurePosixPath(program).is_relative_to(CONFIG):
            if not is_file(program):
                right = f"a file beside the campaign is {CONFIG}/NAME"
                notes.append(document.note("warning", where, f"this machine has no {program!r}", right))
        else:
            right = "a file below the campaign file's folder"
            faults.append(document.fault(where, f"found {program!r}, and there is no such file", right))
    return found, notes, faults


def _is_file(base: Path, name: str) -> bool:
    inside = below_config(name)
    return inside is not None and is_file(base / inside)


def run_files(base: Path, patterns: Sequence[str]) -> RunFiles:
    """The files below the campaign file's folder that match one of `patterns`, see `files_matching`.

    What campaigns have left there, their directories and exports of them, is not looked at: with copies of its own files in
    them a campaign would be another one after each run of it.

    Raises:
        RunFileError: a pattern that can't be used.
    """
    return files_matching(base, patterns, _is_left_by_a_campaign)


def _is_left_by_a_campaign(folder: Path) -> bool:
    written = all(is_file(folder / name) for name in ("campaign.vast", "metadata.json"))
    return written or is_file(folder / "_config" / "campaign.vast")


def _starts_programs(abstract: AbstractScenario) -> bool:
    definition = abstract.definition
    return definition is not None and any(call.action in PROCESSES for call in calls_of(definition.root))


def _program(command: str | None) -> str | None:
    return command.split()[0] if command and command.split() else None


def _text(value: object) -> str:
    """A variable as a shell would have it: YAML's `true` is `true`."""
    return str(value).lower() if isinstance(value, bool) else "" if value is None else str(value)
