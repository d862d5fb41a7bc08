"""The campaign directory as an export reads it: one configuration at a time."""

import zipfile
from collections.abc import Iterator, Mapping
from contextlib import suppress
from pathlib import Path
from typing import Any, Final

from vastflow.flows.export.run import ExportedRun, table_csv
from vastflow.flows.results.kept_logs import KeptLogs
from vastflow.oracles.directory.behaviors import Behaviors
from vastflow.oracles.directory.column import table_of
from vastflow.oracles.directory.executed import KeptFiles
from vastflow.oracles.directory.tables import read_tables
from vastflow.oracles.directory.unusable import reading
from vastflow.sim.model.blocks import read_block
from vastflow.sim.model.files import yaml_value
from vastflow.sim.model.pose import pose_of
from vastflow.sim.model.runlog import run_log_of
from vastflow.sim.reading.abstract import BUILTIN
from vastflow.sim.reading.script import GOAL_KEY, GOALS_KEY, START_KEY

_NO_NAME: Final = "scenario"


class ExportSource:
    """What a campaign directory has for an export.

    Attributes:
        campaign: Name of the campaign.
        configurations: Rows of `configurations.parquet`.

    Raises (every method, too):
        UnusableDirectory: a file is missing or damaged.
    """

    def __init__(self, directory: Path) -> None:
        self._directory = directory
        with reading(directory):
            tables = read_tables(directory)
            self.campaign = str(tables.metadata["name"])
            campaign_file = yaml_value(tables.campaign) or {}
            self._scenario_file = Path(campaign_file.get("execution", {}).get("scenario_file") or "").name
            self.configurations = tables.configurations.rows()
            self._rows = {(row["configuration"], row["run_index"]): row for row in tables.runs.to_pylist()}
            self._verdicts: dict[str, dict[int, list[Mapping[str, Any]]]] = {}
            for verdict in tables.verdicts.rows():
                runs = self._verdicts.setdefault(verdict["configuration"], {})
                runs.setdefault(verdict["run_index"], []).append(verdict)
        self._files = KeptFiles(directory)
        self._behaviors = Behaviors(directory)
        self._logs = KeptLogs(directory)
        self._names: dict[str, str] = {}

    def shared_files(self) -> Iterator[tuple[str, Path]]:
        """What was asked for and the maps: place as it was below the campaign file, and where it lies."""
        for folder in (self._files.inputs, self._directory / "environments"):
            for path in sorted(folder.rglob("*")):
                if path.is_file():
                    yield self._place(path), path
        yield "campaign.vast", self._directory / "campaign.vast"

    def scenario_of(self, row: Mapping[str, Any]) -> str:
        """Name of a configuration's scenario."""
        abstract: str | Mapping[str, str] = row["abstract"]
        if isinstance(abstract, str):
            return abstract.removeprefix(BUILTIN)
        digest = abstract["file"]
        if digest not in self._names:
            alike = (each["name"] for each in self.configurations if each["abstract"] == abstract)
            self._names[digest] = next(filter(None, map(self._root, alike)), _NO_NAME)
        return self._names[digest]

    def values_of(self, row: Mapping[str, Any], shared: str) -> dict[str, Any]:
        """Values of all of a configuration's parameters, files as paths.

        Args:
            shared: Path of the folder with the shared files, as the values are to have it.
        """
        scenario = row["scenario"]
        with reading(self._directory):
            values = {**scenario["environment"], **scenario["task"], **scenario["system"]}
            return {key: self._with_paths(_posed(key, value), shared) for key, value in values.items()}

    def runs_of(self, row: Mapping[str, Any]) -> list[ExportedRun]:
        """The runs of a configuration that were asked for, recorded or not, in order."""
        name: str = row["name"]
        scenario = self.scenario_of(row)
        with reading(self._directory):
            block = self._content(f"recordings/{name}.parquet")
            recorded = {run["run_index"]: columns for run, columns in read_block(block)} if block else {}
            behaviors = self._behaviors.of(name)
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
            for run_index, verdicts in sorted(self._verdicts.get(name, {}).items())
        ]

    def outputs_of(self, row: Mapping[str, Any]) -> Iterator[tuple[int, str, bytes]]:
        """Run index, path and content of each file that the programs of a configuration's runs wrote.

        A table is CSV, which it was or could have been; where the run has another file of that name, it is parquet.
        """
        file = self._directory / "outputs" / f"{row['name']}.zip"
        if not file.is_file():
            return
        with reading(self._directory), zipfile.ZipFile(file) as archive:
            entries = dict.fromkeys(archive.namelist())
            for entry in entries:
                run_index, kind, name = entry.split("/", 2)
                content = archive.read(entry)
                if kind == "tables":
                    own = name.removesuffix(".parquet")
                    as_csv = own if own.endswith(".csv") else f"{own}.csv"
                    taken = f"{run_index}/files/{as_csv}" in entries
                    if not own.endswith(".parquet") and not taken:
                        name, content = as_csv, table_csv(table_of(content, entry))
                    else:
                        name = f"{own.removesuffix('.parquet')}.parquet"
                yield int(run_index), name, content

    def _root(self, configuration: str) -> str:
        """Name of the root of a configuration's behaviors, which is the scenario's; empty where no run was recorded."""
        with reading(self._directory):
            behaviors = self._behaviors.of(configuration)
            return str(behaviors["name"][0]) if behaviors and len(behaviors["name"]) else ""

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
        """Of a file below `inputs` or `environments`."""
        inside = path.is_relative_to(self._files.inputs)
        return path.relative_to(self._files.inputs if inside else self._directory).as_posix()

    def _content(self, file: str) -> bytes:
        """A file's content; empty where there is none, as no run was recorded."""
        path = self._directory / file
        return path.read_bytes() if path.is_file() else b""


def _posed(key: str, value: Any) -> Any:
    """A start or goal in the shape of OpenSCENARIO's `pose_3d`, which the shorter `{x, y, yaw}` does not have."""
    if key == GOALS_KEY and isinstance(value, list):
        return [_posed(GOAL_KEY, each) for each in value]
    if key in (START_KEY, GOAL_KEY) and "position" not in (value or ()):
        with suppress(ValueError):
            return pose_of(value).value()
    return value
