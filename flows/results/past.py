"""The past: an earlier campaign directory, as far as it tells what has changed since."""

import json
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Any

import pyarrow.parquet as pq

from vastflow.flows.request.asked import asked_of
from vastflow.sim.files import read_json

PARTS = ("environment", "task", "system")


class NoPast(ValueError):
    """A folder that is no campaign directory, or a damaged one; says what was found."""


def recorded_as(row: Mapping[str, Any]) -> str:
    """The digest that stands for a configuration's scenario in keys; earlier versions had that of what was written."""
    digest: str = row.get("checked_digest") or row["scenario_digest"]
    return digest


@dataclass(frozen=True)
class Past:
    """A campaign directory.

    Attributes:
        metadata: Its `metadata.json`.
    """

    directory: Path
    metadata: Mapping[str, Any] = field(repr=False)

    @cached_property
    def rows(self) -> list[dict[str, Any]]:
        """Rows of `configurations.parquet`, JSON columns as text."""
        return _rows(self.directory / "configurations.parquet")

    @cached_property
    def by_name(self) -> Mapping[str, dict[str, Any]]:
        """Configuration to its row."""
        return {row["name"]: row for row in self.rows}

    @cached_property
    def by_digest(self) -> Mapping[str, dict[str, Any]]:
        """Digest of a scenario to the row of the configuration that was run."""
        return {row["scenario_digest"]: row for row in self.rows if row["duplicate_of"] is None}

    @cached_property
    def recorded(self) -> frozenset[tuple[str, int]]:
        """Configuration and index of every run that was recorded."""
        rows = _rows(self.directory / "runs.parquet", "configuration", "run_index")
        return frozenset((row["configuration"], row["run_index"]) for row in rows)

    @property
    def runs(self) -> int:
        """Runs that were asked of each configuration, at most where they end by a rule."""
        return asked_of(self.metadata).runs

    def runs_of(self, name: str) -> int:
        """Runs that were wanted of a configuration that is no duplicate."""
        return self._wanted.get(name, 0) if asked_of(self.metadata).sequential else self.runs

    @cached_property
    def _wanted(self) -> Mapping[str, int]:
        rows = _rows(self.directory / "verdicts.parquet", "configuration", "run_index")
        wanted: dict[str, int] = {}
        for row in rows:
            wanted[row["configuration"]] = max(wanted.get(row["configuration"], 0), row["run_index"] + 1)
        return wanted

    def check(self) -> None:
        """Read all that is asked later.

        Raises:
            NoPast: something is missing or damaged.
        """
        try:
            _ = self.by_digest, self.recorded, self.metadata["name"], self.metadata["created"], self.runs
        except (OSError, ValueError, KeyError, TypeError, ArithmeticError) as error:
            words = " ".join(str(error).split())
            raise NoPast(f"{self.directory}: damaged campaign directory: {words}") from None


def past_of(directory: Path) -> Past:
    """The campaign of a directory.

    Raises:
        NoPast: it can't be read.
    """
    try:
        metadata = read_json(directory / "metadata.json")
    except (OSError, ValueError) as error:
        raise NoPast(f"{directory}: damaged campaign directory: {error}") from None
    past = Past(directory, metadata)
    past.check()
    return past


def newest_past(results: Path, name: str, before: str | None = None) -> Past | None:
    """The newest campaign of this name in a folder of campaign directories; damaged ones are passed over.

    Args:
        name: The campaign's.
        before: Only those that began before this time, in ISO form.
    """
    for directory in _newest_first(results, name, before):
        try:
            return past_of(directory)
        except NoPast:
            continue
    return None


def _newest_first(results: Path, name: str, before: str | None) -> Sequence[Path]:
    found = []
    for file in results.glob("[!.]*/metadata.json"):
        try:
            metadata = read_json(file)
            if metadata["name"] == name and (before is None or metadata["created"] < before):
                found.append((metadata["created"], file.stat().st_mtime_ns, file.parent))
        except (OSError, ValueError, KeyError, TypeError):
            continue
    return [directory for _, _, directory in sorted(found, reverse=True)]


def contents(row: Mapping[str, Any]) -> dict[str, dict[str, Any]]:
    """The three dimensions of a row's scenario, and `programs`, decoded."""
    content: dict[str, dict[str, Any]] = json.loads(row["scenario"])
    return content


def values_of(row: Mapping[str, Any]) -> dict[str, Any]:
    """All that was written of a configuration, provenance included: key to plain value."""
    parts = contents(row)
    return {**{key: value for part in PARTS for key, value in parts[part].items()}, **json.loads(row["provenance"])}


def _rows(file: Path, *columns: str) -> list[dict[str, Any]]:
    rows: list[dict[str, Any]] = pq.ParquetFile(file).read(columns=list(columns) or None).to_pylist()
    return rows


def writers(row: Mapping[str, Any]) -> dict[str, str]:
    """Key to the producer that wrote it last; what the campaign file fixes is not in it."""
    return {key: step["producer"] for step in json.loads(row.get("steps") or "[]") for key in step["keys"]}


def value_changes(then: Any, now: Any, path: str = "") -> Iterator[tuple[str, Any, Any]]:
    """Path, old and new value of all that differs in two plain values; None for what is not there.

    Mappings are compared key by key, lists of as many mappings one by one, everything else as a whole.
    """
    if isinstance(then, Mapping) and isinstance(now, Mapping) and "file" not in then and "file" not in now:
        for key in dict.fromkeys([*then, *now]):
            yield from value_changes(then.get(key), now.get(key), f"{path}.{key}" if path else str(key))
    elif _of_mappings(then) and _of_mappings(now) and len(then) == len(now):
        for k, (old, new) in enumerate(zip(then, now, strict=True)):
            yield from value_changes(old, new, f"{path}[{k}]")
    elif then != now or type(then) is not type(now):
        yield path, then, now


def _of_mappings(value: Any) -> bool:
    return isinstance(value, list) and all(isinstance(item, Mapping) for item in value)
