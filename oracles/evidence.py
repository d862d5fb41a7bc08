"""Evidence: what the verdicts of a campaign add up to."""

import json
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from statistics import median
from typing import Any

from vastflow.oracles.rates import LEVEL, Counts, Interval, clustered, pooled
from vastflow.oracles.tables import Tables


@dataclass(frozen=True, slots=True)
class Group:
    """The rate of several configurations together.

    Attributes:
        counts: Runs of all of them; its own interval is that of these very configurations.
        configurations: How many there are.
        clustered: Interval for other configurations of their kind; None for fewer than two.
    """

    counts: Counts
    configurations: int
    clustered: Interval | None


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
    """One oracle's findings, or those of all oracles together.

    Attributes:
        families, configurations: By name, in the order of the campaign file.
        members: Family to the names of its configurations that are no duplicates.
        metrics: By name; empty for all oracles together.
    """

    campaign: Group
    families: Mapping[str, Group]
    configurations: Mapping[str, Counts]
    members: Mapping[str, Sequence[str]]
    metrics: Mapping[str, Spread]


def evidence_of(tables: Tables) -> dict[str | None, Evidence]:
    """Each oracle's evidence by name, in their order; under None that of all together, first."""
    return {oracle: _evidence(tables, oracle) for oracle in (None, *tables.oracles)}


def group_of(clusters: Sequence[Counts]) -> Group:
    """`clusters` together."""
    return Group(pooled(clusters), len(clusters), clustered(clusters))


def evidence_json(tables: Tables, evidence: Mapping[str | None, Evidence]) -> str:
    """`evidence.json`: counts, rates and intervals of the campaign, its families and its configurations."""
    document = {
        "campaign": tables.metadata["name"],
        "level": LEVEL,
        "intervals": {
            "interval": "Wilson score interval of these configurations' runs",
            "clustered": "Wilson interval at the effective sample size with configurations as clusters: what to "
            "expect of other configurations of the kind; null for fewer than two",
        },
        "all_oracles": _document(evidence[None]),
        "oracles": {oracle: _document(found) for oracle, found in evidence.items() if oracle is not None},
        "rejected": len(tables.rejections),
        "duplicates": {row["name"]: row["duplicate_of"] for row in tables.configurations if row["duplicate_of"]},
    }
    return json.dumps(document, indent=1, ensure_ascii=False, allow_nan=False) + "\n"


def _evidence(tables: Tables, oracle: str | None) -> Evidence:
    found = tables.counts(oracle)
    families = {
        family: {name: found.get(name, Counts()) for name in members} for family, members in tables.families.items()
    }
    configurations = {name: counts for members in families.values() for name, counts in members.items()}
    return Evidence(
        group_of(list(configurations.values())),
        {family: group_of(list(members.values())) for family, members in families.items()},
        configurations,
        tables.families,
        {} if oracle is None else _spreads(tables, oracle),
    )


def _spreads(tables: Tables, oracle: str) -> dict[str, Spread]:
    values: dict[str, list[float]] = {}
    units: dict[str, str] = {}
    for row in tables.verdicts:
        if row["oracle"] == oracle:
            for name, metric in row["metrics"].items():
                units[name] = metric["unit"]
                found = values.setdefault(name, [])
                if metric["value"] is not None:
                    found.append(metric["value"])
    return {
        name: Spread(units[name], len(v), min(v), median(v), max(v)) if v else Spread(units[name], 0, None, None, None)
        for name, v in values.items()
    }


def _document(evidence: Evidence) -> dict[str, Any]:
    return {
        "campaign": _group(evidence.campaign),
        "families": {name: _group(group) for name, group in evidence.families.items()},
        "configurations": {name: _counts(counts) for name, counts in evidence.configurations.items()},
        "metrics": {name: asdict(spread) for name, spread in evidence.metrics.items()},
    }


def _group(group: Group) -> dict[str, Any]:
    return {
        **_counts(group.counts),
        "configurations": group.configurations,
        "clustered": asdict(group.clustered) if group.clustered else None,
    }


def _counts(counts: Counts) -> dict[str, Any]:
    return {**asdict(counts), "rate": counts.rate, "interval": asdict(counts.interval)}
