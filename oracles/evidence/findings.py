"""Findings: statistics of a campaign beyond its rates."""

import math
from collections.abc import Iterator, Mapping
from dataclasses import asdict, dataclass, field
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from vastflow.oracles.evidence.varied import chosen_rows, chosen_values, matched_sets, path_property_rows
from vastflow.oracles.judgment.registry import SUCCESS
from vastflow.oracles.results.factors import factors_of
from vastflow.oracles.results.tables import FAIL, PASS, ConfigurationTable, Tables
from vastflow.oracles.statistics.analysis import FactorAnalysis, factor_analysis
from vastflow.oracles.statistics.classes import (
    ClassBounds,
    Classes,
    StoppingRule,
    TotalFailures,
    classes_by,
    classify,
    total_failures,
)
from vastflow.oracles.statistics.dispersion import Dispersion, chance_of_at_least, dispersion
from vastflow.oracles.statistics.intervals import clopper_pearson_intervals
from vastflow.oracles.statistics.looks import Looks
from vastflow.oracles.statistics.measured import MetricEffect, Runs, metric_effects

STOPPING: Final = "sequential"
"""Key of the stopping rule in `metadata.json`: `min`, `max`, and optionally `error`, `systematic`, `reliable`."""


@dataclass(frozen=True, eq=False)
class Design:
    """The analysis of configurations with the same varying keys.

    Attributes:
        families: Families of these configurations; a family can be in several designs.
        metrics: Effects on what is measured of runs that reached their goals.
        alone, lacking: Keys that some other design lacks, or has in addition.
    """

    families: tuple[str, ...]
    analysis: FactorAnalysis
    metrics: tuple[MetricEffect, ...] = ()
    alone: tuple[str, ...] = ()
    lacking: tuple[str, ...] = ()

    @property
    def matters(self) -> bool:
        """Whether an effect of any factor or pair on the failure rate is shown."""
        found = self.analysis
        return any(each.matters for each in found.factors) or any(each.claim.shown for each in found.interactions)


@dataclass(frozen=True, eq=False)
class Findings:
    """Statistics of the verdicts of all oracles together.

    Attributes:
        names: The m distinct configurations.
        counts: (m, 3) passed, failed, and unjudged runs.
        dispersion: None where nothing was judged.
        saved: Runs done, and the most that a stopping rule allows; None for a fixed number of runs.
        reliable_chance: (m,) probability of being reliable, see `chance_of_at_least`.
    """

    names: tuple[str, ...] = field(repr=False)
    counts: NDArray[np.int64] = field(repr=False)
    classes: Classes
    total_failures: TotalFailures
    dispersion: Dispersion | None
    designs: tuple[Design, ...]
    saved: Mapping[str, int] | None
    reliable_chance: NDArray[np.float64] = field(repr=False)

    @property
    def undecided(self) -> list[int]:
        """Indices in `names` of the configurations without a class, the likeliest to be reliable first."""
        places = [k for k, name in enumerate(self.classes.names) if name == "undecided"]
        return sorted(places, key=lambda k: (-self.reliable_chance[k], k))


def findings_of(tables: Tables, environments: Mapping[str, str] | None = None) -> Findings:
    """The findings of a campaign; `environments` are names of maps by digest."""
    found = tables.configurations
    names = [found.names[k] for k in found.distinct]
    counts = tables.verdicts.counts(None)[found.distinct]
    passed, judged = counts[:, 0], counts[:, 0] + counts[:, 1]
    rule = stopping_rule(tables.metadata)
    spread = dispersion(passed, judged)
    bound = (rule.bounds if rule is not None else ClassBounds()).reliable
    return Findings(
        tuple(names),
        counts,
        classify(passed, judged) if rule is None else classes_by(rule, passed, judged),
        total_failures(passed, judged),
        spread,
        tuple(_designs(tables, passed, judged, environments or {})),
        None if rule is None else {"runs": int(counts.sum()), "most": len(names) * rule.max_runs},
        chance_of_at_least(bound, passed, judged, spread),
    )


def shape_of(findings: Findings) -> dict[str, int]:
    """Numbers of configurations that always passed, always failed, or did both."""
    passed, failed = findings.counts[:, 0], findings.counts[:, 1]
    always, never = int(((passed > 0) & (failed == 0)).sum()), int(((failed > 0) & (passed == 0)).sum())
    return {"always": always, "never": never, "mixed": int(((passed > 0) & (failed > 0)).sum())}


def stopping_rule(metadata: Mapping[str, Any]) -> StoppingRule | None:
    """The stopping rule of a campaign; None for a fixed number of runs."""
    said = metadata.get(STOPPING)
    if not said:
        return None
    usual = ClassBounds()
    bounds = ClassBounds(said.get("systematic", usual.systematic), said.get("reliable", usual.reliable))
    return StoppingRule(said["min"], said["max"], bounds, said.get("error", 0.05))


def looks_of(metadata: Mapping[str, Any]) -> Looks | None:
    """The looks by which runs of a campaign ended; None for a fixed number of runs."""
    rule = stopping_rule(metadata)
    return None if rule is None else Looks(rule)


def findings_json(findings: Findings) -> dict[str, Any]:
    classes = findings.classes
    return {
        "classes": {
            "controls": classes.controls,
            "error": classes.error,
            "counts": classes.counts,
            "configurations": dict(zip(findings.names, classes.names, strict=True)),
            "undecided": {findings.names[k]: round(float(findings.reliable_chance[k]), 6) for k in findings.undecided},
        },
        "total_failures": {**asdict(findings.total_failures), "share": findings.total_failures.share},
        "dispersion": _plain(findings.dispersion),
        "factors": [
            {
                "families": list(design.families),
                **_plain(design.analysis),
                "metrics": [asdict(each) for each in design.metrics],
            }
            for design in findings.designs
        ],
        "saved": findings.saved,
    }


def _plain(value: Any) -> Any:
    return None if value is None else asdict(value)


def by_varying_keys(found: ConfigurationTable) -> dict[frozenset[str], list[int]]:
    """Places among the distinct configurations of those that are compared: the same keys vary in them."""
    by_keys: dict[frozenset[str], list[int]] = {}
    for place, k in enumerate(found.distinct):
        by_keys.setdefault(frozenset(chosen_values(found, k)), []).append(place)
    return by_keys


def _designs(
    tables: Tables, passed: NDArray[np.int64], judged: NDArray[np.int64], environments: Mapping[str, str]
) -> Iterator[Design]:
    found, verdicts = tables.configurations, tables.verdicts
    rule = stopping_rule(tables.metadata)
    # The runs that a stopping rule grants every configuration.
    granted = verdicts.run_index < rule.min_runs if rule else np.ones(len(verdicts), dtype=np.bool_)
    first_passed, first_failed = (
        np.bincount(verdicts.configuration[granted & (verdicts.together == code)], minlength=len(found))
        for code in (PASS, FAIL)
    )
    by_keys = by_varying_keys(found)
    known = frozenset().union(*by_keys)
    common = known.intersection(*by_keys)
    for keys, places in by_keys.items():
        at = found.distinct[places]
        families = tuple(dict.fromkeys(found.families[k] for k in at))
        rows = chosen_rows(found, at, environments)
        if len(families) > 1:
            rows = [{"family": found.families[k], **row} for k, row in zip(at, rows, strict=True)]
        factors, dropped = factors_of(rows)
        seen, unseen = factors_of(path_property_rows(found, at))
        units, sets = tables.units.codes[at], {f.name: matched_sets(found, at.tolist(), f.name) for f in factors}
        analysis = factor_analysis(
            factors,
            passed[places],
            judged[places],
            units,
            dropped + unseen,
            path_properties=seen,
            sets=sets,
            first=(first_passed[at], (first_passed + first_failed)[at]),
        )
        if analysis is not None:
            measured = metric_effects(factors, sets, units, _runs(tables, at), analysis.error) if factors else ()
            yield Design(families, analysis, measured, tuple(sorted(keys - common)), tuple(sorted(known - keys)))


METRICS: Final[Mapping[str, tuple[tuple[str, str], ...]]] = {
    "time": (("success", "time"),),
    "recoveries": (("success", "recoveries"),),
    "clearance": (("navigation", "minimum_clearance"), ("safety", "smallest_separation")),
    "localization error": (("robustness", "mean"),),
    "path error": (("performance", "rmse"),),
}
"""Quantities that factors are compared by beside the failure rate; each is the first of its oracles' metrics that exists."""


def _runs(tables: Tables, at: NDArray[np.int64]) -> Runs:
    """The runs of the configurations `at`, with the metrics of `METRICS`.

    Without the oracle `success` none of them reached a goal."""
    verdicts = tables.verdicts
    place = np.full(len(tables.configurations), -1)
    place[at] = np.arange(len(at))
    of_run = place[verdicts.configuration]
    some = of_run >= 0
    if SUCCESS not in verdicts.oracles:
        return Runs(of_run[some], verdicts.run_index[some], np.zeros(int(some.sum()), dtype=np.bool_), {})
    metrics = {}
    for name, sources in METRICS.items():
        known = (verdicts.metrics(oracle).get(metric) for oracle, metric in sources if oracle in verdicts.oracles)
        if (column := next(filter(None, known), None)) is not None:
            metrics[name] = column.unit, column.values[some]
    return Runs(of_run[some], verdicts.run_index[some], verdicts.of(SUCCESS)[some] == PASS, metrics)


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
        found += f" on {best['runs']} runs, not confirmed."
    elif not samples:
        found += f". None of {confirmed['runs']} fresh runs gives it."
    elif is_rate:
        low, high = clopper_pearson_intervals(sum(samples), len(samples)).tolist()
        ends = f"[{math.floor(100 * low)}, {math.ceil(100 * high)}]"
        found += f", confirmed at {_shown(mean, is_rate)} {ends} on {len(samples)} fresh runs."
    else:
        found += f". The mean of {len(samples)} fresh runs is {_shown(mean, is_rate)}."
    if beside is None:
        return found
    found += f" Found after {beside['runs_until_best']} runs"
    if beside["runs_until_as_good"] is not None:
        return f"{found}, by {beside['strategy']} search after {beside['runs_until_as_good']}."
    if beside["best"] is None:
        return f"{found}. No point of {beside['strategy']} search was judged."
    at = _shown(beside["best"]["objective"], is_rate)
    return f"{found}. {beside['strategy'].capitalize()} search comes to {at} in {beside['runs']} runs."


def _shown(value: float, is_rate: bool) -> str:
    return f"{100 * value:.0f} %" if is_rate else f"{value:.3g}"
