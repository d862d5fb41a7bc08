"""Does a population stay below what its surroundings can feed?"""

from collections.abc import Mapping
from typing import ClassVar

import numpy as np
from pydantic import Field

from vastflow.plugins import Oracle, OracleParameters, Situation, Trace, Verdict


class StaysBelowCapacityParameters(OracleParameters):
    """Parameters of `StaysBelowCapacity`.

    Attributes:
        capacity: The greatest population there may be.
        tolerance: Fraction of the capacity by which it may be exceeded.
    """

    capacity: float = Field(default=1000.0, gt=0)
    tolerance: float = Field(default=0.01, ge=0)


class StaysBelowCapacity(Oracle[StaysBelowCapacityParameters]):
    """Fails where the column `population` of the run's table `growth` was ever above the capacity.

    Metrics: `greatest` and `final`, the greatest and the last population (1); `time_of_greatest` (s).
    """

    Parameters = StaysBelowCapacityParameters
    metrics: ClassVar[Mapping[str, str]] = {"greatest": "1", "final": "1", "time_of_greatest": "s"}

    def judge(self, trace: Trace, situation: Situation) -> Verdict:
        table = trace.tables.get("growth")
        if table is None or not {"t_s", "population"} <= table.keys():
            return self.not_judged(trace, "the run wrote no growth.csv with the columns t_s and population")
        t_s, population = table["t_s"], table["population"]
        if not (len(population) and population.dtype.kind in "if" and t_s.dtype.kind in "if"):
            return self.not_judged(trace, "growth.csv has no rows of numbers")
        if (lost := np.flatnonzero(~np.isfinite(population))).size:
            return self.failed(trace, f"the population is {population[lost[0]]:g} at {t_s[lost[0]]:g} s")
        at = int(population.argmax())
        greatest, final = float(population[at]), float(population[-1])
        metrics = {"greatest": greatest, "final": final, "time_of_greatest": float(t_s[at])}
        capacity = self.parameters.capacity
        if greatest > capacity * (1.0 + self.parameters.tolerance):
            percent = 100.0 * (greatest / capacity - 1.0)
            return self.failed(trace, f"{greatest:.0f}, {percent:.0f} % above the capacity of {capacity:g}", **metrics)
        return self.passed(trace, **metrics)
