"""Opened campaigns: their tables in memory, a few at a time, read anew when a file changes."""

import threading
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Any, Final, TypeAlias

import numpy as np
import pyarrow as pa

from vastflow.deployments.explorer.directories import CampaignDirectory, Directories
from vastflow.deployments.explorer.facets import Facets
from vastflow.deployments.explorer.selection import WIDE_FILE, RunTable, read_run_table
from vastflow.deployments.explorer.trajectories import Trajectories
from vastflow.oracles.results.schema import table_rows
from vastflow.oracles.results.tables import FAIL
from vastflow.oracles.results.unusable import UnusableDirectory, reading

Stamp: TypeAlias = tuple[tuple[int, int, int], ...]

_KEPT: Final = 2
_CONFIGURATIONS: Final = "configurations.parquet"
_FILES: Final = ("metadata.json", _CONFIGURATIONS, "runs.parquet", "verdicts.parquet", WIDE_FILE)
_MAP_COLUMN: Final = "map_file"


@dataclass(frozen=True, eq=False)
class Campaign:
    """A campaign directory's runs, ready for requests.

    Attributes:
        trajectories: With the environment of each of the table's configurations.
    """

    directory: CampaignDirectory
    stamp: Stamp
    table: RunTable = field(repr=False)
    facets: Facets = field(repr=False)
    trajectories: Trajectories = field(repr=False)

    @cached_property
    def maps(self) -> list[dict[str, Any]]:
        """Environments with the name of their map and the numbers of their runs, most failures first."""
        table, names = self.table, self.table.columns.get(_MAP_COLUMN)
        of = self.trajectories.environments[table.configuration]
        found = []
        for environment in np.unique(of[of != ""]).tolist():
            runs = np.flatnonzero(of == environment)
            known = (
                names.levels[names.values[runs[0]]] if names and names.levels and names.values[runs[0]] >= 0 else None
            )
            failed = int((table.verdict[runs] == FAIL).sum())
            found.append({"id": environment, "name": known or environment[:8], "runs": len(runs), "failed": failed})
        return sorted(found, key=lambda each: -each["failed"])


class OpenedCampaigns:
    """The campaigns that were asked for last."""

    def __init__(self, directories: Directories) -> None:
        self._directories = directories
        self._opened: dict[str, Campaign] = {}
        self._lock = threading.Lock()

    def find(self, id: str) -> CampaignDirectory:
        """Return a campaign's directory; raises `NoSuchCampaign`."""
        return self._directories.find(id)

    def of(self, id: str) -> Campaign:
        """Return a campaign with its tables.

        Raises:
            NoSuchCampaign: there is none.
            UnusableDirectory: it has no runs yet, or a table is damaged.
        """
        directory = self.find(id)
        with self._lock:
            stamp = _stamp(directory.path)
            known = self._opened.pop(id, None)
            if known is None or (known.stamp, known.directory.path) != (stamp, directory.path):
                if known is not None:
                    known.trajectories.close()
                known = _opened(directory, stamp)
            self._opened[id] = known
            if len(self._opened) > _KEPT:
                self._opened.pop(next(iter(self._opened))).trajectories.close()
            return known


def _opened(directory: CampaignDirectory, stamp: Stamp) -> Campaign:
    path = directory.path
    if not (path / _CONFIGURATIONS).is_file():
        words = "it is still running" if directory.state == "running" else "its tables were not written"
        raise UnusableDirectory(f"{path.name}: expected the tables of a finished campaign, but {words}")
    with reading(path):
        table = read_run_table(path)
        rows = table_rows(path / _CONFIGURATIONS, "name", "environment")
        environments = {row["name"]: row["environment"] for row in rows}
        trajectories = Trajectories(path, table, [environments.get(name) for name in table.configurations])
        pa.default_memory_pool().release_unused()
        return Campaign(directory, stamp, table, Facets(table), trajectories)


def _stamp(path: Path) -> Stamp:
    """Return size, time, and number of each table's file; zeros for one that is missing."""
    found = []
    for name in _FILES:
        try:
            status = (path / name).stat()
            found.append((status.st_size, status.st_mtime_ns, status.st_ino))
        except OSError:
            found.append((0, 0, 0))
    return tuple(found)
