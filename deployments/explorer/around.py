"""The runs around a run: those of its configuration, and the failed ones before and after it."""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TypeAlias

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc
import pyarrow.parquet as pq

from vastflow.oracles.judgement.verdict import Judgement, run_judgement
from vastflow.oracles.results.schema import integers
from vastflow.oracles.results.tables import run_keys
from vastflow.oracles.results.unusable import UnusableDirectory, reading
from vastflow.sim.model.names import did_you_mean

RunPlace: TypeAlias = tuple[str, int]
"""Configuration and run index."""


@dataclass(frozen=True, slots=True)
class Around:
    """The runs around a run.

    Attributes:
        before, after: The failed runs before and after it, in the order of the configurations; None where there is none.
        runs: Run index to joint judgement, for all runs of its configuration.
    """

    before: RunPlace | None
    after: RunPlace | None
    runs: Mapping[int, Judgement]


def around_run(directory: Path, configuration: str, run_index: int) -> Around:
    """Return the runs around one.

    Raises:
        UnusableDirectory: a missing or damaged table, or an unknown configuration or run.
    """
    with reading(directory.name):
        file = pq.ParquetFile(directory / "verdicts.parquet", read_dictionary=["configuration", "judgement"])
        verdicts = file.read(columns=["configuration", "run_index", "judgement"])
        rows = pq.ParquetFile(directory / "configurations.parquet").read(columns=["name", "duplicate_of"])
        row = configuration_row(directory, rows, configuration)
        name = row["duplicate_of"] or configuration
        said: dict[int, list[Judgement]] = {}
        for each in verdicts.filter(pc.field("configuration") == name).to_pylist():
            said.setdefault(each["run_index"], []).append(each["judgement"])
        if run_index not in said:
            known = f"0 to {max(said)}" if said else "of which it has none"
            raise UnusableDirectory(f"{directory.name}: {name}: expected the number of a run, {known}, got {run_index}")
        failed = verdicts.filter(pc.field("judgement") == "fail")
        names = rows["name"].combine_chunks()
        places = integers(pc.index_in(pc.cast(failed["configuration"], pa.string()), value_set=names))
        keys, first = np.unique(run_keys(places, integers(failed["run_index"])), return_index=True)
        here = run_keys(np.array([pc.index(names, name).as_py()]), np.array([run_index]))[0]

    def at(k: int) -> RunPlace | None:
        if not 0 <= k < len(keys):
            return None
        return failed["configuration"][int(first[k])].as_py(), failed["run_index"][int(first[k])].as_py()

    before, after = at(int(np.searchsorted(keys, here)) - 1), at(int(np.searchsorted(keys, here, side="right")))
    return Around(before, after, {run: run_judgement(said[run]) for run in sorted(said)})


def configuration_row(directory: Path, table: pa.Table, configuration: str) -> dict[str, Any]:
    """Return the row of a configuration; raises `UnusableDirectory` if there is none."""
    found: list[dict[str, Any]] = table.filter(pc.field("name") == configuration).to_pylist()
    if not found:
        hint = did_you_mean(configuration, table["name"].to_pylist(), "it has none", listed="it has")
        raise UnusableDirectory(f"{directory.name}: no configuration {configuration!r}; {hint}")
    return found[0]
