"""The best point of a search, confirmed by fresh runs."""

import math
from collections.abc import Mapping
from typing import Any

from vastflow.oracles.statistics.intervals import clopper_pearson_intervals


def found_text(said: Mapping[str, Any]) -> str:
    """Words for the best point: `found at 90 %, confirmed at 71 % [58, 82] on 60 fresh runs`.

    The interval is Clopper and Pearson's at 95 %, of the fresh runs alone. A baseline adds the number of runs that either needed.
    """
    if (best := said["best"]) is None:
        return "No point was judged."
    is_rate, confirmed, beside = said["is_rate"], said["confirmation"], said.get("baseline")
    objective = said["objective"].replace("_", " ")
    found = f"{best['configuration']}: {objective} found at {_shown(best['objective'], is_rate)}"
    samples = confirmed["samples"] if confirmed else []
    mean = math.fsum(samples) / max(len(samples), 1)
    if confirmed is None:
        found += f" on {best['runs']} runs; not confirmed."
    elif not samples:
        found += f"; none of {confirmed['runs']} fresh runs gives it."
    elif is_rate:
        low, high = clopper_pearson_intervals(sum(samples), len(samples)).tolist()
        ends = f"[{math.floor(100 * low)}, {math.ceil(100 * high)}]"
        found += f", confirmed at {_shown(mean, is_rate)} {ends} on {len(samples)} fresh runs."
    else:
        found += f"; the mean of {len(samples)} fresh runs is {_shown(mean, is_rate)}."
    if beside is None:
        return found
    found += f" Found after {beside['runs_until_best']} runs"
    if beside["runs_until_as_good"] is not None:
        return f"{found}, by {beside['strategy']} search after {beside['runs_until_as_good']}."
    if beside["best"] is None:
        return f"{found}; no point of {beside['strategy']} search was judged."
    at = _shown(beside["best"]["objective"], is_rate)
    return f"{found}; {beside['strategy']} search comes to {at} in {beside['runs']} runs."


def _shown(value: float, is_rate: bool) -> str:
    return f"{100 * value:.0f} %" if is_rate else f"{value:.3g}"
