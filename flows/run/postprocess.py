"""Run a campaign file's postprocessing steps over a copy of the results, and keep their files."""

import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, Final, Literal

from vastflow.flows.export.catalog import SHARED, Vast
from vastflow.flows.export.export import export
from vastflow.flows.results.results import write_json
from vastflow.flows.results.summary import Results
from vastflow.flows.run.notebook import Book, execute_kept
from vastflow.oracles.page.call import link_pages
from vastflow.oracles.results.schema import table_rows
from vastflow.producers.campaign_file.postprocessing import CONFIG, ProcessingStep
from vastflow.producers.campaign_file.visualization import Level, VisualizationStep
from vastflow.sim.model.digest import digest, file_digest
from vastflow.sim.model.faults import UserError, message_of
from vastflow.sim.model.files import copy_file, read_json, read_text
from vastflow.tasks.engine.child import Child, end_text
from vastflow.tasks.engine.engine import RunFault
from vastflow.tasks.store.store import Store

FOLDER: Final = "postprocessing"
STAGE: Final = "postprocessing"
STEPS: Final = "steps.json"
NOTEBOOKS: Final = "visualization"
_READ: Final = ("recordings", "traces", "outputs", "inputs", "environments", FOLDER)
MOST: Final = 12
"""Runs, or configurations, for which a notebook is executed: a campaign has thousands, and each takes seconds."""


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


def run_steps(
    written: Results,
    steps: Sequence[ProcessingStep],
    base: Path,
    notebooks: Sequence[VisualizationStep] = (),
    store: Store | None = None,
) -> Results:
    """Run the steps, then the notebooks, over a written campaign directory, and add faults for those that fail.

    What a step writes into its copy of the results lies in the campaign directory's folder `postprocessing`, at the same place.

    Args:
        base: The campaign file's folder.
        store: Keeps executed notebooks.
    """
    if not steps and not notebooks:
        return written
    directory, file = written.directory, written.directory / "metadata.json"
    metadata = read_json(file)
    with TemporaryDirectory(prefix="vastflow-", ignore_cleanup_errors=True) as aside:
        copy = _Copy(directory, Path(aside).resolve() / directory.name)
        done = list(_each(steps, base, copy))
        shown = [] if store is None else list(_executed(notebooks, base, copy, store))
    (directory / FOLDER).mkdir(exist_ok=True)
    write_json(directory / FOLDER / STEPS, {"steps": [asdict(step) for step in (*done, *shown)]})
    link_pages(directory, [f"{FOLDER}/{name}" for step in shown for name in step.files if name.endswith(".html")])
    ends = [*((STAGE, step) for step in done), *((NOTEBOOKS, step) for step in shown)]
    faults = [
        RunFault("", None, stage, f"{step.name}: {step.message}") for stage, step in ends if step.outcome == "failed"
    ]
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


def _executed(notebooks: Sequence[VisualizationStep], base: Path, copy: "_Copy", store: Store) -> Iterator[Processed]:
    read = _digest_of(copy.directory) if notebooks else ""
    for step in notebooks:
        about = {"tab": step.tab, "level": step.level}
        if complaint := step.complaint(base):
            yield Processed(step.name, "failed", message_of(*complaint), about)
            continue
        copy.state()
        text, places = read_text(base / step.file), _places(step.level, copy.directory)
        books = [_book(step, text, copy, place) for place in places[:MOST]]
        wrong = execute_kept(books, read, store)
        made = [Path(f"{book.place}.{kind}") for book in books for kind in ("html", "ipynb")]
        new = [path.relative_to(copy.folder).as_posix() for path in made if path.is_file()]
        for name in new:
            copy_file(copy.folder / name, copy.directory / FOLDER / name)
        files = {name: file_digest(copy.folder / name) for name in new}
        failed = [
            f"{Path(book.place).parent.relative_to(copy.folder)}: {each}"
            for book, each in zip(books, wrong, strict=True)
            if each
        ]
        others = f"{len(books)} executed" + (f", {len(places) - MOST} left out" if places[MOST:] else "")
        message = "; ".join([*failed[:1], *([f"{len(failed) - 1} more"] if failed[1:] else [])]) or others
        yield Processed(step.name, "failed" if failed else "done", message, about, files)


def _book(step: VisualizationStep, text: str, copy: "_Copy", place: Sequence[str]) -> Book:
    folder = copy.folder.joinpath(*place)
    named = re.sub(r"[^A-Za-z0-9]+", "-", step.tab).strip("-")[:60] or "notebook"
    configuration, run, *_ = (*place, "", "0")
    values = {
        "DATA_DIR": str(folder),
        "RESULTS": str(copy.directory),
        "CONFIGURATION": configuration,
        "RUN": int(run or 0),
    }
    return Book(text, values, str(folder / f"{named}-{step.level}"))


def _places(level: Level, directory: Path) -> list[tuple[str, ...]]:
    """Folders of a level below the campaign's, those that failed first."""
    if level == "campaign":
        return [()]
    failed: dict[tuple[str, ...], bool] = {}
    for row in table_rows(directory / "verdicts.parquet", "configuration", "run_index", "judgment"):
        run = (row["configuration"], str(row["run_index"]))
        failed[run] = failed.get(run, False) or row["judgment"] == "fail"
    ordered = sorted(failed, key=lambda run: not failed[run])  # stable
    return list(dict.fromkeys(run if level == "run" else run[:1] for run in ordered))


def _digest_of(directory: Path) -> str:
    """Digest of all results that a notebook may read, without times and hosts."""
    files = [path for name in _READ for path in (directory / name).rglob("*")]
    files += directory.glob("*.parquet")
    return digest(
        {path.relative_to(directory).as_posix(): file_digest(path) for path in sorted(files) if path.is_file()}
    )


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
    function = "run_command" if step.kind == "command" else "call"
    with Child(f"vastflow.flows.run.postprocessing_step:{function}", folder=copy) as child:
        try:
            if step.kind != "command":
                named = {"file": str(file), "class": step.name.rpartition(":")[2], "parameters": dict(step.parameters)}
                done, message = child.ask({**named, "results": str(copy), "config": str(config)})
                return bool(done), str(message)
            if not file.is_file():  # one that the campaign file names from elsewhere
                file = Path(step.file)
            else:
                file.chmod(0o755)
            words = [str(each) for each in step.parameters.get("args") or ()]
            words = [f"{config}/{each.removeprefix(CONFIG)}" if each.startswith(CONFIG) else each for each in words]
            code = int(child.ask({"command": [str(file), *words, str(copy)]}))
            return code == 0, child.said if code == 0 else end_text(code, "", child.said)
        except UserError as error:
            return False, str(error)
