"""The verdicts of a campaign as arrays over runs and oracles."""

import json
from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property
from typing import TYPE_CHECKING, Any, Final

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc
from numpy.typing import NDArray

from vastflow.oracles.judgement.verdict import Judgement
from vastflow.oracles.results.column import codes, floats, integers, parsed, taken, texts

if TYPE_CHECKING:
    import pandas as pd

CODES: Final[Mapping[Judgement, int]] = {"pass": 0, "fail": 1, "not judged": 2}
ABSENT: Final = 3
"""Code of a run that an oracle says nothing of."""
PASS, FAIL, NOT_JUDGED = CODES.values()
_RUNS: Final = 1 << 31


@dataclass(frozen=True, eq=False)
class MetricColumn:
    """One metric of one oracle.

    Attributes:
        values: (R,) over the runs of the table, NaN where it can't be had.
    """

    unit: str
    values: NDArray[np.float64] = field(repr=False)


@dataclass(frozen=True, eq=False)
class VerdictTable:
    """The verdicts of each oracle on each run.

    Attributes:
        table: The rows of `verdicts.parquet`.
        names: Configurations, in the order of which runs are sorted.
    """

    table: pa.Table = field(repr=False)
    names: tuple[str, ...] = field(repr=False)

    @cached_property
    def oracles(self) -> tuple[str, ...]:
        """Names of the oracles in the order they judged."""
        return tuple(self._oracle[1])

    @cached_property
    def configuration(self) -> NDArray[np.int64]:
        """(R,) index into `names`, ascending."""
        return self._runs[0] // _RUNS

    @cached_property
    def run_index(self) -> NDArray[np.int64]:
        """(R,) ascending within a configuration."""
        return self._runs[0] % _RUNS

    def __len__(self) -> int:
        return len(self._runs[0])

    @cached_property
    def judgements(self) -> NDArray[np.int8]:
        """(R, oracles) codes of judgements, `ABSENT` where an oracle was not asked."""
        found, known = codes(self.table["judgement"])
        code = np.array([CODES[text] for text in known], dtype=np.int8)  # type: ignore[index]
        grid = np.full((len(self), len(self.oracles)), ABSENT, dtype=np.int8)
        grid[self._runs[1], self._oracle[0]] = code[found] if len(code) else found
        return grid

    @cached_property
    def together(self) -> NDArray[np.int8]:
        """(R,) what all oracles say: `fail` if one does, `pass` if all do, else `not judged`."""
        said = self.judgements
        passed = ((said == PASS) | (said == ABSENT)).all(axis=1)
        return np.where((said == FAIL).any(axis=1), FAIL, np.where(passed, PASS, NOT_JUDGED)).astype(np.int8)

    def of(self, oracle: str | None) -> NDArray[np.int8]:
        """(R,) what one oracle says; all together where `oracle` is None."""
        return self.together if oracle is None else self.judgements[:, self.oracles.index(oracle)]

    def counts(self, oracle: str | None) -> NDArray[np.int64]:
        """(configurations, 3) how often one oracle, or all together, said pass, fail and not judged."""
        cells = self.configuration * 4 + self.of(oracle)
        return np.bincount(cells, minlength=4 * len(self.names)).reshape(-1, 4)[:, :ABSENT]

    def reasons(self, judgement: Judgement) -> "pd.DataFrame":
        """The `configuration`, `oracle` and `reason` of each verdict that is `judgement`, as categories."""
        import pandas as pd

        rows = self._said == CODES[judgement]
        found = {
            "configuration": (self.configuration[self._runs[1][rows]], self.names),
            "oracle": (self._oracle[0][rows], self.oracles),
            "reason": (self._reason[0][rows], self._reason[1]),
        }
        return pd.DataFrame({name: pd.Categorical.from_codes(*column) for name, column in found.items()})

    def metrics(self, oracle: str) -> Mapping[str, MetricColumn]:
        """An oracle's metrics by name, in the order of their names in its verdicts."""
        if oracle not in self._metrics:
            self._metrics[oracle] = self._parsed(oracle)
        return self._metrics[oracle]

    @cached_property
    def _metrics(self) -> dict[str, Mapping[str, MetricColumn]]:
        """By oracle, those that were asked for."""
        return {}

    def _parsed(self, oracle: str) -> Mapping[str, MetricColumn]:
        mine = self._oracle[0] == self.oracles.index(oracle)
        content = parsed(taken(self.table["metrics"], mine))
        runs = self._runs[1][mine]
        metrics = {}
        for name in content.column_names:
            column = content[name].combine_chunks()
            values = np.full(len(self), np.nan)
            values[runs] = floats(pc.struct_field(column, "value"))
            units = pc.unique(pc.drop_null(pc.struct_field(column, "unit"))).to_pylist()
            metrics[name] = MetricColumn(units[-1] if units else "", values)
        return metrics

    def rows(self) -> list[dict[str, Any]]:
        """The rows, metrics decoded."""
        return [{**row, "metrics": json.loads(row["metrics"])} for row in self.table.to_pylist()]

    @cached_property
    def _said(self) -> NDArray[np.int8]:
        return self.judgements[self._runs[1], self._oracle[0]]

    @cached_property
    def _oracle(self) -> tuple[NDArray[np.int64], list[str]]:
        return codes(self.table["oracle"])

    @cached_property
    def _reason(self) -> tuple[NDArray[np.int64], list[str]]:
        return codes(self.table["reason"])

    @cached_property
    def _runs(self) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
        """(R,) keys of the runs, ascending, and (rows,) the run that each row is of."""
        found, known = codes(self.table["configuration"])
        places = {name: place for place, name in enumerate(self.names)}
        place = np.array([places[name] for name in known], dtype=np.int64)
        keys = (place[found] if len(place) else found) * _RUNS + integers(self.table["run_index"])
        return np.unique(keys, return_inverse=True)


def verdict_table(table: pa.Table, names: list[str]) -> VerdictTable:
    """The verdicts of the configurations `names`.

    Raises:
        ValueError: a verdict of a configuration that there is not, or a judgement that is none.
    """
    if unknown := {*texts(pc.unique(table["configuration"]))} - {*names}:
        raise ValueError(f"verdicts.parquet judges {min(unknown)!r}, which is no row of configurations.parquet")
    if unknown := {*texts(pc.unique(table["judgement"]))} - {*CODES}:
        raise ValueError(f"verdicts.parquet has the judgement {min(unknown)!r}; it can be {', '.join(CODES)}")
    return VerdictTable(table, tuple(names))
