"""Run a campaign file's postprocessing steps over a copy of the results, and keep their files."""

import json
import os
import signal
import subprocess
from collections.abc import Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, Final, Literal

from vastflow.flows.export.catalog import SHARED, Vast
from vastflow.flows.export.export import export
from vastflow.flows.results.results import write_json
from vastflow.flows.results.summary import Results
from vastflow.flows.run.postprocessing_step import Request
from vastflow.producers.campaign_file.postprocessing import CONFIG, ProcessingStep
from vastflow.sim.model.digest import file_digest
from vastflow.sim.model.faults import message_of
from vastflow.sim.model.files import copy_file, read_json
from vastflow.tasks.engine.engine import RunFault
from vastflow.tasks.engine.process import own_environment, python_command

FOLDER: Final = "postprocessing"
STAGE: Final = "postprocessing"
STEPS: Final = "steps.json"
_SAID: Final = 2000
"""Characters of what a step's process writes that are kept, the last ones."""


@dataclass(frozen=True)
class Processed:
    """One step.

    Attributes:
        outcome: `failed` is a fault of the step, never one of a run.
        message: Message of the step, or the reason that it failed.
        files: Place below the results' copy to the digest of each file that it wrote.
    """

    name: str
    outcome: Literal["done", "failed", "recorded", "not executed"]
    message: str
    parameters: Mapping[str, Any] = field(default_factory=dict)
    files: Mapping[str, str] = field(default_factory=dict)


def run_steps(written: Results, steps: Sequence[ProcessingStep], base: Path) -> Results:
    """Run the steps over a written campaign directory, and add faults for failed steps.

    What a step writes into its copy of the results lies in the campaign directory's folder `postprocessing`, at the same place.

    Args:
        base: The campaign file's folder.
    """
    if not steps:
        return written
    directory, file = written.directory, written.directory / "metadata.json"
    metadata = read_json(file)
    with TemporaryDirectory(prefix="vastflow-", ignore_cleanup_errors=True) as aside:
        copy = _Copy(directory, Path(aside).resolve() / directory.name)
        done = list(_each(steps, base, copy))
    (directory / FOLDER).mkdir(exist_ok=True)
    write_json(directory / FOLDER / STEPS, {"steps": [asdict(step) for step in done]})
    faults = [RunFault("", None, STAGE, f"{step.name}: {step.message}") for step in done if step.outcome == "failed"]
    if faults:
        write_json(file, {**metadata, "faults": [*metadata.get("faults", []), *map(asdict, faults)]})
    return replace(written, faults=(*written.faults, *faults))


def _each(steps: Sequence[ProcessingStep], base: Path, copy: "_Copy") -> Iterator[Processed]:
    for step in steps:
        if step.instead:
            yield Processed(step.name, "recorded" if step.kind == "recorded" else "not executed", step.instead)
            continue
        said = Processed(step.name, "failed", message_of(*(step.complaint(base) or ("", ""))), step.parameters)
        if said.message:
            yield said
            continue
        before = copy.state()
        done, message = _run(step, copy.folder)
        new = sorted(name for name, state in copy.state().items() if before.get(name) != state)
        for name in new:
            copy_file(copy.folder / name, copy.directory / FOLDER / name)
        files = {name: file_digest(copy.folder / name) for name in new}
        yield replace(said, outcome="done" if done else "failed", message=message, files=files)


@dataclass(frozen=True)
class _Copy:
    """The copy of a campaign's results that steps run over, made when the first one needs it."""

    directory: Path
    folder: Path

    def state(self) -> Mapping[str, tuple[int, int]]:
        """Place of each file of the copy to its size and time; makes the copy."""
        if not self.folder.exists():
            export(self.directory, self.folder, chosen=Vast(outputs=""))
        files = (path for path in self.folder.rglob("*") if path.is_file() and not path.is_symlink())
        return {
            path.relative_to(self.folder).as_posix(): (path.stat().st_size, path.stat().st_mtime_ns) for path in files
        }


def _run(step: ProcessingStep, copy: Path) -> tuple[bool, str]:
    config = copy / SHARED
    file = config / step.file
    with TemporaryDirectory(prefix="vastflow-") as aside:
        if step.kind == "command":
            if not file.is_file():  # one that the campaign file names from elsewhere
                file = Path(step.file)
            else:
                file.chmod(0o755)
            arguments = [str(each) for each in step.parameters.get("args") or ()]
            arguments = [
                f"{config}/{each.removeprefix(CONFIG)}" if each.startswith(CONFIG) else each for each in arguments
            ]
            code, said = _process([str(file), *arguments, str(copy)], copy, "")
            return code == 0, said if code == 0 else _end_text(code, "", said)
        answer = Path(aside) / "answer.json"
        class_name = step.name.rpartition(":")[2]
        request = Request(str(file), class_name, dict(step.parameters), str(copy), str(config), str(answer))
        command = python_command("vastflow.flows.run.postprocessing_step")
        code, said = _process(command, copy, json.dumps(asdict(request)))
        if not answer.is_file():
            return False, f"its process {_end_text(code, ' without an answer', said)}"
        done, message = json.loads(answer.read_text(encoding="utf-8"))
        return bool(done), str(message)


def _process(command: Sequence[str], folder: Path, request: str) -> tuple[int, str]:
    environment = {**own_environment(), "PYTHONUNBUFFERED": "1", "PYTHONDONTWRITEBYTECODE": "1"}
    with TemporaryDirectory(prefix="vastflow-") as aside, (Path(aside) / "log").open("wb+") as log:
        try:
            process = subprocess.Popen(
                command,
                cwd=folder,
                env=environment,
                stdin=subprocess.PIPE,
                stdout=log,
                stderr=log,
                start_new_session=True,
            )
        except OSError as error:
            return 126, f"{Path(command[0]).name} can't be started: {error.strerror or error}"
        try:
            process.communicate(request.encode())
        finally:
            with suppress(ProcessLookupError, PermissionError):
                os.killpg(process.pid, signal.SIGKILL)
            process.wait()
        log.seek(max(0, log.seek(0, os.SEEK_END) - _SAID))
        return process.returncode, log.read().decode("utf-8", "replace").strip()


def _end_text(code: int, how: str, said: str) -> str:
    ended = f"was ended by signal {-code}" if code < 0 else f"ended with code {code}"
    last = said.rpartition("\n")[2].strip()
    return f"{ended}{how}{': ' if said else ''}{last}"
