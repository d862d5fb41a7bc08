"""Evidence: rates and intervals of a campaign, its families, and its configurations."""

import json
from collections.abc import Collection, Iterator, Mapping
from dataclasses import asdict, dataclass, field
from functools import cached_property
from typing import Any, Final

import numpy as np

from vastflow.oracles.results.tables import Tables
from vastflow.oracles.statistics.intervals import (
    LEVEL,
    Counts,
    Interval,
    clopper_pearson_intervals,
    clustered,
    pooled,
    wilson_intervals,
)

SOUGHT: Final = "search"
"""Family of the points that a search chose."""
_TEXT: Final = json.JSONEncoder(ensure_ascii=False, allow_nan=False).encode


@dataclass(frozen=True, eq=False)
class Group:
    """The rate of several configurations together.

    Attributes:
        by_name: Runs of each configuration.
        tables: Tables with their blocks.
        sought: Whether a search chose them by earlier results: then nothing follows for others of their kind.
    """

    by_name: Mapping[str, Counts] = field(repr=False)
    tables: Tables = field(repr=False)
    sought: bool = False

    @cached_property
    def counts(self) -> Counts:
        return pooled(self.by_name.values())

    @property
    def configurations(self) -> int:
        return len(self.by_name)

    @cached_property
    def clustered(self) -> Interval | None:
        """Interval for other configurations of their kind; None for fewer than two and for sought ones.

        It reads every scenario, so it is computed on request.
        """
        if self.sought:
            return None
        blocks = self.tables.blocks
        return clustered(list(self.by_name.values()), blocks=[blocks[name] for name in self.by_name])


@dataclass(frozen=True, slots=True)
class Spread:
    """A metric over all runs that have it."""

    unit: str
    n: int
    minimum: float | None
    median: float | None
    maximum: float | None


@dataclass(frozen=True, slots=True)
class Evidence:
    """Rates by one oracle, or by all together; families and configurations by name, in the order of the campaign file."""

    campaign: Group
    families: Mapping[str, Group]
    configurations: Mapping[str, Counts]


def evidence_of(tables: Tables) -> dict[str | None, Evidence]:
    """Evidence by oracle, in their order, after the joint evidence under None."""
    searched = bool(tables.metadata.get("search"))
    evidence: dict[str | None, Evidence] = {}
    for oracle in (None, *tables.oracles):
        counts = [Counts(*map(int, row)) for row in tables.verdicts.counts(oracle).tolist()]
        found = dict(zip(tables.configurations.names, counts, strict=True))
        families = {
            family: Group({name: found[name] for name in names}, tables, searched and family == SOUGHT)
            for family, names in tables.families.items()
        }
        configurations = {name: each for group in families.values() for name, each in group.by_name.items()}
        evidence[oracle] = Evidence(Group(configurations, tables, searched), families, configurations)
    return evidence


def spreads_of(tables: Tables) -> dict[str, dict[str, Spread]]:
    spreads: dict[str, dict[str, Spread]] = {}
    for oracle in tables.oracles:
        spreads[oracle] = {}
        for name, metric in tables.verdicts.metrics(oracle).items():
            values = metric.values[np.isfinite(metric.values)]
            ends = (float(of(values)) if values.size else None for of in (np.min, np.median, np.max))
            spreads[oracle][name] = Spread(metric.unit, values.size, *ends)
    return spreads


def evidence_json(
    tables: Tables,
    evidence: Mapping[str | None, Evidence],
    spreads: Mapping[str, Mapping[str, Spread]],
    findings: Mapping[str, Any],
) -> Iterator[str]:
    """Pieces of `evidence.json`: counts, rates and intervals of the campaign, its families and its configurations.

    Args:
        spreads: As of `spreads_of`.
        findings: Results of the statistics as JSON values, under their own keys.
    """
    document: dict[str, Any] = {
        "campaign": tables.metadata["name"],
        "level": LEVEL,
        "intervals": {
            "interval": "Wilson score interval of these configurations' runs",
            "exact": "Clopper-Pearson interval of the same: at least the level whatever the rate, and wider",
            "clustered": "beta-binomial interval, averaged over the intraclass correlation, with blocks as clusters, configurations on "
            "one map with one task, or with configurations where there is one block: what to expect of others of the kind; null for fewer "
            "than two, and for points that a search chose",
        },
        "all_oracles": _document(evidence[None], {}),
        "oracles": {oracle: _document(evidence[oracle], spreads[oracle]) for oracle in tables.oracles},
        "rejected": len(tables.rejections),
        "duplicates": tables.configurations.duplicates,
        **findings,
    }
    yield from _lines(document)
    yield "\n"


def _document(evidence: Evidence, spreads: Mapping[str, Spread]) -> dict[str, Any]:
    def group(of: Group) -> dict[str, Any]:
        (rates,) = _with_intervals([of.counts])
        clustered = asdict(of.clustered) if of.clustered else None
        return {**rates, "configurations": of.configurations, "clustered": clustered}

    configurations = _with_intervals(evidence.configurations.values())
    return {
        "campaign": group(evidence.campaign),
        "families": {name: group(each) for name, each in evidence.families.items()},
        "configurations": zip(evidence.configurations, configurations, strict=True),
        "metrics": {name: asdict(spread) for name, spread in spreads.items()},
    }


def _with_intervals(of: Collection[Counts]) -> Iterator[dict[str, Any]]:
    passed, judged = [counts.passed for counts in of], [counts.judged for counts in of]
    wilson, exact = wilson_intervals(passed, judged).tolist(), clopper_pearson_intervals(passed, judged).tolist()
    for counts, ends, exact_ends in zip(of, wilson, exact, strict=True):
        yield {
            "passed": counts.passed,
            "failed": counts.failed,
            "not_judged": counts.not_judged,
            "rate": counts.rate,
            "interval": dict(zip(("low", "high"), ends, strict=True)),
            "exact": dict(zip(("low", "high"), exact_ends, strict=True)),
        }


def _lines(value: Any, depth: int = 1) -> Iterator[str]:
    """JSON of `value`, one line for each value three levels deep; an iterator of pairs is an object."""
    if depth > 3 or not isinstance(value, dict | Iterator):
        whole = dict(value) if isinstance(value, Iterator) else value
        yield _TEXT(whole)
        return
    before = "{"
    for key, item in value.items() if isinstance(value, dict) else value:
        yield f"{before}\n{' ' * depth}{_TEXT(key)}: "
        yield from _lines(item, depth + 1)
        before = ","
    yield "{}" if before == "{" else "\n" + " " * (depth - 1) + "}"
