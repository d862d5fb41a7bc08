"""The tables of a campaign directory, as evidence and report read them."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Any

import pyarrow as pa

from vastflow.oracles.directory.column import read_columns
from vastflow.oracles.directory.configuration_table import ConfigurationTable
from vastflow.oracles.directory.verdict_table import VerdictTable, verdict_table
from vastflow.oracles.statistics.factors import blocks_of
from vastflow.sim.model.files import read_json, read_text


@dataclass(frozen=True, eq=False)
class Tables:
    """What stands in a campaign directory, in columns: a campaign can have a hundred thousand runs.

    Attributes:
        metadata: `metadata.json`.
        campaign: The text of the campaign file.
        rejections: Rows of `rejections.parquet`, `requested` and `inputs` as JSON text.
        runs: `runs.parquet`.
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
        """Names of the oracles in the order they judged."""
        return self.verdicts.oracles

    @cached_property
    def blocks(self) -> Mapping[str, int]:
        """Configuration to the number of its block: equal for those on one map with one task, see `blocks_of`."""
        found = self.configurations
        return dict(zip(found.names, blocks_of(found.contents).tolist(), strict=True))

    @cached_property
    def families(self) -> Mapping[str, list[str]]:
        """Family to the names of its configurations; those that duplicate another are left out, their family is not."""
        families: dict[str, list[str]] = {}
        found = self.configurations
        for name, family, duplicate_of in zip(found.names, found.families, found.duplicate_of, strict=True):
            members = families.setdefault(family, [])
            if duplicate_of is None:
                members.append(name)
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
