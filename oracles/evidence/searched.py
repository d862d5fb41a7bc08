"""The best point of a search, confirmed by fresh runs."""

import math
from collections.abc import Iterator, Mapping
from typing import Any

from vastflow.oracles.statistics.intervals import clopper_pearson_intervals, interval


def found_text(said: Mapping[str, Any]) -> str:
    """Words for the best point: `found at 90 %, confirmed at 71 % [58, 82] on 60 fresh runs`.

    The interval is Clopper and Pearson's at 95 %, of the fresh runs alone. A baseline adds the number of runs that either needed.
    """
    if said["best"] is None:
        return "No point was judged."
    return " ".join([_best_text(said), *_baseline_text(said)])


def _best_text(said: Mapping[str, Any]) -> str:
    best = said["best"]
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


def _baseline_text(said: Mapping[str, Any]) -> Iterator[str]:
    if (beside := said.get("baseline")) is None:
        return
    found, best = f"Found after {beside['runs_until_best']} runs", beside["best"]
    if beside["runs_until_as_good"] is not None:
        yield f"{found}, by {beside['strategy']} search after {beside['runs_until_as_good']}."
    elif best is None:
        yield f"{found}; no point of {beside['strategy']} search was judged."
    else:
        at = _shown(best["objective"], said["is_rate"])
        yield f"{found}; {beside['strategy']} search comes to {at} in {beside['runs']} runs."


def _shown(value: float, is_rate: bool) -> str:
    return f"{100 * value:.0f} %" if is_rate else f"{value:.3g}"
