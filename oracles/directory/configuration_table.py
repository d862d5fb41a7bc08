"""The configurations of a campaign directory as columns."""

import json
from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray

from vastflow.oracles.directory.column import texts


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
        """Indices of the configurations that duplicate no other."""
        return np.flatnonzero([name is None for name in self.duplicate_of])

    @cached_property
    def factors(self) -> list[Mapping[str, Any]]:
        """What the producers and the file gave to each."""
        return self._decoded("factors")

    @cached_property
    def abstracts(self) -> list[str | Mapping[str, Any]]:
        """Name of each one's scenario, or of a scenario file what `vastflow.oracles.directory.executed` takes."""
        return [json.loads(text) if text.startswith("{") else text for text in texts(self.table["abstract"])]

    @cached_property
    def contents(self) -> list[Mapping[str, Any]]:
        """Environment, task, system and programs of each one's scenario."""
        return self._decoded("scenario")

    @cached_property
    def provenances(self) -> list[Mapping[str, Any]]:
        """What producers noted of each one's making: the path that was drawn, its length."""
        return self._decoded("provenance")

    @cached_property
    def steps(self) -> list[list[Mapping[str, Any]]]:
        """Of each producer in turn: its name as `producer`, and the `keys` that it wrote."""
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
