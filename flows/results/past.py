"""The past: the validated parts of an earlier campaign directory that show what has changed."""

import json
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Any

from vastflow.flows.request.run_request import asked_of
from vastflow.flows.results.provenance import STAGES, evaluation_ingredients, stage_ingredients
from vastflow.oracles.results.schema import table_rows
from vastflow.oracles.results.unusable import UnusableDirectory, reading
from vastflow.sim.model.files import read_json

PARTS = ("environment", "task", "system")


@dataclass(frozen=True)
class Past:
    """A campaign directory with its `metadata.json`."""

    directory: Path
    metadata: Mapping[str, Any] = field(repr=False)

    @cached_property
    def rows(self) -> list[dict[str, Any]]:
        """Rows of `configurations.parquet`, JSON columns as text."""
        return table_rows(self.directory / "configurations.parquet")

    @cached_property
    def by_name(self) -> Mapping[str, dict[str, Any]]:
        """Configuration to its row."""
        return {row["name"]: row for row in self.rows}

    @cached_property
    def by_digest(self) -> Mapping[str, dict[str, Any]]:
        """Digest of a scenario as it is written to the row of the configuration that was run."""
        return {row["scenario_digest"]: row for row in self.rows if row["duplicate_of"] is None}

    @cached_property
    def by_key(self) -> Mapping[str, dict[str, Any]]:
        """The digest that stands for a scenario in keys to the row of the configuration that was run."""
        return {row["checked_digest"]: row for row in self.rows if row["duplicate_of"] is None}

    @cached_property
    def recorded(self) -> frozenset[tuple[str, int]]:
        """Configuration and index of every run that was recorded."""
        return frozenset((row["configuration"], row["run_index"]) for row in self._runs("runs.parquet"))

    @property
    def runs(self) -> int:
        """See `Asked.runs`."""
        return asked_of(self.metadata).runs

    def runs_of(self, name: str) -> int:
        """Runs that were wanted of a configuration that is no duplicate."""
        return self.wanted.get(name, 0) if asked_of(self.metadata).sequential else self.runs

    @cached_property
    def wanted(self) -> Mapping[str, int]:
        """Configuration to the runs that were wanted of it, where they ended by a rule."""
        wanted: dict[str, int] = {}
        for row in self._runs("verdicts.parquet"):
            wanted[row["configuration"]] = max(wanted.get(row["configuration"], 0), row["run_index"] + 1)
        return wanted

    def _runs(self, file: str) -> list[dict[str, Any]]:
        return table_rows(self.directory / file, "configuration", "run_index")


def past_of(directory: Path) -> Past:
    """Read a campaign directory, or raise `UnusableDirectory`.

    All that is asked later is asked once, so that nothing else can be damaged then.
    """
    with reading(directory):
        past = Past(directory, read_json(directory / "metadata.json"))
        metadata = past.metadata
        for part in metadata["code"].values():
            _ = {**part["files"], **part["libraries"]}
        for stage in STAGES:
            stage_ingredients(metadata, stage)
        for each in [each for family in metadata["producers"].values() for each in family]:
            evaluation_ingredients(metadata, each)
        for row in past.rows:
            _ = (
                values_of(row),
                ", ".join(writers(row).values()),
                row["family"],
                row["scenario_digest"],
                row["duplicate_of"],
            )
        _ = metadata["name"], metadata["created"], past.by_key, past.recorded, [*asked_of(metadata).only]
        _ = past.wanted if asked_of(metadata).sequential else None
    return past


def newest_past(results: Path, name: str) -> Past | None:
    """The newest campaign of this name in a folder of campaign directories; damaged ones are passed over."""
    found = []
    for file in results.glob("[!.]*/metadata.json"):
        with suppress(OSError, ValueError, KeyError, TypeError):
            metadata = read_json(file)
            if metadata["name"] == name:
                found.append((str(metadata["created"]), file.stat().st_mtime_ns, file.parent))
    for _, _, directory in sorted(found, reverse=True):
        with suppress(UnusableDirectory):
            return past_of(directory)
    return None


def written_scenario(row: Mapping[str, Any]) -> dict[str, Any]:
    """Return the decoded dimensions and programs of a row's configuration."""
    said = {"abstract scenario": row["abstract"], "execution.timeout": row["timeout_s"]}
    return {**said, **json.loads(row["scenario"])}


def values_of(row: Mapping[str, Any]) -> dict[str, Any]:
    """Return everything recorded of a configuration, provenance included: key to plain value."""
    parts = written_scenario(row)
    return {**{key: value for part in PARTS for key, value in parts[part].items()}, **json.loads(row["provenance"])}


def writers(row: Mapping[str, Any]) -> dict[str, str]:
    """Map each key to the producer that wrote it last; fixed parameters are left out."""
    return {key: step["producer"] for step in json.loads(row["steps"]) for key in step["keys"]}
