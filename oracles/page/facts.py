"""Facts of a report: the tables of a campaign directory and their evidence."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any, Final

import numpy as np
import pandas as pd

from vastflow.oracles.evidence.causes import CauseCount, Standstills, causes_of, standstills_of
from vastflow.oracles.evidence.criteria import MEASURES_ALONE, Criterion, criteria_of
from vastflow.oracles.evidence.evidence import Evidence, Spread, evidence_of, spreads_of
from vastflow.oracles.evidence.findings import Findings, findings_of, stopping_rule
from vastflow.oracles.evidence.rates import Counts
from vastflow.oracles.evidence.varied import named
from vastflow.oracles.figures.scene import Scene, scenes_of
from vastflow.oracles.page.words import position, short
from vastflow.oracles.results.executed import KeptFiles, environment_names
from vastflow.oracles.results.tables import Tables
from vastflow.oracles.statistics.classes import runs_for_a_claim
from vastflow.oracles.statistics.intervals import thousandths

_PLACES: Final = 3
"""Places listed of a map."""


@dataclass(frozen=True, eq=False)
class Facts:
    """Facts of a report: `names` of maps by digest, `evidence` by oracle or None for all."""

    tables: Tables
    names: Mapping[str, str]
    evidence: Mapping[str | None, Evidence]
    findings: Findings
    spreads: Mapping[str, Mapping[str, Spread]] = field(repr=False)
    stood: Standstills
    causes: tuple[CauseCount, ...]
    criteria: list[Criterion]
    scenes: Sequence[Scene]

    @property
    def metadata(self) -> Mapping[str, Any]:
        """`metadata.json`."""
        return self.tables.metadata

    @property
    def everything(self) -> Evidence:
        """Evidence of all oracles together."""
        return self.evidence[None]

    @property
    def all(self) -> Counts:
        """Judgements on all runs."""
        return self.everything.campaign.counts

    @cached_property
    def shown_oracles(self) -> list[str | None]:
        """All oracles together as None, and each that can fail a run if there are several."""
        judging = [oracle for oracle in self.evidence if oracle not in MEASURES_ALONE]
        return judging if len(judging) > 2 else [None]

    @property
    def several(self) -> bool:
        """Whether several oracles can fail a run."""
        return len(self.shown_oracles) > 1

    @property
    def noun(self) -> str:
        """Name of a situation: path or situation."""
        return "path" if any(self.tables.configurations.environments) else "situation"

    @property
    def maps(self) -> int:
        """Number of maps."""
        return len({*self.tables.configurations.environments} - {None})

    @property
    def most_runs(self) -> int:
        """Largest number of judged runs of a configuration."""
        return int(self.findings.counts[:, :2].sum(axis=1).max(initial=0))

    @cached_property
    def least_runs(self) -> int:
        """Smallest number of runs that can show a class; 0 with a stopping rule that can show one."""
        rule = stopping_rule(self.metadata)
        return 0 if rule is not None and rule.decidable else min(runs_for_a_claim().values())

    @cached_property
    def failures(self) -> pd.DataFrame:
        """Configuration, oracle, and reason of each failure."""
        return self.tables.verdicts.reasons("fail")

    @cached_property
    def files(self) -> KeptFiles:
        """Files of the campaign directory."""
        return KeptFiles(self.tables.directory)

    @cached_property
    def varied(self) -> dict[str, bool]:
        """Varying keys, and whether all their values are numbers."""
        factors = self.tables.configurations.factors
        values: dict[str, list[Any]] = {}
        for each in factors:
            for key, value in each.items():
                values.setdefault(key, []).append(value)
        return {
            key: all(isinstance(value, int | float) and not isinstance(value, bool) for value in seen)
            for key, seen in values.items()
            if len(seen) < len(factors) or len({repr(value) for value in seen}) > 1
        }

    @cached_property
    def places(self) -> list[list[Any]]:
        """Map, place, and rate cell of places that fail more than their map, the worst first, without neighbors."""
        rows: list[list[Any]] = []
        for scene in self.scenes:
            found, name = scene.failures, self.names[scene.environment]
            rate, intervals = found.rate(), found.intervals()
            taken: list[tuple[int, int]] = []
            for row, column in sorted(map(tuple, np.argwhere(found.hot()).tolist()), key=lambda at: -rate[at]):
                if len(taken) < _PLACES and all(abs(row - r) > 4 or abs(column - c) > 4 for r, c in taken):
                    taken.append((row, column))
                    x, y = (
                        low + (k + 0.5) * found.grid.cell_m
                        for low, k in zip(found.grid.origin_xy_m, (column, row), strict=True)
                    )
                    n, failed = int(found.visits[row, column]), int(found.failures[row, column])
                    rows.append([name, position(x, y), [failed, n, 0, *thousandths(intervals[row, column]).tolist()]])
        return sorted(rows, key=lambda row: -row[2][0] / row[2][1])

    def factor(self, configuration: int, key: str) -> str:
        """A value of a configuration as a table cell, empty for a missing one."""
        factors = self.tables.configurations.factors[configuration]
        return short(named(factors[key], self.names)) if key in factors else ""


def facts_of(tables: Tables) -> Facts:
    """The facts of a campaign directory."""
    names = environment_names(tables.directory, tables.configurations.environments)
    findings = findings_of(tables, names)
    if tables.metadata.get("search"):  # its strategy chose points by what others came to: that tells nothing of factors
        findings = replace(findings, designs=())
    return Facts(
        tables,
        names,
        evidence_of(tables),
        findings,
        spreads_of(tables),
        standstills_of(tables),
        causes_of(tables),
        criteria_of(tables),
        scenes_of(tables),
    )
