"""The tables of a campaign directory, as evidence, report, and terminal read them."""

import io
import json
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc
import pyarrow.json
from numpy.typing import NDArray

from vastflow.oracles.judgment.verdict import Judgment
from vastflow.oracles.results.schema import METRICS, codes, floats, integers, read_columns, table_rows, text_batches
from vastflow.oracles.results.units import Units, units_of
from vastflow.sim.model.files import json_value, read_json, read_text

if TYPE_CHECKING:
    import pandas as pd

CODES: Final[Mapping[Judgment, int]] = {"pass": 0, "fail": 1, "not judged": 2}
JUDGMENTS: Final[Mapping[int, Judgment]] = {code: judgment for judgment, code in CODES.items()}
ABSENT: Final = 3
"""Code of a run that an oracle says nothing of."""
PASS, FAIL, NOT_JUDGED = CODES.values()
_RUNS: Final = 1 << 31
_PARSED_ROWS: Final = 1 << 16
"""Number of verdicts whose metrics are parsed at once: their texts take ten times the memory of the columns."""

_MOST_UNCHECKED: Final = 4096
"""Length of metrics that can't be deep enough to end the process: pyarrow's parser recurses."""


def run_keys(configuration: NDArray[np.int64], run_index: NDArray[np.int64]) -> NDArray[np.int64]:
    """A number (R,) for each run, ascending by configuration and run index."""
    return configuration * _RUNS + run_index


class ConfigurationTable:
    """The rows of `configurations.parquet`; JSON columns are decoded when they are asked for.

    Attributes:
        names, families: In the order of the campaign file.
        duplicate_of: Name of the configuration of the same content, which alone was run; None without one.
        environments: Digests of maps, None for a scenario without a map.
        distinct: Indices of the configurations that are no duplicates.
    """

    def __init__(self, table: pa.Table) -> None:
        self.table = table
        self.names: list[str] = table["name"].to_pylist()
        self.families: list[str] = table["family"].to_pylist()
        self.duplicate_of: list[str | None] = table["duplicate_of"].to_pylist()
        self.environments: list[str | None] = table["environment"].to_pylist()
        self.distinct: NDArray[np.int64] = np.flatnonzero([name is None for name in self.duplicate_of])

    @cached_property
    def factors(self) -> list[Mapping[str, Any]]:
        """Values that file and producers gave to each configuration."""
        return self._decoded("factors")

    @cached_property
    def contents(self) -> list[Mapping[str, Any]]:
        """Environment, task, system and programs of each."""
        return self._decoded("scenario")

    @cached_property
    def provenances(self) -> list[Mapping[str, Any]]:
        """Notes of the producers on each configuration, such as the length of its path."""
        return self._decoded("provenance")

    @cached_property
    def written(self) -> list[tuple[tuple[str, ...], ...]]:
        """The keys that each producer in turn wrote; configurations of a family share one object."""
        steps = (json.loads(text) if text else [] for text in self.table["steps"].to_pylist())
        known: dict[tuple[tuple[str, ...], ...], tuple[tuple[str, ...], ...]] = {}
        return [
            known.setdefault(keys, keys) for keys in (tuple(tuple(step["keys"]) for step in each) for each in steps)
        ]

    @cached_property
    def duplicates(self) -> dict[str, str]:
        """Names of originals by name of duplicate."""
        return {name: of for name, of in zip(self.names, self.duplicate_of, strict=True) if of}

    def __len__(self) -> int:
        return len(self.names)

    def rows(self) -> list[dict[str, Any]]:
        """The rows, JSON columns decoded, the scenario's name or content as `abstract` among them."""
        decoded = zip(self.table.to_pylist(), self.contents, self.factors, self.provenances, strict=True)
        return [
            row
            | {"scenario": content, "factors": factors, "provenance": provenance}
            | {"abstract": json.loads(row["abstract"]) if row["abstract"].startswith("{") else row["abstract"]}
            for row, content, factors, provenance in decoded
        ]

    def row(self, configuration: int) -> dict[str, Any]:
        """The row of the configuration at an index, as `scenario_of_row` takes it."""
        row: dict[str, Any] = self.table.slice(configuration, 1).to_pylist()[0]
        return row

    def _decoded(self, column: str) -> list[Mapping[str, Any]]:
        found: list[Mapping[str, Any]] = json.loads(f"[{','.join(self.table[column].to_pylist())}]")
        if len(found) != len(self) or not all(isinstance(each, dict) for each in found):
            raise ValueError(f"configurations.parquet: {column}: expected a JSON object in each row, got another text")
        return found


@dataclass(frozen=True, eq=False)
class MetricColumn:
    """One metric of one oracle.

    Attributes:
        values: (R,) over the runs of the table, NaN where it can't be had.
    """

    unit: str
    values: NDArray[np.float64] = field(repr=False)


class VerdictTable:
    """The verdicts of each oracle on each run, in columns.

    Args:
        table: The rows of `verdicts.parquet`.
        names: Configurations, in the order of which runs are sorted.
        file: The file, if metrics are read from it when they are asked for; None if `table` has them.

    Attributes:
        oracles: Names of the oracles in the order they judged.
        configuration: (R,) index into `names`, ascending.
        run_index: (R,) ascending within a configuration.
        judgments: (R, oracles) codes of judgments, `ABSENT` where an oracle was not asked.

    Raises:
        ValueError: a verdict of a configuration that there is not, or a judgment that is none.
    """

    def __init__(self, table: pa.Table, names: list[str], file: Path | None = None) -> None:
        self.table, self.names, self._file = table, tuple(names), file
        (said, judgments), (configuration, judged) = codes(table["judgment"]), codes(table["configuration"])
        places = {name: place for place, name in enumerate(names)}
        if unknown := {*judged} - {*names}:
            raise ValueError(f"verdicts.parquet judges {min(unknown)!r}, which is no row of configurations.parquet")
        if unknown := {*judgments} - {*CODES}:
            raise ValueError(f"verdicts.parquet has the judgment {min(unknown)!r}. It can be {', '.join(CODES)}")
        place = np.array([places[name] for name in judged], dtype=np.int64)[configuration]
        runs, of_run = np.unique(run_keys(place, integers(table["run_index"])), return_inverse=True)
        self._run = of_run.astype(np.int32)
        self.configuration, self.run_index = runs // _RUNS, runs % _RUNS
        oracle, oracles = codes(table["oracle"])
        self._oracle, self.oracles = oracle.astype(np.int16), tuple(oracles)
        code = np.array([CODES[text] for text in judgments], dtype=np.int8)  # type: ignore[index]
        self._said = code[said]
        self.judgments = np.full((len(runs), len(oracles)), ABSENT, dtype=np.int8)
        self.judgments[self._run, self._oracle] = self._said

    def __len__(self) -> int:
        return len(self.run_index)

    @cached_property
    def together(self) -> NDArray[np.int8]:
        """(R,) what all oracles say."""
        return together(self.judgments)

    def of(self, oracle: str | None) -> NDArray[np.int8]:
        """(R,) what one oracle says; all together where `oracle` is None."""
        return self.together if oracle is None else self.judgments[:, self.oracles.index(oracle)]

    def rows_of(self, configuration: int) -> slice:
        return slice(*np.searchsorted(self.configuration, (configuration, configuration + 1)))

    def counts(self, oracle: str | None) -> NDArray[np.int64]:
        """Counts (configurations, 3) of pass, fail, and not judged, of one oracle or all together."""
        cells = self.configuration * 4 + self.of(oracle)
        return np.bincount(cells, minlength=4 * len(self.names)).reshape(-1, 4)[:, :ABSENT]

    def reasons(self, judgment: Judgment) -> "pd.DataFrame":
        """The `configuration`, `oracle` and `reason`, as categories, and `run_index` of each verdict that is `judgment`."""
        import pandas as pd

        rows, (reason, reasons) = self._said == CODES[judgment], codes(self.table["reason"])
        found = {
            "configuration": (self.configuration[self._run[rows]], self.names),
            "oracle": (self._oracle[rows], self.oracles),
            "reason": (reason[rows], reasons),
        }
        columns = {name: pd.Categorical.from_codes(*column) for name, column in found.items()}
        return pd.DataFrame({**columns, "run_index": self.run_index[self._run[rows]]})

    def metrics(self, oracle: str) -> Mapping[str, MetricColumn]:
        """An oracle's metrics by name, in the order of their names in its verdicts.

        Raises:
            ValueError: metrics that are no JSON objects.
            Unreadable: the file is damaged.
        """
        return self._metrics[self.oracles.index(oracle)]

    @cached_property
    def _metrics(self) -> list[Mapping[str, MetricColumn]]:
        found: list[dict[str, MetricColumn]] = [{} for _ in self.oracles]
        start = 0
        for texts in self._texts():
            stop = start + len(texts)
            for oracle, metrics in enumerate(found):
                rows = np.flatnonzero(self._oracle[start:stop] == oracle)
                self._read_metrics(texts.take(pa.array(rows)).to_pylist(), self._run[start + rows], metrics)
            start = stop
        return list(found)

    def _texts(self) -> Iterator[pa.Array]:
        if self._file is not None:
            return text_batches(self._file, METRICS, _PARSED_ROWS)
        return (batch[0] for batch in self.table.select([METRICS]).to_batches(_PARSED_ROWS))

    def _read_metrics(self, lines: list[str], runs: NDArray[np.int32], found: dict[str, MetricColumn]) -> None:
        if all(line == "{}" for line in lines):  # of which pyarrow makes no rows
            return
        for line in lines:
            if len(line) > _MOST_UNCHECKED:
                json_value(line)
        content = "\n".join(lines).encode()
        options = pyarrow.json.ReadOptions(use_threads=False, block_size=len(content) + 1)
        columns = pyarrow.json.read_json(io.BytesIO(content), read_options=options)
        for name in columns.column_names:
            column = columns[name].combine_chunks()
            if not pa.types.is_struct(column.type):
                raise ValueError(f"verdicts.parquet: metric {name!r}: expected a value with a unit, got {column.type}")
            before = found.get(name) or MetricColumn("", np.full(len(self), np.nan))
            before.values[runs] = floats(pc.struct_field(column, "value"))
            units = pc.unique(pc.drop_null(pc.struct_field(column, "unit"))).to_pylist()
            found[name] = MetricColumn(units[-1] if units else before.unit, before.values)

    def rows(self) -> list[dict[str, Any]]:
        rows = self.table.to_pylist() if self._file is None else table_rows(self._file)
        return [{**row, METRICS: json.loads(row[METRICS])} for row in rows]


def together(said: NDArray[np.int8]) -> NDArray[np.int8]:
    """Joint judgments (R,) from those of oracles (R, oracles): `fail` if any, `pass` if all, else `not judged`."""
    passed = ((said == PASS) | (said == ABSENT)).all(axis=1) & (said == PASS).any(axis=1)
    return np.where((said == FAIL).any(axis=1), FAIL, np.where(passed, PASS, NOT_JUDGED)).astype(np.int8)


@dataclass(frozen=True, eq=False)
class Tables:
    """The tables of a campaign directory, in columns.

    Attributes:
        campaign: Text of the campaign file.
        runs: Without seeds and families.
    """

    directory: Path
    metadata: Mapping[str, Any]
    campaign: str = field(repr=False)
    configurations: ConfigurationTable = field(repr=False)
    rejections: list[dict[str, Any]] = field(repr=False)
    runs: pa.Table = field(repr=False)
    verdicts: VerdictTable = field(repr=False)

    @property
    def oracles(self) -> tuple[str, ...]:
        return self.verdicts.oracles

    @cached_property
    def driven(self) -> bool:
        """Whether nodes of ROS 2 drove the runs, so that no replay executes them."""
        return any("nodes" in (each.get("programs") or {}) for each in self.configurations.contents)

    @cached_property
    def units(self) -> Units:
        """Independent units of the configurations, in their order."""
        return units_of(self.configurations.contents)

    @cached_property
    def blocks(self) -> Mapping[str, int]:
        """Configuration to the number of its unit."""
        return dict(zip(self.configurations.names, self.units.codes.tolist(), strict=True))

    @cached_property
    def families(self) -> Mapping[str, list[str]]:
        """Family to the names of its configurations without duplicates."""
        found = self.configurations
        families: dict[str, list[str]] = {family: [] for family in found.families}
        for k in found.distinct:
            families[found.families[k]].append(found.names[k])
        return families


def read_verdicts(directory: Path, names: list[str]) -> VerdictTable:
    """Read the verdicts of a campaign directory with configurations `names`; metrics are read when they are asked for.

    Raises:
        Unreadable: the table is missing or damaged.
        ValueError: it does not suit `names`.
    """
    file = directory / "verdicts.parquet"
    verdicts = read_columns(file, "configuration", "oracle", "judgment", "reason", without=(METRICS, "family"))
    return VerdictTable(verdicts, names, file)


def read_tables(directory: Path) -> Tables:
    """Read the tables of the campaign directory `directory` (design §7).

    Raises:
        OSError: one is missing.
        ValueError: one is damaged.
    """
    configurations = ConfigurationTable(read_columns(directory / "configurations.parquet"))
    verdicts = read_verdicts(directory, configurations.names)
    metadata = read_json(directory / "metadata.json")
    if (
        not isinstance(metadata, dict)
        or not {"name", "created"} <= metadata.keys()
        or not isinstance(metadata.get("counts", {}), dict)
    ):
        raise ValueError("metadata.json is not what was written: no name, time or counts")
    return Tables(
        directory=directory,
        metadata=metadata,
        campaign=read_text(directory / "campaign.vast"),
        configurations=configurations,
        rejections=read_columns(directory / "rejections.parquet").to_pylist(),
        runs=read_columns(directory / "runs.parquet", "configuration", "outcome", "reason", without=("seed", "family")),
        verdicts=verdicts,
    )
