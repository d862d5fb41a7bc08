"""What a campaign file gives the programs of its runs: files, environment, commands before and after."""

from collections.abc import Sequence
from pathlib import Path
from typing import Final

from vastflow.producers.abstract_scenario import AbstractScenario
from vastflow.producers.faults import Fault, Note
from vastflow.producers.vast.document import Document
from vastflow.producers.vast.spec import ExecutionSpec
from vastflow.sim.process.actions import PROCESSES
from vastflow.sim.process.folder import RunFileError, files_matching, unmatched
from vastflow.sim.process.setup import ProcessSetup, RunFiles
from vastflow.sim.script import calls_of

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
    commands = [path for path in (execution.pre_command, _program(execution.post_command)) if path]
    patterns = [*execution.run_files, *(path for path in commands if (base / path).is_file())]
    faults = [
        document.fault(("execution", key), f"found {path!r}, and there is no such file", "a file beside the campaign")
        for key, path in (("pre_command", execution.pre_command), ("post_command", _program(execution.post_command)))
        if path and "/" in path and not Path(path).is_absolute() and not (base / path).is_file()
    ]
    try:
        files = run_files(base, patterns)
    except RunFileError as error:
        what, _, right = str(error).partition("; ")
        return None, [], [*faults, document.fault(("execution", "run_files"), what, right)]
    notes = [
        document.note("warning", ("execution", "run_files"), f"no file matches {pattern!r}")
        for pattern in unmatched(files, execution.run_files)
    ]
    environment = {name: _text(value) for entry in execution.env for name, value in entry.items()}
    setup = ProcessSetup(base, files, environment, execution.pre_command or "", execution.post_command or "")
    return setup, notes, faults


def run_files(base: Path, patterns: Sequence[str]) -> RunFiles:
    """The files below the campaign file's folder that match one of `patterns`, see `files_matching`.

    What campaigns have left there, their directories and exports of them, is not looked at: with copies of its own files in
    them a campaign would be another one after each run of it.

    Raises:
        RunFileError: a pattern that can't be used.
    """
    return files_matching(base, patterns, _is_left_by_a_campaign)


def _is_left_by_a_campaign(folder: Path) -> bool:
    written = all((folder / name).is_file() for name in ("campaign.vast", "metadata.json"))
    return written or (folder / "_config" / "campaign.vast").is_file()


def _starts_programs(abstract: AbstractScenario) -> bool:
    definition = abstract.definition
    return definition is not None and any(call.action in PROCESSES for call in calls_of(definition.root))


def _program(command: str | None) -> str | None:
    return command.split()[0] if command and command.split() else None


def _text(value: object) -> str:
    """A variable as a shell would have it: YAML's `true` is `true`."""
    return str(value).lower() if isinstance(value, bool) else "" if value is None else str(value)
