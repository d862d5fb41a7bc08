"""Evidence: rates and intervals of a campaign, its families, and its configurations."""

import json
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping
from dataclasses import asdict, dataclass, field, replace
from functools import cached_property
from typing import Any, Final

import numpy as np

from vastflow.oracles.evidence.findings import found_text, looks_of
from vastflow.oracles.evidence.headline import Headline
from vastflow.oracles.results.tables import FAIL, PASS, Tables, VerdictTable
from vastflow.oracles.statistics.intervals import (
    LEVEL,
    Counts,
    Floats,
    Interval,
    clopper_pearson_intervals,
    clustered,
    pooled,
    wilson_intervals,
)
from vastflow.oracles.statistics.looks import Looks, Mean, mean_rate

SOUGHT: Final = "search"
"""Family of the points that a search chose."""
_TEXT: Final = json.JSONEncoder(ensure_ascii=False, allow_nan=False).encode


@dataclass(frozen=True, eq=False)
class Group:
    """The rate of several configurations together, which is the mean of their rates.

    Attributes:
        by_name: Runs of each configuration.
        rates: Rate of each configuration, NaN without judged runs; an unbiased one where runs ended by a rule.
        tables: Tables with their blocks.
        looks: If runs ended by a rule.
        sought: Whether a search chose them by earlier results: then they have no rate together, and nothing follows for others.
    """

    by_name: Mapping[str, Counts] = field(repr=False)
    rates: Mapping[str, float] = field(repr=False)
    tables: Tables = field(repr=False)
    looks: Looks | None = field(default=None, repr=False)
    sought: bool = False

    @cached_property
    def counts(self) -> Counts:
        return pooled(self.by_name.values())

    @cached_property
    def mean(self) -> Mean | None:
        """Rate, and interval for these configurations, see `mean_rate`; None without judged runs and for sought ones."""
        if self.sought:
            return None
        rates = [self.rates[name] for name in self.by_name]
        return mean_rate(rates, [counts.judged for counts in self.by_name.values()], self.looks)

    @property
    def rate(self) -> float | None:
        return self.mean[0] if self.mean else None

    @property
    def interval(self) -> Interval | None:
        return self.mean[1] if self.mean else None

    @property
    def configurations(self) -> int:
        return len(self.by_name)

    @cached_property
    def clustered(self) -> Interval | None:
        """Interval for other configurations of their kind; None for fewer than two and for sought ones.

        It holds `interval`, and reads every scenario, so it is computed on request.
        """
        if (these := self.interval) is None:
            return None
        blocks = self.tables.blocks
        found = clustered(list(self.by_name.values()), blocks=[blocks[name] for name in self.by_name])
        return found and Interval(min(found.low, these.low), max(found.high, these.high))

    @cached_property
    def means(self) -> Mapping[str, Mean | None]:
        """Rate and interval of each configuration; None without judged runs and for sought ones."""
        ends = _of_each(wilson_intervals, self.by_name.values())
        return {
            name: None if self.sought or counts.rate is None else (counts.rate, Interval(low, high))
            for (name, counts), (low, high) in zip(self.by_name.items(), ends, strict=True)
        }

    def of(self, names: Iterable[str]) -> "Group":
        """Return the group of some of these configurations."""
        return replace(self, by_name={name: self.by_name[name] for name in names})

    @property
    def headline(self) -> Headline:
        """One sentence on the configurations; of all of a search, its finding."""
        judged = sum(counts.judged > 0 for counts in self.by_name.values())
        left_out = self.configurations - judged
        if self.sought:
            return Headline(None, None, None, judged, left_out, finding=found_text(self.tables.metadata["search"]))
        blocks = {self.tables.blocks[name] for name in self.by_name} if self.clustered else ()
        kind = f"other {self.tables.units.others}" if len(blocks) > 1 else "others of their kind"
        return Headline(self.rate, self.interval, self.clustered, judged, left_out, kind)


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
    searched, looks, verdicts = bool(tables.metadata.get("search")), looks_of(tables.metadata), tables.verdicts
    weights = np.ones(len(verdicts)) if looks is None else run_weights(looks, verdicts)
    evidence: dict[str | None, Evidence] = {}
    for oracle in (None, *tables.oracles):
        counts = [Counts(*map(int, row)) for row in verdicts.counts(oracle).tolist()]
        found = dict(zip(tables.configurations.names, counts, strict=True))
        passed, failed = (
            np.bincount(verdicts.configuration, weights * (verdicts.of(oracle) == code), len(counts))
            for code in (PASS, FAIL)
        )
        with np.errstate(invalid="ignore"):
            rates = dict(zip(found, (passed / (passed + failed)).tolist(), strict=True))
        every = Group(found, rates, tables, looks)
        families = {
            family: replace(every.of(names), sought=searched and family == SOUGHT)
            for family, names in tables.families.items()
        }
        campaign = replace(every.of(name for each in families.values() for name in each.by_name), sought=searched)
        evidence[oracle] = Evidence(campaign, families, campaign.by_name)
    return evidence


def headline_of(tables: Tables) -> Headline:
    """The headline of a campaign directory, by all oracles together."""
    return evidence_of(tables)[None].campaign.headline


def run_weights(looks: Looks, verdicts: VerdictTable) -> Floats:
    """(R,) weights with which the passes of each configuration have its unbiased rate."""
    passed, failed, _ = verdicts.counts(None).T
    judged = np.maximum(passed + failed, 1)
    rates = np.nan_to_num(looks.rates(passed, passed + failed))
    shares = (rates / np.maximum(passed, 1), (1 - rates) / np.maximum(failed, 1), 1 / judged)
    return np.asarray(np.stack(shares, axis=1)[verdicts.configuration, verdicts.together])


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
        spreads: Spreads of each oracle's metrics, see `spreads_of`.
        findings: Results of the statistics as JSON values, under their own keys.
    """
    document: dict[str, Any] = {
        "campaign": tables.metadata["name"],
        "headline": evidence[None].campaign.headline.text,
        "level": LEVEL,
        "intervals": {
            "rate": "of a configuration, passes over judged runs; of several, the mean of their rates, which are unbiased where runs "
            "ended by a rule; null for points that a search chose",
            "interval": "Wilson score interval of these configurations' runs; of several, at their effective number of runs",
            "exact": "Clopper-Pearson interval of a configuration's runs: at least the level whatever the rate, and wider",
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
        ends = {name: each and asdict(each) for name, each in (("interval", of.interval), ("clustered", of.clustered))}
        return {**asdict(of.counts), "rate": of.rate, "configurations": of.configurations, **ends}

    return {
        "campaign": group(evidence.campaign),
        "families": {name: group(each) for name, each in evidence.families.items()},
        "configurations": (row for each in evidence.families.values() for row in _configurations(each)),
        "metrics": {name: asdict(spread) for name, spread in spreads.items()},
    }


def _configurations(group: Group) -> Iterator[tuple[str, dict[str, Any]]]:
    wilson, exact = (_of_each(each, group.by_name.values()) for each in (wilson_intervals, clopper_pearson_intervals))
    for (name, counts), *both in zip(group.by_name.items(), wilson, exact, strict=True):
        ends = (None if group.sought else {"low": low, "high": high} for low, high in both)
        rate = None if group.sought else counts.rate
        yield name, {**asdict(counts), "rate": rate, **dict(zip(("interval", "exact"), ends, strict=True))}


def _of_each(intervals: Callable[..., Floats], counts: Collection[Counts]) -> list[tuple[float, float]]:
    found: list[tuple[float, float]] = intervals([c.passed for c in counts], [c.judged for c in counts]).tolist()
    return found


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
