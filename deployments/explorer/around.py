"""The runs around a run: those of its configuration, and the failed ones before and after it."""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TypeAlias

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc
import pyarrow.parquet as pq

from vastflow.oracles.judgement.verdict import Judgement
from vastflow.oracles.results.tables import FAIL, JUDGEMENTS, read_verdicts
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
        rows = pq.ParquetFile(directory / "configurations.parquet").read(columns=["name", "duplicate_of"])
        name = configuration_row(directory, rows, configuration)["duplicate_of"] or configuration
        names: list[str] = rows["name"].to_pylist()
        verdicts = read_verdicts(directory, names)
    own, said = verdicts.rows_of(names.index(name)), verdicts.together
    known = verdicts.run_index[own].tolist()
    if run_index not in known:
        numbers = f"0 to {known[-1]}" if known else "of which it has none"
        raise UnusableDirectory(f"{directory.name}: {name}: expected the number of a run, {numbers}, got {run_index}")

    def place(row: int) -> RunPlace:
        return names[verdicts.configuration[row]], int(verdicts.run_index[row])

    failed, here = np.flatnonzero(said == FAIL), own.start + known.index(run_index)
    before, after = ([*map(place, some.tolist())] for some in (failed[failed < here][-1:], failed[failed > here][:1]))
    runs = dict(zip(known, (JUDGEMENTS[code] for code in said[own].tolist()), strict=True))
    return Around(next(iter(before), None), next(iter(after), None), runs)


def configuration_row(directory: Path, table: pa.Table, configuration: str) -> dict[str, Any]:
    """Return the row of a configuration; raises `UnusableDirectory` if there is none."""
    found: list[dict[str, Any]] = table.filter(pc.field("name") == configuration).to_pylist()
    if not found:
        hint = did_you_mean(configuration, table["name"].to_pylist(), "it has none", listed="it has")
        raise UnusableDirectory(f"{directory.name}: no configuration {configuration!r}; {hint}")
    return found[0]
