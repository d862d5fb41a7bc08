"""The behaviors of a campaign directory's runs: what the scenario of each did, by configuration."""

from functools import cached_property
from pathlib import Path
from typing import Any, Final

import pyarrow as pa
import pyarrow.compute as pc
from numpy.typing import NDArray

from vastflow.oracles.results.column import RowGroups, read_columns
from vastflow.sim.model.archive import columns_of

BEHAVIORS_FILE: Final = "behaviors.parquet"
CONFIGURATION: Final = "configuration"


class Behaviors:
    """Reads `behaviors.parquet`, or a file for each configuration as earlier versions wrote them.

    Reading raises `Unreadable` where the file is damaged.
    """

    def __init__(self, directory: Path) -> None:
        self._directory = directory
        self._last: tuple[int, pa.Table] | None = None

    def of(self, configuration: str) -> dict[str, NDArray[Any]]:
        """Columns of a configuration's behaviors, `run_index` among them; empty where no run was recorded."""
        own = self._directory / "behaviors" / f"{configuration}.parquet"
        if own.is_file():
            return columns_of(read_columns(own))
        if configuration not in self._groups:
            return {}
        parts = [self._group(group) for group in self._groups[configuration]]
        rows = pa.concat_tables([part.filter(pc.equal(part.column(CONFIGURATION), configuration)) for part in parts])
        return columns_of(rows.drop_columns([CONFIGURATION]))

    @cached_property
    def _file(self) -> RowGroups:
        return RowGroups(self._directory / BEHAVIORS_FILE)

    @cached_property
    def _groups(self) -> dict[str, list[int]]:
        """Configuration to the row groups that have rows of it."""
        found: dict[str, list[int]] = {}
        if (self._directory / BEHAVIORS_FILE).is_file():
            for group in range(len(self._file)):
                names = self._file.read(group, CONFIGURATION).column(0).unique()
                for name in names.to_pylist():
                    found.setdefault(name, []).append(group)
        return found

    def _group(self, group: int) -> pa.Table:
        """A row group; the last one is kept, for configurations are mostly asked for in order."""
        if self._last is None or self._last[0] != group:
            self._last = group, self._file.read(group)
        return self._last[1]
