"""Opened campaigns: their tables in memory, a few at a time."""

import threading
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import dataclass, field
from functools import cached_property, lru_cache
from typing import TYPE_CHECKING, Any, Final

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray

from vastflow.deployments.explorer.directories import CampaignDirectory, Directories
from vastflow.deployments.explorer.trajectories import Reading
from vastflow.flows.request.run_request import SEARCH, SEQUENTIAL
from vastflow.oracles.query.facets import Facets
from vastflow.oracles.query.selection import WIDE_FILE, Runs, RunTable, read_run_table
from vastflow.oracles.results.schema import table_rows
from vastflow.oracles.results.tables import FAIL, read_verdicts
from vastflow.oracles.results.unusable import DAMAGE, UnusableDirectory, reading
from vastflow.sim.model.files import is_inside, read_json

if TYPE_CHECKING:
    import pandas as pd

_KEPT: Final = 2
_CONFIGURATIONS: Final = "configurations.parquet"
_MAP_COLUMNS: Final = ("map_file", "world")


@dataclass(frozen=True, eq=False)
class Campaign:
    """A campaign directory's runs, ready for requests.

    Attributes:
        environments: (configurations,) digest of each configuration's map, empty without one.
    """

    directory: CampaignDirectory
    table: RunTable = field(repr=False)
    facets: Facets = field(repr=False)
    environments: NDArray[np.str_] = field(repr=False)
    _readings: dict[str, Reading] = field(default_factory=dict, init=False, repr=False)
    _lock: threading.Lock = field(default_factory=threading.Lock, init=False, repr=False)

    def reading(self, environment: str, wait_s: float) -> Reading:
        """Return the paths of an environment, whose reading begins with the first call; wait at most `wait_s` for all."""
        with self._lock:
            if (found := self._readings.get(environment)) is None:
                of = np.flatnonzero(self.environments == environment)
                found = self._readings[environment] = Reading(self.directory.path, self.table, environment, of)
                found.start()
        found.join(wait_s)
        return found

    @cached_property
    def evidence(self) -> tuple[list[str], Mapping[str, str]]:
        """The sentences with which the report opens, and the class of each configuration; empty where it tells none."""
        file = self.directory.path / "evidence.json"
        with suppress(*DAMAGE):
            found = read_json(file) if is_inside(file, self.directory.path) else {}
            said, classes = found.get("findings") or [], (found.get("classes") or {}).get("configurations") or {}
            return [*map(str, said)], {name: each for name, each in classes.items() if isinstance(each, str)}
        return [], {}

    @cached_property
    def failures(self) -> "pd.DataFrame":
        """Each failed verdict as `VerdictTable.reasons` has it, and the `row` of its run in `table`; raises as `read_verdicts`."""
        import pandas as pd  # takes a third of a second

        table, names = self.table, np.array(self.table.configurations, dtype=object)
        of_run = {
            "configuration": names[table.configuration],
            "run_index": table.run_index,
            "row": np.arange(len(table)),
        }
        every = [row["name"] for row in table_rows(self.directory.path / _CONFIGURATIONS, "name")]
        found = read_verdicts(self.directory.path, every).reasons("fail")
        return found.merge(pd.DataFrame(of_run), on=["configuration", "run_index"])

    @cached_property
    def maps(self) -> list[dict[str, Any]]:
        """Environments with the name of their map or world, and the numbers of their runs, most failures first."""
        table, of = self.table, self.environments[self.table.configuration]
        found = []
        for environment in np.unique(of[of != ""]).tolist():
            runs = np.flatnonzero(of == environment)
            named = (table.value(column, runs[0]) for column in _MAP_COLUMNS)
            name = next((each for each in named if each), environment[:8])
            failed = int((table.verdict[runs] == FAIL).sum())
            found.append({"id": environment, "name": name, "runs": len(runs), "failed": failed})
        return sorted(found, key=lambda each: -each["failed"])


class OpenedCampaigns:
    """The campaigns that were asked for last."""

    def __init__(self, directories: Directories) -> None:
        self.find = directories.find
        self._opened = lru_cache(_KEPT)(_opened)
        self._locks: dict[str, threading.Lock] = {}

    def of(self, id: str) -> Campaign:
        """Return a campaign with its tables, which are read anew when their file is another.

        Raises:
            NoSuchCampaign: there is none.
            UnusableDirectory: it has no runs yet, or a table is damaged.
        """
        directory = self.find(id)
        file = directory.path / WIDE_FILE
        with self._locks.setdefault(
            id, threading.Lock()
        ):  # two requests for one page read it once, and others don't wait
            return self._opened(directory, file.stat().st_mtime_ns if file.is_file() else None)


def _opened(directory: CampaignDirectory, written_ns: int | None) -> Campaign:
    """Read a campaign; `written_ns`, the time of its table, tells the cache that it is another."""
    path = directory.path
    if not (path / _CONFIGURATIONS).is_file():
        words = "it is still running" if directory.state == "running" else "its tables were not written"
        raise UnusableDirectory(f"{path.name}: expected the tables of a finished campaign, but {words}")
    with reading(path):
        said = directory.metadata
        runs: Runs = "searched" if said.get(SEARCH) else "sequential" if said.get(SEQUENTIAL) else "fixed"
        table = read_run_table(path, runs)
        rows = table_rows(path / _CONFIGURATIONS, "name", "environment")
        environments = {row["name"]: row["environment"] or "" for row in rows}
        pa.default_memory_pool().release_unused()
        of_table = np.array([environments.get(name, "") for name in table.configurations], dtype=np.str_)
        return Campaign(directory, table, Facets(table), of_table)
