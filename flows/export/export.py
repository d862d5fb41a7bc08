"""The export of a campaign directory in a format."""

import os
import shutil
import zipfile
from collections import Counter, defaultdict
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import dataclass
from fnmatch import fnmatchcase
from functools import partial
from pathlib import Path, PurePosixPath
from typing import Any

from vastflow.flows.export.catalog import Vast
from vastflow.flows.export.format import ExportedCampaign, ExportedConfiguration, Format, files_of_format
from vastflow.flows.export.junit import FlawKind
from vastflow.flows.export.run import ExportedRun, flaw_of, table_csv
from vastflow.flows.results.tables import KeptLogs
from vastflow.oracles.evidence.evidence import headline_of
from vastflow.oracles.replay.recorded import recorded_run
from vastflow.oracles.results.executed import KeptFiles
from vastflow.oracles.results.schema import behaviors_of, table_of, table_rows
from vastflow.oracles.results.tables import read_tables
from vastflow.oracles.results.unusable import UnusableDirectory, reading
from vastflow.sim.model.archive import members_of
from vastflow.sim.model.blocks import read_block
from vastflow.sim.model.digest import FileContent
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
            self.metadata: Mapping[str, Any] = tables.metadata
            self.campaign = str(self.metadata["name"])
            searched = directory / "evaluations.parquet"
            self.evaluations = list(table_rows(searched)) if searched.is_file() else []
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
        self._files = KeptFiles(directory, plug_ins=True)
        self._logs = KeptLogs(directory)
        self._names: dict[str, str] = {}

    def shared_files(self) -> dict[str, Path]:
        """Return inputs and maps: the path below the campaign file, and the path of the copy."""
        folders = (self._files.inputs, self._directory / "environments")
        files = {self._place(path): path for folder in folders for path in files_below(folder)}
        return {**files, "campaign.vast": self._directory / "campaign.vast"}

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

    def values_of(self, row: Mapping[str, Any]) -> dict[str, Any]:
        """Return the values of a configuration's parameters, with files as their places in `shared_files`."""
        scenario = row["scenario"]
        with reading(self._directory):
            values = {**scenario["environment"], **scenario["task"], **scenario["system"]}
            return {key: self._with_paths(_posed(key, value)) for key, value in values.items()}

    def runs_of(self, row: Mapping[str, Any]) -> Iterator[ExportedRun]:
        """Yield the runs of a configuration in order, recorded or not."""
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
        with self._outputs(name) as outputs:
            for run_index, verdicts in sorted(self._verdicts[name].items()):
                yield ExportedRun(
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
                    outputs=outputs(run_index),
                    read=partial(recorded_run, self._directory, name, run_index) if run_index in recorded else None,
                )

    def run_indices(self, name: str) -> list[int]:
        """Return the runs of a configuration, recorded or not."""
        return sorted(self._verdicts[name])

    def verdicts_of(self, name: str, run_index: int) -> Sequence[Mapping[str, Any]]:
        """Return the verdicts on a run."""
        return self._verdicts[name][run_index]

    @contextmanager
    def _outputs(self, configuration: str) -> Iterator[Callable[[int], dict[str, bytes]]]:
        file = self._directory / "outputs" / f"{configuration}.zip"
        with ExitStack() as opened:
            members: defaultdict[int, list[tuple[str, str, zipfile.ZipInfo]]] = defaultdict(list)
            if file.is_file():
                with reading(self._directory):
                    archive = opened.enter_context(zipfile.ZipFile(opened.enter_context(open_file(file))))
                    for (run_index, kind, name), entry in members_of(archive).items():
                        members[run_index].append((kind, name, entry))

            def read(run_index: int) -> dict[str, bytes]:
                outputs: dict[str, bytes] = {}
                with reading(self._directory):
                    for kind, name, entry in members[run_index]:
                        own, written = name.removesuffix(".parquet"), archive.read(entry)
                        as_csv = own if own.endswith(".csv") else f"{own}.csv"
                        if kind != "tables":
                            outputs[name] = written
                        elif own.endswith(".parquet") or as_csv in outputs:  # files come first
                            outputs[f"{own.removesuffix('.parquet')}.parquet"] = written
                        else:
                            outputs[as_csv] = table_csv(table_of(written, name))
                return outputs

            yield read

    def _with_paths(self, value: Any) -> Any:
        """`value` with `{"file": digest}` as the place of that file; left alone where it is not kept.

        A plug-in, `[{"file": digest}, name]`, is the text `file.py:name`.
        """
        match value:
            case [{"file": str(digest)}, str(name)]:
                match self._files.plug_in(digest, name):
                    case [FileContent(path=path), _]:
                        return f"{self._place(Path(path))}:{name}"
        if isinstance(value, dict):
            if set(value) == {"file"}:
                with suppress(ValueError):
                    return PurePosixPath(self._place(self._files.path(str(value["file"]))))
                return value
            return {key: self._with_paths(item) for key, item in value.items()}
        return [self._with_paths(item) for item in value] if isinstance(value, list) else value

    def _place(self, path: Path) -> str:
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


@dataclass(frozen=True, slots=True)
class Exported:
    """The result of an export.

    Attributes:
        names: The configurations, those among them that equal another are counted in `duplicates`.
        flaws: The number of runs that did not pass, by kind; those of None passed.
    """

    folder: Path
    names: Sequence[str]
    duplicates: int
    flaws: Counter[FlawKind | None]


@dataclass(frozen=True)
class _Runs:
    source: ExportSource
    row: Mapping[str, Any]
    begin: Callable[[], None]
    patterns: Sequence[str]

    def __iter__(self) -> Iterator[ExportedRun]:
        self.begin()
        for run in self.source.runs_of(self.row):
            if not self.patterns or any(_asks(pattern, run.run_index) for pattern in self.patterns):
                yield run


def export(
    results: Path,
    folder: Path,
    only: Sequence[str] = (),
    progress: Callable[[int, int], None] = lambda done, of: None,
    chosen: Format | None = None,
) -> Exported:
    """Export the campaign directory `results` to the new or empty `folder` at once.

    Args:
        only: Patterns (`*`, `?`, `[…]`) of names of configurations and families, with `/` and the index of a run for that run alone;
            all if empty.
        progress: Called with the number of exported configurations and their total.
        chosen: The format; `Vast` unless given.

    Raises:
        UserError: the folder is in use, a pattern matches nothing, the campaign directory is damaged, or the format's code raises.
        OSError: the folder can't be written.
    """
    refuse(folder)
    source = ExportSource(results)
    rows = source.configurations
    for pattern in only:
        fitting = [row for row in rows if _fits(row, pattern)]
        if fitting and not any(_asks(pattern, run) for row in fitting for run in source.run_indices(row["name"])):
            unknown = f"no run of {fitting[0]['name']} matches {pattern!r}"
            hint = f"it has the content of {alike}" if (alike := fitting[0]["duplicate_of"]) else ""
            raise UnusableDirectory(f"{results}: {message_of(unknown, hint)}")
        if not fitting:
            names = list(dict.fromkeys(name for row in rows for name in (row["family"], row["name"])))
            hint = did_you_mean(pattern, names, "it has none")
            raise UnusableDirectory(f"{results}: {message_of(f'no family or configuration matches {pattern!r}', hint)}")
    rows = [row for row in rows if not only or any(_fits(row, pattern) for pattern in only)]
    configurations = []
    for k, row in enumerate(rows):
        patterns = [pattern for pattern in only if _fits(row, pattern)]
        runs = _Runs(source, row, partial(progress, k, len(rows)), patterns) if row["duplicate_of"] is None else ()
        about = (row["name"], row["family"], source.scenario_of(row), source.values_of(row), row["duplicate_of"])
        configurations.append(ExportedConfiguration(*about, runs, row["provenance"]))
    headline = "" if only else source.headline
    chosen_names = {row["name"] for row in rows}
    told = [each for each in source.evaluations if each["configuration"] in chosen_names or not only]
    about_it = headline, configurations, source.shared_files(), source.metadata, told
    campaign = ExportedCampaign(source.campaign, *about_it)
    with _filled(folder) as place:
        for name, content in files_of_format(chosen or Vast(), campaign):
            file = _below(place, name)
            if isinstance(content, Path):
                copy_file(content, file)
            else:
                file.write_bytes(content)
    ran = [each.name for each in configurations if each.duplicate_of is None]
    flaws = Counter(
        flaw_of(source.verdicts_of(row["name"], run))
        for row in rows
        if row["duplicate_of"] is None
        for run in source.run_indices(row["name"])
        if not only or any(_fits(row, pattern) and _asks(pattern, run) for pattern in only)
    )
    return Exported(folder, [each.name for each in configurations], len(configurations) - len(ran), flaws)


def refuse(folder: Path) -> None:
    """Raise `UserError` unless a folder is new or empty."""
    if folder.is_dir():
        if any(folder.iterdir()):
            raise UserError(f"{folder}: expected a new or an empty folder, got one with files")
    elif folder.exists() or folder.is_symlink():
        raise UserError(f"{folder}: expected a new or an empty folder, got a file or a broken link")


def _fits(row: Mapping[str, Any], pattern: str) -> bool:
    name = pattern.partition("/")[0]
    return fnmatchcase(row["name"], name) or fnmatchcase(row["family"], name)


def _asks(pattern: str, run_index: int) -> bool:
    """Whether a pattern that fits the run's configuration asks for the run."""
    return fnmatchcase(str(run_index), pattern.partition("/")[2] or "*")


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
