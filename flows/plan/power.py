"""Power of a planned campaign to show effects of its factors."""

from collections.abc import Iterator
from dataclasses import asdict
from typing import Any, Final

import pyarrow as pa

from vastflow.flows.plan.plan import Plan
from vastflow.flows.results.tables import configuration_row
from vastflow.oracles.evidence.findings import by_varying_keys
from vastflow.oracles.evidence.varied import chosen_rows
from vastflow.oracles.page.words import plural, power_text
from vastflow.oracles.results.factors import factors_of
from vastflow.oracles.results.schema import CONFIGURATIONS
from vastflow.oracles.results.tables import ConfigurationTable
from vastflow.oracles.results.units import units_of
from vastflow.oracles.statistics.power import power_of

MOST: Final = 5000
"""Configurations up to which a plan tells it: larger campaigns show any effect of interest, and reading them takes seconds."""


def planned_power(plan: Plan) -> Iterator[dict[str, Any]]:
    """Least effects on the failure rate that a campaign of this size shows; none above `MOST` configurations.

    A row is of factors with as many levels, in families where the same things vary; its `runs` are those of a situation at a level.
    """
    if len(distinct := plan.distinct) > MOST:
        return
    table = ConfigurationTable(pa.Table.from_pylist([*map(configuration_row, distinct)], CONFIGURATIONS))
    units = units_of(table.contents)
    for places in by_varying_keys(table).values():
        codes = units.codes[places].tolist()
        situations, families = len(set(codes)), [*dict.fromkeys(table.families[k] for k in places)]
        varied = factors_of(chosen_rows(table, places, {}))[0]
        within = [each for each in varied if len(set(zip(codes, each.codes.tolist(), strict=True))) > situations]
        for levels in sorted({len(each.levels) for each in within}):
            names = [each.name for each in within if len(each.levels) == levels]
            runs = max(1, round((plan.least or plan.runs) * len(places) / (situations * levels)))
            power = power_of(situations, levels, runs, len(within))
            size = f"{plural(situations, units.noun)}, with {plural(runs, 'run')} at each of {levels} levels of {', '.join(names)}"
            yield {
                "text": f"{', '.join(families)}: {size}. {power_text(power, units)}",
                "families": families,
                "factors": names,
                "units": units.noun,
                "situations": situations,
                "levels": levels,
                "runs": runs,
                "power": asdict(power),
            }
