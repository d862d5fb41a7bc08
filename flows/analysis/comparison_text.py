"""A comparison for the terminal, as JSON, and as a JUnit file."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any, Final

from rich.console import RenderableType
from rich.table import Table
from rich.text import Text

from vastflow.flows.analysis.comparison import Compared
from vastflow.flows.export.junit import Case, Flaw, Suite, campaign_report
from vastflow.flows.terminal.display import terminal_table
from vastflow.flows.terminal.progress import count_text
from vastflow.oracles.evidence.causes import standstills_of
from vastflow.oracles.statistics.comparison import Change, RateDifference

MOST_CHANGES: Final = 12
MOST_NAMES: Final = 4
MOST_LEVELS: Final = 24
MOST_DIFFERENT: Final = 16


def compared_text(found: Compared, drawn: Mapping[str, Path]) -> Iterator[RenderableType]:
    """Yield pairs, differences, changed configurations, levels of factors, and the gate."""
    for letter, tables, headline in zip("AB", (found.before, found.after), found.headlines, strict=True):
        created = str(tables.metadata.get("created", "")).replace("T", " ")
        yield Text(f"{letter}  {tables.metadata.get('name', '')}, {created}, {tables.directory}")
        yield Text(f"   {headline}")
    matches, pairs = found.pairing.matches, found.whole.pairs
    other = sum(match.how == "other system" for match in matches)
    how = f"{other:,} of them with another system" if other else "all equal"
    not_judged = len(found.pairing.configuration) - pairs
    lost = f", {not_judged:,} more not judged both times" if not_judged else ""
    paired = f"{count_text(len(matches), 'configuration')} paired ({how}), {count_text(pairs, 'pair')} of runs{lost}"
    paired += f", {pairs - found.whole.lost - found.whole.gained:,} of them with the same verdict"
    yield from ("", Text(paired))
    for line in _unpaired(found):
        yield Text(line, "yellow")
    yield from _different(found)
    yield from ("", _differences(found))
    for letter, tables in (("A", found.before), ("B", found.after)):
        if (stood := standstills_of(tables)).runs:
            yield Text(f"{letter}  {stood.text}", "yellow")
    for title, worse in (("newly failing", True), ("newly passing", False)):
        if shown := found.shown(worse=worse):
            named = count_text(len(shown), "configuration")
            yield from _changes(found, f"{title}: {named}, at most 5 % of them falsely", shown, MOST_CHANGES)
    if others := [change for change in found.changes if not change.shown]:
        title = f"{count_text(len(others), 'configuration')} with changed outcomes, possibly by chance"
        yield from _changes(found, title, others, MOST_NAMES)
    if found.levels:
        yield from ("", _levels(found))
    if found.metrics:
        yield from ("", _metrics(found))
    if found.explained:
        yield from ("", _explained(found))
    if drawn:
        folder = next(iter(drawn.values())).parent
        yield from ("", Text(f"{count_text(len(drawn), 'picture')} of the most changed: {folder}"))
    yield from ("", Text(found.gate.text, "green" if found.gate.holds else "red"))


def compared_json(found: Compared, drawn: Mapping[str, Path]) -> dict[str, Any]:
    """Return the comparison as JSON values."""
    pairing, changes = found.pairing, []
    for change in found.changes:
        match = pairing.matches[change.configuration]
        picture = str(drawn[match.after]) if match.after in drawn else None
        own = {"configuration": match.after, "was": match.before, "worse": change.worse, "picture": picture}
        changes.append({**asdict(change), **own})
    return {
        "before": str(found.before.directory),
        "after": str(found.after.directory),
        "headlines": dict(zip(("before", "after"), found.headlines, strict=True)),
        "oracle": found.oracle,
        "paired": {
            "configurations": len(pairing.matches),
            "equal": sum(match.how == "equal" for match in pairing.matches),
            "other_system": sum(match.how == "other system" for match in pairing.matches),
            "runs": len(pairing.configuration),
            "judged_both_times": found.whole.pairs,
        },
        "unpaired": {
            "only_before": list(pairing.only_before),
            "only_after": list(pairing.only_after),
            "ambiguous": list(pairing.ambiguous),
            "runs_before": pairing.lonely_before,
            "runs_after": pairing.lonely_after,
        },
        "differs": [asdict(one) for one in found.differences],
        "campaign_differs": list(found.campaign_differences),
        "difference": asdict(found.whole),
        "oracles": {name: asdict(one) for name, one in found.oracles.items()},
        "changes": changes,
        "stood_still": {
            "before": standstills_of(found.before).runs,
            "after": standstills_of(found.after).runs,
        },
        "levels": [
            {"factor": one.factor, "level": one.level, **asdict(one.difference), "adjusted": one.adjusted}
            for one in found.levels
        ],
        "metrics": [asdict(one) for one in found.metrics],
        "explained": [asdict(one) for one in found.explained],
        "gate": {
            "target": found.gate.target,
            "status": found.gate.status,
            "holds": found.gate.holds,
            "margin": found.gate.margin,
            "paths": found.whole.paths,
            "needed": found.gate.needed,
            "new_faults": found.gate.new_faults,
        },
    }


def share(rate: float) -> str:
    """Return a rate in percent."""
    return f"{100 * rate:.1f} %"


def points(interval: tuple[float, float]) -> str:
    """Return the ends of an interval of a difference in percentage points."""
    return f"{100 * interval[0]:+.1f} to {100 * interval[1]:+.1f}"


def _unpaired(found: Compared) -> Iterator[str]:
    pairing = found.pairing
    for what, names in (
        ("only in A", pairing.only_before),
        ("only in B", pairing.only_after),
        ("in B with several counterparts in A", pairing.ambiguous),
    ):
        if names:
            more = f" and {len(names) - MOST_NAMES:,} more" if len(names) > MOST_NAMES else ""
            yield f"not paired: {count_text(len(names), 'configuration')} {what}: {', '.join(names[:MOST_NAMES])}{more}"
    for letter, runs in (("A", pairing.lonely_before), ("B", pairing.lonely_after)):
        if runs:
            yield f"not paired: {count_text(runs, 'run')} of {letter} with a seed that the other lacks"


def _different(found: Compared) -> Iterator[Text]:
    lines = [
        f"{one.parameter}: {one.before} → {one.after}, {count_text(one.configurations, 'configuration')}"
        for one in found.differences
    ]
    lines += found.campaign_differences
    for line in lines[:MOST_DIFFERENT] or ["no parameter, version, or code"]:
        yield Text(f"differs: {line}")
    yield from _more(len(lines) - MOST_DIFFERENT)


def _differences(found: Compared) -> Table:
    one = len(found.oracles) == 1
    whole = {} if one and found.oracle is None else {found.oracle or "all oracles": found.whole}
    judged = whole | {name: each for name, each in found.oracles.items() if name != found.oracle}
    rows = [
        (name, *_rates(each), f"{each.lost:,}", f"{each.gained:,}", _p(each.mcnemar)) for name, each in judged.items()
    ]
    numbers = ("A", "B", "difference", f"95 %, {found.gate.target}", "lost", "gained", "McNemar p")
    return terminal_table(("judged by",), numbers, rows=rows)


def _rates(one: RateDifference) -> tuple[str, ...]:
    return share(one.before), share(one.after), f"{100 * one.difference:+.1f}", points(one.interval)


def _changes(found: Compared, title: str, changes: Sequence[Change], most: int) -> Iterator[RenderableType]:
    """Yield a title, a table of configurations, and the number of omitted ones."""
    yield from ("", Text(title, "bold"))
    rows = []
    for change in changes[:most]:
        match = found.pairing.matches[change.configuration]
        name = match.after if match.after == match.before else f"{match.after} (was {match.before})"
        passes = (f"{passed} of {change.pairs}" for passed in (change.before, change.after))
        rows.append((name, *passes, _p(change.adjusted)))
    yield terminal_table(("configuration",), ("A", "B", "adjusted p"), rows=rows)
    yield from _more(len(changes) - most)


def _more(left: int) -> Iterator[Text]:
    if left > 0:
        yield Text(f"and {left:,} more (--json lists all)", "dim")


def _levels(found: Compared) -> Table:
    order = sorted(found.levels, key=lambda one: 2.0 if one.adjusted is None else one.adjusted)
    chosen = {id(one) for one in order[:MOST_LEVELS]}
    rows = [
        (one.factor, one.level, f"{one.difference.pairs:,}", *_rates(one.difference), _p(one.adjusted))
        for one in found.levels
        if id(one) in chosen
    ]
    numbers = ("pairs", "A", "B", "difference", "95 %", "adjusted p")
    return terminal_table(("factor", "level"), numbers, rows=rows)


def _metrics(found: Compared) -> Table:
    rows = [
        (
            f"{one.metric} ({one.unit})" if one.unit != "1" else one.metric,
            f"{one.pairs:,}",
            f"{one.equal:,}",
            f"{one.before:.3g}",
            f"{one.after:.3g}",
            f"{one.difference:+.3g}",
            "–" if one.interval is None else f"{one.interval[0]:+.3g} to {one.interval[1]:+.3g}",
            _p(one.adjusted),
            f"{one.most} {one.most_difference:+.3g}" if one.equal < one.pairs else "–",
        )
        for one in found.metrics
    ]
    numbers = ("pairs", "equal", "A", "B", "difference", f"95 %, {found.gate.target}", "adjusted p", "most in")
    return terminal_table(("where both reached the goal",), numbers, rows=rows)


def _explained(found: Compared) -> Table:
    """Return the table of what changes a difference, with the mean of B less A at each level."""
    rows = []
    for one in found.explained[:MOST_LEVELS]:
        levels = (f"{level}: {mean:+.3g}" for level, mean in zip(one.levels, one.means, strict=True))
        rows.append((one.name, one.metric, ", ".join(levels), _p(one.these.adjusted), _p(one.others.adjusted)))
    names = ("factor", "changes the difference in", "B less A at each level")
    return terminal_table(names, ("p, these", "p, others"), rows=rows)


def _p(value: float | None) -> str:
    return "–" if value is None else "< 0.001" if value < 0.001 else f"{value:.3f}"


def compared_report(found: Compared) -> bytes:
    """Return a JUnit report of the gate and of each paired configuration.

    The gate is a failure if it does not hold, and an error if it can't be claimed. A newly failing configuration is a
    failure.
    """
    whole = found.whole
    stated = {
        "before": share(whole.before),
        "after": share(whole.after),
        "difference_points": f"{100 * whole.difference:+.2f}",
        "interval_points": points(whole.interval),
        "pairs": str(whole.pairs),
        "lost": str(whole.lost),
        "gained": str(whole.gained),
        "headline_before": found.headlines[0],
        "headline_after": found.headlines[1],
    }
    gate = found.gate
    stated |= {"target": gate.target, "status": gate.status, "paths": str(whole.paths), "needed": str(gate.needed)}
    flaw = None if gate.holds else Flaw("error" if gate.exit_code == 4 else "failure", gate.text)
    case = Case("non-inferiority", "comparison", 0.0, properties=stated, flaw=flaw)
    changed = {change.configuration: change for change in found.changes}
    cases = []
    for k, match in enumerate(found.pairing.matches):
        newly, more = None, {"was": match.before, "paired": match.how}
        if (change := changed.get(k)) is not None:
            passes = f"{change.before} of {change.pairs} before, {change.after} after"
            more |= {"passes": passes, "adjusted_p": f"{change.adjusted:.4g}"}
            if change.shown and change.worse:
                newly = Flaw("failure", f"newly failing: {passes}")
        cases.append(Case(match.after, "configurations", 0.0, properties=more, flaw=newly))
    return campaign_report("compare", [Suite("gate", [case]), Suite("configurations", cases)])
