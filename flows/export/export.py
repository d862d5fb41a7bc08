"""Export: a campaign directory laid out as a folder for each configuration and run."""

import os
import shutil
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from fnmatch import fnmatchcase
from pathlib import Path
from typing import Any, Final

import yaml

from vastflow.flows.export.junit import Case, Suite, campaign_report
from vastflow.flows.export.run import ExportedRun, brief, case_of, files_of
from vastflow.flows.export.source import ExportSource
from vastflow.oracles.directory.unusable import UnusableDirectory
from vastflow.sim.model.faults import UserError
from vastflow.sim.model.names import did_you_mean
from vastflow.tasks.artifact import inside

SHARED: Final = "_config"
"""Folder of what all configurations share; no configuration may be called so."""

REPORT: Final = "test.xml"
VALUES: Final = "scenario.config"
DUPLICATE: Final = "duplicate_of"


@dataclass(frozen=True, slots=True)
class Exported:
    """What was exported.

    Attributes:
        duplicates: How many configurations have the content of another, whose runs are not laid out twice.
        suites: One for each other configuration.
    """

    folder: Path
    duplicates: int
    suites: Sequence[Suite]


def export(
    results: Path,
    folder: Path,
    only: Sequence[str] = (),
    progress: Callable[[int, int], None] = lambda done, of: None,
    outputs: str = "outputs/",
) -> Exported:
    """Lay out the campaign directory `results` in `folder`, which is filled when all is written, and not before.

    Args:
        folder: Must not be there, or be empty.
        only: Patterns (`*`, `?`, `[…]`) of names of configurations and families; all of them where there is no pattern.
        progress: Is told how many configurations are done, and of how many.
        outputs: Where below a run's folder goes what its programs wrote, with `/`; empty: among the other files, as RoboVAST has it.

    Raises:
        UserError: the folder is in use, a pattern fits nothing, or the campaign directory is damaged.
        OSError: the folder can't be written.
    """
    refuse(folder)
    source = ExportSource(results)
    chosen = _chosen(source.configurations, only, results)
    suites = []
    with _filled(folder) as place:
        for name, path in source.shared_files():
            shutil.copyfile(path, _below(place / SHARED, name))
        for done, row in enumerate(chosen):
            progress(done, len(chosen))
            values = {source.scenario_of(row): source.values_of(row, f"../{SHARED}")}
            _write(
                place, f"{row['name']}/{VALUES}", yaml.safe_dump(values, sort_keys=False, allow_unicode=True).encode()
            )
            if row["duplicate_of"] is not None:
                _write(place, f"{row['name']}/{DUPLICATE}", f"{row['duplicate_of']}\n".encode())
                continue
            suites.append(Suite(row["name"], [_write_run(place, run) for run in source.runs_of(row)]))
            for run_index, name, content in source.outputs_of(row):
                _write(place, f"{row['name']}/{run_index}/{outputs}{name}", content)
        (place / REPORT).write_bytes(campaign_report(source.campaign, suites))
    return Exported(folder, len(chosen) - len(suites), suites)


def refuse(folder: Path) -> None:
    """Raise `UserError` where a folder can't take an export."""
    if folder.is_dir():
        if any(folder.iterdir()):
            raise UserError(f"{folder}: the folder is not empty; a new one, or an empty one")
    elif folder.exists() or folder.is_symlink():
        raise UserError(f"{folder}: not a folder; a new one, or an empty one")


def _chosen(rows: Sequence[Mapping[str, Any]], only: Sequence[str], results: Path) -> list[Mapping[str, Any]]:
    for pattern in only:
        if not any(_fits(row, pattern) for row in rows):
            names = list(dict.fromkeys(name for row in rows for name in (row["family"], row["name"])))
            hint = did_you_mean(pattern, names, "it has none", listed="it has")
            raise UnusableDirectory(f"{results}: no family or configuration fits {pattern!r}; {hint}")
    return [row for row in rows if not only or any(_fits(row, pattern) for pattern in only)]


def _fits(row: Mapping[str, Any], pattern: str) -> bool:
    return fnmatchcase(row["name"], pattern) or fnmatchcase(row["family"], pattern)


def _write_run(place: Path, run: ExportedRun) -> Case:
    case = case_of(run)
    for name, content in files_of(run, case):
        _write(place, f"{run.configuration}/{run.run_index}/{name}", content)
    return brief(case)


def _write(place: Path, name: str, content: bytes) -> None:
    _below(place, name).write_bytes(content)


def _below(place: Path, name: str) -> Path:
    """Where a file called `name` goes, in a folder that is there."""
    try:
        file = inside(place, name)
    except ValueError as error:
        raise UnusableDirectory(f"damaged campaign directory: {error}") from None
    file.parent.mkdir(parents=True, exist_ok=True)
    return file


@contextmanager
def _filled(folder: Path) -> Iterator[Path]:
    """A folder whose content is in `folder` once the body ends, and gone when the body raises.

    A folder that is there already stays the same: a shell may stand in it, or a disk of its own may begin there.
    """
    target = folder.absolute()
    there = target.is_dir()
    partial = (target if there else target.parent) / f".{target.name}.{os.getpid()}.partial"
    partial.mkdir(parents=True)
    try:
        yield partial
        if there:
            if any(child != partial for child in target.iterdir()):
                refuse(target)
            for child in sorted(partial.iterdir()):
                child.rename(target / child.name)
            partial.rmdir()
        else:
            refuse(target)
            partial.rename(target)
    except BaseException:
        shutil.rmtree(partial, ignore_errors=True)
        raise
