"""Facts of a report: the tables of a campaign directory and their evidence."""

from collections.abc import Mapping
from dataclasses import replace
from functools import cached_property
from typing import Any, Final

import numpy as np
import pandas as pd

from vastflow.oracles.evidence.causes import MEASURES_ALONE, causes_of, criteria_of, standstills_of
from vastflow.oracles.evidence.evidence import evidence_of, spreads_of
from vastflow.oracles.evidence.findings import findings_of, stopping_rule
from vastflow.oracles.evidence.varied import named
from vastflow.oracles.figures.drawing import Before
from vastflow.oracles.page.words import position, short
from vastflow.oracles.query.scene import scenes_of
from vastflow.oracles.results.executed import KeptFiles, environment_names
from vastflow.oracles.results.tables import Tables
from vastflow.oracles.statistics.classes import ClassName, runs_for_a_claim
from vastflow.oracles.statistics.intervals import thousandths

_PLACES: Final = 3
"""Places listed of a map."""


class Facts:
    """Facts of a report on a campaign directory.

    Attributes:
        names: Names of maps by digest.
        evidence: By oracle, or None for all together, which `everything` and, for all runs, `all` are of.
        spreads: Spreads of each oracle's metrics.
        shown_oracles: None for all together, and each that can fail a run if there are several.
        units, noun: Independent units of the configurations, and what one is called.
        maps: Number of maps.
        before: Gives drawings of earlier reports.
        most_runs: Largest number of judged runs of a configuration.
    """

    def __init__(self, tables: Tables, before: Before = lambda key: None) -> None:
        self.tables, self.before = tables, before
        self.metadata: Mapping[str, Any] = tables.metadata
        self.names = environment_names(tables.directory, tables.configurations.environments)
        self.files = KeptFiles(tables.directory)
        self.findings = findings_of(tables, self.names)
        if self.metadata.get("search"):  # its strategy chose points by results: that tells nothing of factors
            self.findings = replace(self.findings, designs=())
        self.evidence = evidence_of(tables)
        self.everything = self.evidence[None]
        self.all = self.everything.campaign.counts
        self.spreads = spreads_of(tables)
        self.stood, self.causes = standstills_of(tables), causes_of(tables)
        self.criteria = criteria_of(tables)
        self.scenes = scenes_of(tables)
        judging = [oracle for oracle in self.evidence if oracle not in MEASURES_ALONE]
        self.shown_oracles = judging if len(judging) > 2 else [None]
        self.several = len(self.shown_oracles) > 1
        self.units, self.noun = tables.units, tables.units.noun
        self.maps = len({*tables.configurations.environments} - {None})
        self.most_runs = int(self.findings.counts[:, :2].sum(axis=1).max(initial=0))

    @cached_property
    def class_needs(self) -> Mapping[ClassName, int]:
        """Smallest number of runs that can show each class; none with a stopping rule that can show one."""
        rule = stopping_rule(self.metadata)
        return {} if rule is not None and rule.decidable else runs_for_a_claim()

    @cached_property
    def failures(self) -> pd.DataFrame:
        """Configuration, oracle, and reason of each failure."""
        return self.tables.verdicts.reasons("fail")

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
                    (x0, y0), cell_m = found.grid.origin_xy_m, found.grid.cell_m
                    place = position(x0 + (column + 0.5) * cell_m, y0 + (row + 0.5) * cell_m)
                    n, failed = int(found.visits[row, column]), int(found.failures[row, column])
                    ends = thousandths(intervals[row, column]).tolist()
                    rows.append([name, place, [failed, n, 0, *ends, failed / n]])
        return sorted(rows, key=lambda row: -row[2][0] / row[2][1])

    def factor(self, configuration: int, key: str) -> str:
        """A value of a configuration as a table cell, empty for a missing one."""
        factors = self.tables.configurations.factors[configuration]
        return short(named(factors[key], self.names)) if key in factors else ""
