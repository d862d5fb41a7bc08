"""Facts that the sections of a report show: the tables of a campaign directory, and what follows from them."""

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any

import pandas as pd

from vastflow.oracles.evidence.causes import CauseCount, causes_of
from vastflow.oracles.evidence.criteria import MEASURES_ALONE, Criterion, criteria_of
from vastflow.oracles.evidence.evidence import Evidence, Spread, evidence_of, spreads_of
from vastflow.oracles.evidence.findings import Findings, findings_of, stopping_rule
from vastflow.oracles.evidence.rates import Counts
from vastflow.oracles.evidence.standstills import Standstills, standstills_of
from vastflow.oracles.evidence.varied import named
from vastflow.oracles.figures.scene import Scene, scenes_of
from vastflow.oracles.page.words import short
from vastflow.oracles.results.executed import KeptFiles, environment_names
from vastflow.oracles.results.tables import Tables
from vastflow.oracles.statistics.classes import runs_for_a_claim


@dataclass(frozen=True, eq=False)
class Facts:
    """What the sections of a report show.

    Attributes:
        names: Of maps, by digest.
        evidence: Of each oracle; under None that of all together.
    """

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
        """All oracles together."""
        return self.evidence[None]

    @property
    def all(self) -> Counts:
        """All runs."""
        return self.everything.campaign.counts

    @cached_property
    def shown_oracles(self) -> list[str | None]:
        """All together and each oracle that can fail a run; all together alone where there is but one."""
        judging = [oracle for oracle in self.evidence if oracle not in MEASURES_ALONE]
        return judging if len(judging) > 2 else [None]

    @property
    def several(self) -> bool:
        """Whether several oracles can fail a run."""
        return len(self.shown_oracles) > 1

    @property
    def noun(self) -> str:
        """What a situation is called."""
        return "path" if any(self.tables.configurations.environments) else "situation"

    @property
    def maps(self) -> int:
        """How many maps there are."""
        return len({*self.tables.configurations.environments} - {None})

    @property
    def most_runs(self) -> int:
        """Judged runs of the configuration that has most of them."""
        return int(self.findings.counts[:, :2].sum(axis=1).max(initial=0))

    @cached_property
    def least_runs(self) -> int:
        """Runs that a class takes at least; 0 where a rule ends runs as soon as one is shown."""
        rule = stopping_rule(self.metadata)
        return 0 if rule is not None and rule.decidable else min(runs_for_a_claim().values())

    @cached_property
    def failures(self) -> pd.DataFrame:
        """Who failed runs, and why."""
        return self.tables.verdicts.reasons("fail")

    @cached_property
    def files(self) -> KeptFiles:
        """Files of the campaign directory."""
        return KeptFiles(self.tables.directory)

    @cached_property
    def varied(self) -> dict[str, bool]:
        """Keys whose value is not the same in every configuration, and whether all their values are numbers."""
        values: dict[str, set[str]] = {}
        numeric: dict[str, bool] = {}
        present: Counter[str] = Counter()
        for factors in self.tables.configurations.factors:
            present.update(factors.keys())
            for key, value in factors.items():
                values.setdefault(key, set()).add(repr(value))
                is_number = isinstance(value, int | float) and not isinstance(value, bool)
                numeric[key] = numeric.get(key, True) and is_number
        everywhere = len(self.tables.configurations)
        return {key: numeric[key] for key, seen in values.items() if len(seen) > 1 or present[key] < everywhere}

    def factor(self, configuration: int, key: str) -> str:
        """A value of the configuration at an index, as a cell of a table; empty where it has none."""
        factors = self.tables.configurations.factors[configuration]
        return short(named(factors[key], self.names)) if key in factors else ""


def facts_of(tables: Tables) -> Facts:
    """The facts of a campaign directory."""
    names = environment_names(tables.directory, dict.fromkeys(filter(None, tables.configurations.environments)))
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
