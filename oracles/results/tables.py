"""The tables of a campaign directory, as evidence and report read them."""

import json
from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray

from vastflow.oracles.results.column import read_columns, texts
from vastflow.oracles.results.factors import blocks_of
from vastflow.oracles.results.verdict_table import VerdictTable, verdict_table
from vastflow.sim.model.files import read_json, read_text


@dataclass(frozen=True, eq=False)
class ConfigurationTable:
    """The rows of `configurations.parquet`; JSON columns are decoded when they are asked for.

    Attributes:
        names, families: In the order of the campaign file.
        duplicate_of: Name of the configuration of the same content, which alone was run; None without one.
        environments: Digests of maps, None for a scenario without a map.
    """

    table: pa.Table = field(repr=False)

    @cached_property
    def names(self) -> list[str]:
        return texts(self.table["name"])

    @cached_property
    def families(self) -> list[str]:
        return texts(self.table["family"])

    @cached_property
    def duplicate_of(self) -> list[str | None]:
        return texts(self.table["duplicate_of"])

    @cached_property
    def environments(self) -> list[str | None]:
        return texts(self.table["environment"])

    @cached_property
    def distinct(self) -> NDArray[np.int64]:
        """Indices of the configurations that are no duplicates."""
        return np.flatnonzero([name is None for name in self.duplicate_of])

    @cached_property
    def factors(self) -> list[Mapping[str, Any]]:
        """Values that file and producers gave to each configuration."""
        return self._decoded("factors")

    @cached_property
    def abstracts(self) -> list[str | Mapping[str, Any]]:
        """Scenario name of each, or the decoded content of a scenario file."""
        return [json.loads(text) if text.startswith("{") else text for text in texts(self.table["abstract"])]

    @cached_property
    def contents(self) -> list[Mapping[str, Any]]:
        """Environment, task, system and programs of each."""
        return self._decoded("scenario")

    @cached_property
    def provenances(self) -> list[Mapping[str, Any]]:
        """Notes of the producers on each configuration, such as the length of its path."""
        return self._decoded("provenance")

    @cached_property
    def steps(self) -> list[list[Mapping[str, Any]]]:
        """Name as `producer` and written `keys` of each producer in turn."""
        return [json.loads(text) if text else [] for text in texts(self.table["steps"])]

    def __len__(self) -> int:
        return len(self.names)

    def rows(self) -> list[dict[str, Any]]:
        """The rows, JSON columns decoded."""
        rows: list[dict[str, Any]] = self.table.to_pylist()
        decoded = zip(rows, self.abstracts, self.contents, self.factors, self.provenances, strict=True)
        for row, abstract, content, factors, provenance in decoded:
            row |= {"abstract": abstract, "scenario": content, "factors": factors, "provenance": provenance}
        return rows

    def _decoded(self, column: str) -> list[Mapping[str, Any]]:
        found: list[Mapping[str, Any]] = json.loads(f"[{','.join(texts(self.table[column]))}]")
        return found


@dataclass(frozen=True, eq=False)
class Tables:
    """The tables of a campaign directory, in columns; `campaign` is the text of the campaign file."""

    directory: Path
    metadata: Mapping[str, Any]
    campaign: str = field(repr=False)
    configurations: ConfigurationTable = field(repr=False)
    rejections: list[dict[str, Any]] = field(repr=False)
    runs: pa.Table = field(repr=False)
    verdicts: VerdictTable = field(repr=False)

    @property
    def oracles(self) -> tuple[str, ...]:
        """Names of the oracles in the order they judged."""
        return self.verdicts.oracles

    @cached_property
    def blocks(self) -> Mapping[str, int]:
        """Configuration to block number, see `blocks_of`."""
        found = self.configurations
        return dict(zip(found.names, blocks_of(found.contents).tolist(), strict=True))

    @cached_property
    def families(self) -> Mapping[str, list[str]]:
        """Family to the names of its configurations without duplicates."""
        families: dict[str, list[str]] = {}
        found = self.configurations
        for name, family, duplicate_of in zip(found.names, found.families, found.duplicate_of, strict=True):
            of_family = families.setdefault(family, [])
            if duplicate_of is None:
                of_family.append(name)
        return families


def read_tables(directory: Path) -> Tables:
    """Read the tables of the campaign directory `directory` (design §7).

    Raises:
        OSError: one is missing.
        ValueError: one is damaged.
    """
    configurations = ConfigurationTable(read_columns(directory / "configurations.parquet"))
    verdicts = read_columns(directory / "verdicts.parquet", "configuration", "family", "oracle", "judgement", "reason")
    return Tables(
        directory=directory,
        metadata=_metadata(directory / "metadata.json"),
        campaign=read_text(directory / "campaign.vast"),
        configurations=configurations,
        rejections=read_columns(directory / "rejections.parquet").to_pylist(),
        runs=read_columns(directory / "runs.parquet", "configuration", "family", "outcome", "reason"),
        verdicts=verdict_table(verdicts, configurations.names),
    )


def _metadata(file: Path) -> Mapping[str, Any]:
    found = read_json(file)
    if (
        not isinstance(found, dict)
        or not {"name", "created"} <= found.keys()
        or not isinstance(found.get("counts", {}), dict)
    ):
        raise ValueError(f"{file.name} is not what was written: no name, time or counts")
    return found
