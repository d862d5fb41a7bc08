"""What a search found, and how sure it is: of its best point the runs that it never used."""

import math
from collections.abc import Mapping
from typing import Any

from vastflow.oracles.statistics.intervals import clopper_pearson_intervals, interval


def found_text(said: Mapping[str, Any]) -> str:
    """The best of a search in a sentence, such as `found at 90 %, confirmed at 71 % [58, 82] on 60 fresh runs`.

    The interval of a rate is Clopper and Pearson's at 95 %, of the fresh runs alone.
    """
    if (best := said["best"]) is None:
        return "No point was judged."
    is_rate = said["is_rate"]
    found = (
        f"{best['configuration']}: {said['objective'].replace('_', ' ')} found at {_shown(best['objective'], is_rate)}"
    )
    confirmed = said["confirmation"]
    if confirmed is None:
        return f"{found} on {best['runs']} runs; not confirmed."
    samples = confirmed["samples"]
    if not samples:
        return f"{found}; none of {confirmed['runs']} fresh runs gives it."
    mean = math.fsum(samples) / len(samples)
    if not is_rate:
        return f"{found}; the mean of {len(samples)} fresh runs is {_shown(mean, is_rate)}."
    bounds = interval(clopper_pearson_intervals(sum(samples), len(samples)))
    low, high = math.floor(100 * bounds.low), math.ceil(100 * bounds.high)
    return f"{found}, confirmed at {_shown(mean, is_rate)} [{low}, {high}] on {len(samples)} fresh runs."


def _shown(value: float, is_rate: bool) -> str:
    return f"{100 * value:.0f} %" if is_rate else f"{value:.3g}"
