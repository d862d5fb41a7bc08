"""The tables of a campaign directory, as evidence and report read them."""

import json
from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Any

import pyarrow.parquet as pq

from vastflow.oracles.rates import Counts, counts_of
from vastflow.oracles.verdict import Judgement, run_judgement

RunKey = tuple[str, int]
"""Configuration and run index."""


@dataclass(frozen=True)
class Tables:
    """What stands in a campaign directory.

    Attributes:
        configurations, rejections, runs, verdicts: Rows of the parquet files, JSON columns decoded.
        metadata: `metadata.json`.
        campaign: The text of the campaign file.
    """

    directory: Path
    metadata: Mapping[str, Any]
    campaign: str = field(repr=False)
    configurations: list[dict[str, Any]] = field(repr=False)
    rejections: list[dict[str, Any]] = field(repr=False)
    runs: list[dict[str, Any]] = field(repr=False)
    verdicts: list[dict[str, Any]] = field(repr=False)

    @cached_property
    def oracles(self) -> tuple[str, ...]:
        """Names of the oracles in the order they judged."""
        return tuple(dict.fromkeys(row["oracle"] for row in self.verdicts))

    @cached_property
    def families(self) -> Mapping[str, list[str]]:
        """Family to the names of its configurations; those that duplicate another are left out, their family is not."""
        families: dict[str, list[str]] = {}
        for row in self.configurations:
            members = families.setdefault(row["family"], [])
            if row["duplicate_of"] is None:
                members.append(row["name"])
        return families

    @cached_property
    def judgements(self) -> Mapping[RunKey, Judgement]:
        """What all oracles together say of each run."""
        said: dict[RunKey, list[Judgement]] = {}
        for row in self.verdicts:
            said.setdefault((row["configuration"], row["run_index"]), []).append(row["judgement"])
        return {key: run_judgement(judgements) for key, judgements in said.items()}

    def counts(self, oracle: str | None) -> Mapping[str, Counts]:
        """Configuration to its counts by one oracle; by all together where `oracle` is None."""
        said: dict[str, list[Judgement]] = {}
        if oracle is None:
            for (configuration, _), judgement in self.judgements.items():
                said.setdefault(configuration, []).append(judgement)
        else:
            for row in self.verdicts:
                if row["oracle"] == oracle:
                    said.setdefault(row["configuration"], []).append(row["judgement"])
        return {configuration: counts_of(judgements) for configuration, judgements in said.items()}


def read_tables(directory: Path) -> Tables:
    """Read the tables of the campaign directory `directory` (design §7)."""
    return Tables(
        directory=directory,
        metadata=json.loads((directory / "metadata.json").read_text(encoding="utf-8")),
        campaign=(directory / "campaign.vast").read_text(encoding="utf-8"),
        configurations=_rows(directory / "configurations.parquet", "scenario", "factors", "provenance"),
        rejections=_rows(directory / "rejections.parquet", "requested", "inputs"),
        runs=_rows(directory / "runs.parquet"),
        verdicts=_rows(directory / "verdicts.parquet", "metrics"),
    )


def _rows(file: Path, *json_columns: str) -> list[dict[str, Any]]:
    rows: list[dict[str, Any]] = pq.ParquetFile(file).read().to_pylist()  # pq.read_table imports 0.1 s more
    for row in rows:
        for column in json_columns:
            row[column] = json.loads(row[column])
        if str(row.get("abstract", "")).startswith("{"):  # of a scenario file, and not a name
            row["abstract"] = json.loads(row["abstract"])
    return rows
