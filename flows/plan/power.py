"""Power of a planned campaign to show effects of its factors."""

from collections.abc import Iterator
from dataclasses import asdict, dataclass
from typing import Any, Final

import pyarrow as pa

from vastflow.flows.plan.plan import Plan
from vastflow.flows.results.tables import configuration_row
from vastflow.oracles.evidence.findings import by_varying_keys
from vastflow.oracles.evidence.varied import chosen_rows
from vastflow.oracles.page.words import plural
from vastflow.oracles.results.factors import factors_of
from vastflow.oracles.results.schema import CONFIGURATIONS
from vastflow.oracles.results.tables import ConfigurationTable
from vastflow.oracles.results.units import Units, units_of
from vastflow.oracles.statistics.power import Power, power_of

MOST: Final = 5000
"""Configurations up to which a plan tells it: larger campaigns show any effect of interest, and reading them takes seconds."""


@dataclass(frozen=True, slots=True)
class PlannedPower:
    """The power of a test of factors with as many levels, in families where the same things vary.

    Attributes:
        runs: Of each situation at each level.
    """

    families: tuple[str, ...]
    factors: tuple[str, ...]
    units: Units
    situations: int
    levels: int
    runs: int
    power: Power

    @property
    def json(self) -> dict[str, Any]:
        return {**asdict(self), "units": self.units.noun}

    def __str__(self) -> str:
        these, others = (
            "nothing" if each is None else f"{100 * each:.0f} points" for each in (self.power.these, self.power.others)
        )
        return (
            f"{', '.join(self.families)}: {plural(self.situations, self.units.noun)} with {plural(self.runs, 'run')} at each of "
            f"{self.levels} levels show, in 8 of 10 campaigns, an effect of {these} on these {self.units.noun}s and {others} for other "
            f"{self.units.others}: {', '.join(self.factors)}"
        )


def planned_power(plan: Plan) -> Iterator[PlannedPower]:
    """The least effects on the failure rate that a campaign of this size shows; nothing above `MOST` configurations."""
    distinct, runs = plan.distinct, plan.least or plan.runs
    if len(distinct) > MOST:
        return
    table = ConfigurationTable(pa.Table.from_pylist([*map(configuration_row, distinct)], CONFIGURATIONS))
    units = units_of(table.contents)
    for places in by_varying_keys(table).values():
        codes = units.codes[places]
        situations = len(set(codes.tolist()))
        factors = [
            factor
            for factor in factors_of(chosen_rows(table, places, {}))[0]
            if len(set(zip(codes.tolist(), factor.codes.tolist(), strict=True))) > situations
        ]
        families = tuple(dict.fromkeys(table.families[k] for k in places))
        for levels in sorted({len(factor.levels) for factor in factors}):
            names = tuple(factor.name for factor in factors if len(factor.levels) == levels)
            cell = max(1, round(runs * len(places) / (situations * levels)))
            power = power_of(situations, levels, cell, len(factors))
            yield PlannedPower(families, names, units, situations, levels, cell, power)
