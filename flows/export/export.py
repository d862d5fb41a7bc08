"""The export of a campaign directory as a folder for each configuration and run."""

import os
import shutil
from collections import defaultdict
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass, replace
from fnmatch import fnmatchcase
from pathlib import Path
from typing import Any, Final

import yaml

from vastflow.flows.export.junit import Suite, campaign_report
from vastflow.flows.export.run import ExportedRun, case_of, files_of, table_csv
from vastflow.flows.results.tables import KeptLogs
from vastflow.oracles.evidence.evidence import headline_of
from vastflow.oracles.results.executed import KeptFiles
from vastflow.oracles.results.schema import behaviors_of, table_of, table_rows
from vastflow.oracles.results.tables import read_tables
from vastflow.oracles.results.unusable import UnusableDirectory, reading
from vastflow.sim.model.archive import unpacked
from vastflow.sim.model.blocks import read_block
from vastflow.sim.model.faults import UserError, message_of
from vastflow.sim.model.files import copy_file, files_below, open_file, yaml_value
from vastflow.sim.model.names import did_you_mean
from vastflow.sim.model.pose import pose_of
from vastflow.sim.model.recording import run_log_of
from vastflow.sim.reading.abstract import BUILTIN
from vastflow.sim.reading.script import GOAL_KEY, GOALS_KEY, START_KEY
from vastflow.tasks.store.artifact import inside


class ExportSource:
    """Reads an export's inputs; every method raises `UnusableDirectory` for a missing or damaged file."""

    def __init__(self, directory: Path) -> None:
        self._directory = directory
        with reading(directory):
            tables = read_tables(directory)
            self.campaign = str(tables.metadata["name"])
            self.headline = headline_of(tables).text
            campaign_file = yaml_value(tables.campaign) or {}
            self._scenario_file = Path(campaign_file.get("execution", {}).get("scenario_file") or "").name
            self.configurations = tables.configurations.rows()
            runs = table_rows(directory / "runs.parquet")
            self._rows = {(row["configuration"], row["run_index"]): row for row in runs}
            self._verdicts: defaultdict[str, defaultdict[int, list[Mapping[str, Any]]]]
            self._verdicts = defaultdict(lambda: defaultdict(list))
            for verdict in tables.verdicts.rows():
                self._verdicts[verdict["configuration"]][verdict["run_index"]].append(verdict)
        self._files = KeptFiles(directory)
        self._logs = KeptLogs(directory)
        self._names: dict[str, str] = {}

    def shared_files(self) -> Iterator[tuple[str, Path]]:
        """Yield inputs and maps: the path below the campaign file, and the path of the copy."""
        for folder in (self._files.inputs, self._directory / "environments"):
            for path in files_below(folder):
                yield self._place(path), path
        yield "campaign.vast", self._directory / "campaign.vast"

    def scenario_of(self, row: Mapping[str, Any]) -> str:
        """Return the name of a configuration's scenario."""
        abstract: str | Mapping[str, str] = row["abstract"]
        if isinstance(abstract, str):
            return abstract.removeprefix(BUILTIN)
        digest = abstract["file"]
        if digest not in self._names:
            alike = (each["name"] for each in self.configurations if each["abstract"] == abstract)
            with reading(self._directory):
                roots = (list(behaviors_of(self._directory, name).get("name", ())) for name in alike)
                self._names[digest] = next((str(names[0]) for names in roots if names), "scenario")
        return self._names[digest]

    def values_of(self, row: Mapping[str, Any], shared: str) -> dict[str, Any]:
        """Return the values of a configuration's parameters, with files as paths in the folder `shared`."""
        scenario = row["scenario"]
        with reading(self._directory):
            values = {**scenario["environment"], **scenario["task"], **scenario["system"]}
            return {key: self._with_paths(_posed(key, value), shared) for key, value in values.items()}

    def runs_of(self, row: Mapping[str, Any]) -> list[ExportedRun]:
        """Return the runs of a configuration in order, recorded or not."""
        name: str = row["name"]
        scenario = self.scenario_of(row)
        with reading(self._directory):
            file = self._directory / "recordings" / f"{name}.parquet"
            block = read_block(file) if file.is_file() else ()
            recorded = {run["run_index"]: columns for run, columns in block}
            behaviors = behaviors_of(self._directory, name)
            indices = behaviors.pop("run_index", None)
            rows = self._logs.of(name)
            logs = {each["run_index"]: run_log_of(each) for each in rows}
            hosts = {each["run_index"]: {key: each[key] for key in ("host", "versions", "pid")} for each in rows}
        return [
            ExportedRun(
                campaign=self.campaign,
                configuration=name,
                run_index=run_index,
                verdicts=verdicts,
                row=self._rows.get((name, run_index)),
                log=logs.get(run_index),
                host=hosts.get(run_index, {}),
                recorded=recorded.get(run_index, {}),
                behaviors={key: column[indices == run_index] for key, column in behaviors.items()},
                scenario=scenario,
                scenario_file=f"{scenario}.osc" if isinstance(row["abstract"], str) else self._scenario_file,
            )
            for run_index, verdicts in sorted(self._verdicts[name].items())
        ]

    def outputs_of(self, row: Mapping[str, Any]) -> Iterator[tuple[int, str, bytes]]:
        """Yield run index, path, and content of each file that programs wrote.

        Tables are CSV, or Parquet if the run has another file of that name.
        """
        file = self._directory / "outputs" / f"{row['name']}.zip"
        if not file.is_file():
            return
        with reading(self._directory), open_file(file) as content:
            files = set()  # which come first
            for (run_index, kind, name), written in unpacked(content):
                if kind == "tables":
                    own = name.removesuffix(".parquet")
                    as_csv = own if own.endswith(".csv") else f"{own}.csv"
                    if not own.endswith(".parquet") and (run_index, as_csv) not in files:
                        name, written = as_csv, table_csv(table_of(written, name))
                    else:
                        name = f"{own.removesuffix('.parquet')}.parquet"
                files.add((run_index, name))
                yield run_index, name, written

    def _with_paths(self, value: Any, shared: str) -> Any:
        """`value` with `{"file": digest}` as the path of that file; left alone where it is not kept."""
        if isinstance(value, dict):
            if set(value) == {"file"}:
                with suppress(ValueError):
                    return f"{shared}/{self._place(self._files.path(str(value['file'])))}"
                return value
            return {key: self._with_paths(item, shared) for key, item in value.items()}
        return [self._with_paths(item, shared) for item in value] if isinstance(value, list) else value

    def _place(self, path: Path) -> str:
        """Return the path of a file relative to `inputs`, or to the campaign directory."""
        inside = path.is_relative_to(self._files.inputs)
        return path.relative_to(self._files.inputs if inside else self._directory).as_posix()


def _posed(key: str, value: Any) -> Any:
    """Return a start or goal `{x, y, yaw}` in the form of OpenSCENARIO's `pose_3d`."""
    if key == GOALS_KEY and isinstance(value, list):
        return [_posed(GOAL_KEY, each) for each in value]
    if key in (START_KEY, GOAL_KEY) and "position" not in (value or ()):
        with suppress(ValueError):
            return pose_of(value).value()
    return value


BRIEFLY: Final = ("simulated_time_s", "wall_time_s", "outcome")
"""Properties that a case keeps in a report of many."""
SHARED: Final = "_config"
"""Folder of files that all configurations share; no configuration has this name."""


@dataclass(frozen=True, slots=True)
class Exported:
    """The result of an export: a suite for each configuration, but for duplicates of others, which are counted."""

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
    """Export the campaign directory `results` to the new or empty `folder` at once.

    Args:
        only: Patterns (`*`, `?`, `[…]`) of names of configurations and families; all if empty.
        progress: Called with the number of exported configurations and their total.
        outputs: Folder of a run's output files, with `/`; empty for the run's own folder, as in RoboVAST.

    Raises:
        UserError: the folder is in use, a pattern matches nothing, or the campaign directory is damaged.
        OSError: the folder can't be written.
    """
    refuse(folder)
    source = ExportSource(results)
    rows = source.configurations
    for pattern in only:
        if not any(_fits(row, pattern) for row in rows):
            names = list(dict.fromkeys(name for row in rows for name in (row["family"], row["name"])))
            hint = did_you_mean(pattern, names, "it has none")
            raise UnusableDirectory(f"{results}: {message_of(f'no family or configuration matches {pattern!r}', hint)}")
    chosen = [row for row in rows if not only or any(_fits(row, pattern) for pattern in only)]
    suites = []
    with _filled(folder) as place:
        for name, path in source.shared_files():
            copy_file(path, _below(place / SHARED, name))
        for done, row in enumerate(chosen):
            progress(done, len(chosen))
            home = place / row["name"]
            values = {source.scenario_of(row): source.values_of(row, f"../{SHARED}")}
            text = yaml.safe_dump(values, sort_keys=False, allow_unicode=True)
            _below(place, f"{row['name']}/scenario.config").write_text(text, encoding="utf-8")
            if row["duplicate_of"] is not None:
                _below(home, "duplicate_of").write_text(f"{row['duplicate_of']}\n", encoding="utf-8")
                continue
            cases = []
            for run in source.runs_of(row):
                case = case_of(run)
                for name, content in files_of(run, case):
                    _below(home, f"{run.run_index}/{name}").write_bytes(content)
                # a report of many runs with all properties would take hundreds of megabytes
                few = {name: case.properties[name] for name in BRIEFLY if name in case.properties}
                cases.append(replace(case, properties=few))
            suites.append(Suite(row["name"], cases))
            for run_index, name, content in source.outputs_of(row):
                _below(home, f"{run_index}/{outputs}{name}").write_bytes(content)
        (place / "test.xml").write_bytes(campaign_report(source.campaign, suites, "" if only else source.headline))
    return Exported(folder, len(chosen) - len(suites), suites)


def refuse(folder: Path) -> None:
    """Raise `UserError` unless a folder is new or empty."""
    if folder.is_dir():
        if any(folder.iterdir()):
            raise UserError(f"{folder}: expected a new or an empty folder, got one with files")
    elif folder.exists() or folder.is_symlink():
        raise UserError(f"{folder}: expected a new or an empty folder, got a file or a broken link")


def _fits(row: Mapping[str, Any], pattern: str) -> bool:
    return fnmatchcase(row["name"], pattern) or fnmatchcase(row["family"], pattern)


def _below(place: Path, name: str) -> Path:
    """Return the path of the file `name`, and make its folder."""
    try:
        file = inside(place, name)
    except ValueError as error:
        raise UnusableDirectory(f"damaged campaign directory: {error}") from None
    file.parent.mkdir(parents=True, exist_ok=True)
    return file


@contextmanager
def _filled(folder: Path) -> Iterator[Path]:
    """Yield a temporary folder that moves to `folder` after the body, or is removed if it raises.

    An existing folder is kept, since it may be a mount point or the working directory of a shell.
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
