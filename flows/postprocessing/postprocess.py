"""Run a campaign file's postprocessing steps over a copy of the results, and keep their files."""

import json
import os
import shutil
import signal
import subprocess
import sys
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import IO, Any, Final, Literal, Self

from vastflow.flows.export.export import SHARED, export
from vastflow.flows.postprocessing.plug_in import Request
from vastflow.flows.results.summary import Results
from vastflow.producers.campaign_file.postprocessing import CONFIG, ProcessingStep
from vastflow.sim.model.digest import digest, file_digest
from vastflow.tasks.engine.engine import RunFault

FOLDER: Final = "postprocessing"
STEPS: Final = "steps.json"


@dataclass(frozen=True)
class Processed:
    """One step.

    Attributes:
        outcome: `failed` is a fault of the step, never one of a run.
        message: What it says of itself, or why it failed.
        files: Place below the results' copy to the digest of each file that it wrote.
        key: Digest of all that the files follow from; empty where nothing may be reused.
    """

    name: str
    outcome: Literal["done", "failed", "recorded", "not executed"]
    message: str
    parameters: Mapping[str, Any] = field(default_factory=dict)
    files: Mapping[str, str] = field(default_factory=dict)
    key: str = ""


def write_processed(directory: Path, steps: list[Processed]) -> None:
    """Say in the campaign directory what became of the steps."""
    text = json.dumps({"steps": [asdict(step) for step in steps]}, indent=2, ensure_ascii=False) + "\n"
    (directory / FOLDER).mkdir(exist_ok=True)
    (directory / FOLDER / STEPS).write_text(text, encoding="utf-8", errors="backslashreplace")


def earlier(directory: Path, key: str) -> tuple[Path, Processed] | None:
    """Return the newest neighboring folder with intact files of a step of this key."""
    for folder in sorted(directory.parent.glob(f"*/{FOLDER}"), key=lambda each: each.parent.name[-20:], reverse=True):
        for step in _steps(folder / STEPS):
            if step.key == key and step.outcome == "done" and _whole(folder, step):
                return folder, step
    return None


def _steps(file: Path) -> Iterator[Processed]:
    try:
        rows = json.loads(file.read_text(encoding="utf-8"))["steps"]
        yield from [Processed(**row) for row in rows]
    except (OSError, ValueError, KeyError, TypeError):
        return


def _whole(folder: Path, step: Processed) -> bool:
    """Whether its files are there as they were written: a user may have edited them."""
    return all((folder / name).is_file() and file_digest(folder / name) == own for name, own in step.files.items())


STAGE: Final = "postprocessing"
_SAID: Final = 2000
"""Characters of what a step's process writes that are kept, the last ones."""


def postprocessed(written: Results, steps: Sequence[ProcessingStep], base: Path) -> Results:
    """Run the steps over a written campaign directory, and add faults for failed steps.

    What a step writes into its copy of the results lies in the campaign directory's folder `postprocessing`, at the same
    place; a step whose results, plug-in and parameters are those of a campaign directory beside this one is not run again.

    Args:
        base: The campaign file's folder.
    """
    if not steps:
        return written
    directory = written.directory
    with _Copies(directory, base) as copies:
        done = list(_each(directory, steps, base, copies, _key_of(directory)))
    write_processed(directory, done)
    faults = [RunFault("", None, STAGE, f"{step.name}: {step.message}") for step in done if step.outcome == "failed"]
    if faults:
        _say(directory, faults)
    return replace(written, faults=(*written.faults, *faults))


def _each(
    directory: Path, steps: Sequence[ProcessingStep], base: Path, copies: "_Copies", key: str
) -> Iterator[Processed]:
    for step in steps:
        if step.instead:
            yield Processed(step.name, "recorded" if step.kind == "recorded" else "not executed", step.instead)
            continue
        said = Processed(step.name, "failed", step.complaint(base) or "", step.parameters)
        if said.message:
            yield said
            continue
        key = digest(key, step.name, step.parameters, [file_digest(file) for file in step.files(base)]) if key else ""
        if key and (found := earlier(directory, key)):
            folder, said = found
            copies.take(folder, said.files)
        else:
            before = copies.there()
            done, message = _run(step, copies.folder)
            written = copies.take_new(before)
            said = replace(said, outcome="done" if done else "failed", message=message, files=written, key=key)
            if not done:
                key = ""  # what follows may build on what it left half done
        yield said


class _Copies:
    """The copy of a campaign's results that steps run over, made when the first one needs it.

    Files that steps wrote go from it into the campaign directory, and from there into the copy of a later step.
    """

    def __init__(self, directory: Path, base: Path) -> None:
        self._directory = directory
        self._base = base
        self._temporary: TemporaryDirectory[str] | None = None
        self._folder = Path()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        if self._temporary is not None:
            self._temporary.cleanup()

    @property
    def folder(self) -> Path:
        """The copy, with all that steps have written before."""
        if self._temporary is None:
            self._temporary = TemporaryDirectory(prefix="vastflow-", ignore_cleanup_errors=True)
            self._folder = Path(self._temporary.name).resolve() / self._directory.name
            export(self._directory, self._folder, outputs="")
            kept = self._directory / FOLDER
            if kept.is_dir():
                shutil.copytree(kept, self._folder, dirs_exist_ok=True)
        return self._folder

    def there(self) -> Mapping[str, tuple[int, int]]:
        """Place of each file of the copy to its size and time."""
        files = (path for path in self.folder.rglob("*") if path.is_file() and not path.is_symlink())
        return {
            path.relative_to(self.folder).as_posix(): (path.stat().st_size, path.stat().st_mtime_ns) for path in files
        }

    def take_new(self, before: Mapping[str, tuple[int, int]]) -> dict[str, str]:
        """Keep the files that are not as they were before; place to digest."""
        new = [name for name, state in self.there().items() if before.get(name) != state]
        self._keep(self.folder, new)
        return {name: file_digest(self.folder / name) for name in sorted(new)}

    def take(self, folder: Path, names: Mapping[str, str]) -> None:
        """Keep files that the same step wrote for another campaign directory."""
        self._keep(folder, names)
        if self._temporary is not None:
            _copy(folder, self._folder, names)

    def _keep(self, folder: Path, names: Sequence[str] | Mapping[str, str]) -> None:
        _copy(folder, self._directory / FOLDER, names)


def _copy(source: Path, target: Path, names: Sequence[str] | Mapping[str, str]) -> None:
    for name in names:
        (target / name).parent.mkdir(parents=True, exist_ok=True)
        shutil.copyfile(source / name, target / name)


def _run(step: ProcessingStep, copy: Path) -> tuple[bool, str]:
    """Run one step on the copy; return its success and its message."""
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
            return code == 0, said if code == 0 else f"{_ended(code)}{': ' if said else ''}{_last_line(said)}"
        answer = Path(aside) / "answer.json"
        class_name = step.name.rpartition(":")[2]
        request = Request(str(file), class_name, dict(step.parameters), str(copy), str(config), str(answer))
        command = [sys.executable, "-m", "vastflow.flows.postprocessing.plug_in"]
        code, said = _process(command, copy, json.dumps(asdict(request)))
        if not answer.is_file():
            return False, f"its process {_ended(code)} without an answer{': ' if said else ''}{_last_line(said)}"
        done, message = json.loads(answer.read_text(encoding="utf-8"))
        return bool(done), str(message)


def _process(command: Sequence[str], folder: Path, request: str) -> tuple[int, str]:
    """Run a process with its children to the end; return exit code and last output."""
    environment = {**os.environ, "PYTHONUNBUFFERED": "1", "PYTHONDONTWRITEBYTECODE": "1"}
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
        with _ended_with_its_group(process):
            process.communicate(request.encode())
        return process.returncode, _end_of(log)


@contextmanager
def _ended_with_its_group(process: "subprocess.Popen[bytes]") -> Iterator[None]:
    try:
        yield
    finally:
        with suppress(ProcessLookupError, PermissionError):
            os.killpg(process.pid, signal.SIGKILL)
        process.wait()


def _end_of(log: IO[bytes]) -> str:
    log.seek(max(0, log.seek(0, os.SEEK_END) - _SAID))
    return log.read().decode("utf-8", "replace").strip()


def _last_line(said: str) -> str:
    return said.rpartition("\n")[2].strip()


def _ended(code: int) -> str:
    return f"was ended by signal {-code}" if code < 0 else f"ended with code {code}"


def _metadata(directory: Path) -> dict[str, Any]:
    found: dict[str, Any] = json.loads((directory / "metadata.json").read_text(encoding="utf-8"))
    return found


def _key_of(directory: Path) -> str:
    """Return the digest of a campaign directory from its report key; empty without one."""
    report = _metadata(directory).get("report")
    return digest(STAGE, report) if isinstance(report, str) else ""


def _say(directory: Path, faults: Sequence[RunFault]) -> None:
    """Put the steps' faults among those of the campaign."""
    file, found = directory / "metadata.json", _metadata(directory)
    found["faults"] = [*found.get("faults", []), *map(asdict, faults)]
    renewed = file.with_name(f".{file.name}")
    renewed.write_text(
        json.dumps(found, indent=2, ensure_ascii=False) + "\n", encoding="utf-8", errors="backslashreplace"
    )
    renewed.replace(file)
