"""The outcome of a campaign for the terminal: rates with intervals, rejections, and faults."""

from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from typing import Final, NamedTuple

from rich.console import RenderableType
from rich.table import Table
from rich.text import Text

from vastflow.flows.request.run_request import SEQUENTIAL
from vastflow.flows.terminal.display import terminal_table
from vastflow.flows.terminal.progress import count_text
from vastflow.oracles.evidence.causes import causes_by_configuration, standstills_of
from vastflow.oracles.evidence.evidence import Evidence
from vastflow.oracles.evidence.headline import robot_text
from vastflow.oracles.results.tables import Tables
from vastflow.oracles.statistics.intervals import LEVEL, Counts
from vastflow.oracles.statistics.looks import Mean

MOST_FAILING: Final = 50


def outcome(tables: Tables, evidence: Mapping[str | None, Evidence]) -> Iterator[RenderableType]:
    """Yield the headline, a table of families, and lines on oracles, rejections, and faults."""
    whole = evidence[None]
    yield Text(whole.campaign.headline.text, "bold")
    if robot := robot_text(tables.metadata):
        yield Text(f"robot: {robot}", "dim")
    rows = [
        _Row((family, f"{group.configurations}"), group.counts, group.mean) for family, group in whole.families.items()
    ]
    excluded: Mapping[str, Mapping[str, int]] = tables.metadata.get("counts", {}).get("excluded_by", {})
    lost = dict.fromkeys([*(row["family"] for row in tables.rejections), *excluded])
    rows += [_Row((family, "0"), Counts()) for family in lost if family not in whole.families]
    if len(rows) > 1:
        rows.append(_Row(("all", f"{whole.campaign.configurations}"), whole.campaign.counts, whole.campaign.mean))
    yield _table(("family", "configurations"), rows)
    if rule := tables.metadata.get(SEQUENTIAL):
        counts = tables.metadata["counts"]
        runs, most = counts["runs"], counts["configurations"] * rule["max"]
        yield Text(
            f"{runs:,} runs of at most {most:,}, {most - runs:,} saved, since runs end when a configuration's class is decided"
        )
    if len(tables.oracles) > 1:
        shares = []
        for name in tables.oracles:
            own = evidence[name].campaign.counts
            unjudged = f" ({own.not_judged} not judged)" if own.not_judged else ""
            shares.append(f"{name} {own.passed}/{own.judged}{unjudged}")
        yield Text(", ".join(shares), "dim")
    if (stood := standstills_of(tables)).runs:
        yield Text(stood.text, "yellow")
    if sampled_from := tables.metadata.get("counts", {}).get("sampled_from"):
        drawn = tables.metadata["counts"]["configurations"]
        yield Text(f"a sample of {drawn:,} of {sampled_from:,} distinct configurations")
    if duplicates := sum(name is not None for name in tables.configurations.duplicate_of):
        yield Text(f"{count_text(duplicates, 'configuration')} equal to another, run once", "dim")
    if tables.rejections:
        yield Text(f"{count_text(len(tables.rejections), 'instance')} rejected (see the report for reasons)", "yellow")
    for family, counts in excluded.items():
        named = ", ".join(f"{constraint} {n}" for constraint, n in counts.items())
        left = "" if family in whole.families else ", none is left"
        yield Text(
            f"{count_text(sum(counts.values()), 'instance')} of {family} excluded by constraints: {named}{left}", "dim"
        )
    yield from _faults(tables)


def details(tables: Tables, evidence: Mapping[str | None, Evidence], failing: bool = False) -> Iterator[RenderableType]:
    """Yield `outcome`, and tables of configurations with causes and of reasons for rejection.

    Args:
        failing: Whether to yield only configurations with failed runs, those with most of them first.
    """
    yield from outcome(tables, evidence)
    yield ""
    causes = causes_by_configuration(tables)
    each = [
        _Row((name,), counts, group.means[name], ", ".join(f"{cause} {n}" for cause, n in causes[name].most_common()))
        for group in evidence[None].families.values()
        for name, counts in group.by_name.items()
    ]
    if failing:
        whole, each = len(each), sorted((row for row in each if row.counts.failed), key=lambda row: -row.counts.failed)
        yield Text(f"{len(each):,} of {count_text(whole, 'configuration')} with failed runs", "bold")
    if each:
        yield _table(("configuration",), each[: MOST_FAILING if failing else None])
    if failing and len(each) > MOST_FAILING:
        yield Text(f"and {len(each) - MOST_FAILING:,} more")
    if tables.rejections:
        reasons = Counter((row["family"], row["producer"], row["reason"]) for row in tables.rejections)
        rows = [(*rejected, str(times)) for rejected, times in reasons.most_common()]
        yield from ("", terminal_table(("family", "producer", "reason"), ("times",), rows=rows))


class _Row(NamedTuple):
    """Names, runs, causes, and the rate with its interval; None where nothing was judged or a search chose the points."""

    names: Sequence[str]
    counts: Counts
    mean: Mean | None = None
    causes: str = ""

    @property
    def rate(self) -> str:
        """A rate such as `93.3 %  [82.1, 97.7]`, `not judged`, or a dash."""
        if self.mean is None:
            return "not judged" if self.counts.not_judged and not self.counts.judged else "–"
        low, high = self.mean[1].thousandths
        return f"{100 * self.mean[0]:.1f} %  [{low / 10:.1f}, {high / 10:.1f}]"


def _table(first: Sequence[str], rows: Sequence[_Row]) -> Table:
    unjudged = any(row.counts.not_judged for row in rows)
    counted = ("runs", "passed", "failed", *["not judged"][:unjudged])
    cells = [
        (*row.names, *map(str, (n.judged + n.not_judged, n.passed, n.failed, *[n.not_judged][:unjudged])), row.rate)
        for row in rows
        for n in [row.counts]
    ]
    numbers = (*first[1:], *counted, f"rate [{100 * LEVEL:.0f} % interval]")
    if not any(row.causes for row in rows):
        return terminal_table(first[:1], numbers, rows=cells)
    cells = [(*cell, row.causes) for cell, row in zip(cells, rows, strict=True)]
    return terminal_table(first[:1], numbers, ("causes",), cells)


def _faults(tables: Tables) -> Iterator[RenderableType]:
    faults = tables.metadata.get("faults", [])
    for fault in faults[:3]:
        run = "" if fault["run_index"] is None else f" run {fault['run_index']}"
        of = f"{fault['configuration']}{run}, " if fault["configuration"] else ""
        yield Text(f"fault: {of}{fault['stage']}: {fault['error']}", "red")
    if len(faults) > 3:
        yield Text(f"and {len(faults) - 3} more, see metadata.json", "red")
