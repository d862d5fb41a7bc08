"""The benchmark of controllers as tables: its scenes and their levels, of one campaign or of two compared."""

from collections import Counter
from collections.abc import Iterator, Mapping
from typing import Final

import numpy as np
from numpy.typing import NDArray
from rich.console import RenderableType
from rich.text import Text

from vastflow.flows.analysis.comparison import Compared
from vastflow.flows.analysis.comparison_text import p_text, points, share
from vastflow.flows.terminal.display import terminal_table
from vastflow.flows.terminal.progress import count_text
from vastflow.oracles.evidence.evidence import evidence_of
from vastflow.oracles.evidence.paired_metrics import metric_differences, paired_values
from vastflow.oracles.evidence.varied import chosen_rows
from vastflow.oracles.results.executed import environment_names
from vastflow.oracles.results.factors import Factor
from vastflow.oracles.results.tables import PASS, Tables
from vastflow.oracles.statistics.analysis import holm
from vastflow.oracles.statistics.comparison import by_level
from vastflow.oracles.statistics.intervals import LEVEL
from vastflow.oracles.statistics.measured import interval_of_mean
from vastflow.sim.world.environment import MAP_KEY

HARDER_BY: Final[Mapping[str, tuple[str, str]]] = {
    "office": ("amount_per_m", "boxes per m"),
    "doors": (MAP_KEY, ""),
    "crossings": ("angle_deg", "degrees"),
    "s-turn": (MAP_KEY, ""),
}
"""What makes a scene harder: its key, and the unit of its levels."""
ERROR: Final = 1.0 - LEVEL
"""Greatest adjusted p-value of a difference that is shown."""


def benchmark_text(tables: Tables) -> Iterator[RenderableType]:
    """Yield the table of a campaign, and a sentence on scenes whose runs all end alike."""
    campaign, verdicts = evidence_of(tables)[None].campaign, tables.verdicts
    time_s, touched = verdicts.metrics("success")["time"].values, _contacts(tables)
    rows, alike = [], []
    for (scene, level), names in _groups(tables).items():
        group = campaign.of(names)
        inside = np.isin(verdicts.configuration, [verdicts.names.index(name) for name in names])
        passed_s = time_s[inside & (verdicts.together == PASS)]
        if group.mean is None:
            continue
        if not level and group.mean[0] in (0.0, 1.0):
            alike.append(scene)
        low, high = (end / 10 for end in group.mean[1].thousandths)
        ends = interval_of_mean(passed_s, ERROR)
        cells = (
            f"{group.counts.judged}",
            share(group.mean[0]),
            f"{low:.1f} to {high:.1f}",
            f"{int((touched & inside).sum())}",
        )
        time = f"{passed_s.mean():.1f} s" if len(passed_s) else "–", f"{ends[0]:.1f} to {ends[1]:.1f}" if ends else "–"
        rows.append((_label(scene, level), *cells, *time))
    yield terminal_table(("scene",), ("runs", "passed", "95 %", "with a contact", "time if passed", "95 %"), rows=rows)
    if alike:
        yield Text(
            f"all runs pass, or all fail, in {', '.join(alike)}: it tells controllers apart by time at most", "yellow"
        )
    for scene, count in Counter(row["family"] for row in tables.rejections).items():
        why = next(row["reason"] for row in tables.rejections if row["family"] == scene)
        yield Text(f"not run: {count_text(count, 'configuration')} of {scene}, such as: {why}", "yellow")


def scenes_text(found: Compared) -> Iterator[RenderableType]:
    """Yield tables of passing and of time where both reached the goal, and sentences on where A or B loses."""
    pairing, after = found.pairing, [match.after for match in found.pairing.matches]
    inside = {group: np.isin(after, names) for group, names in _groups(found.after).items()}
    factors = [Factor(scene, (level,), np.where(at, 0, -1)) for (scene, level), at in inside.items()]
    passing = {(one.factor, one.level): one for one in by_level(factors, pairing.pairs())}
    sides = ((found.before, pairing.row_before), (found.after, pairing.row_after))
    touched = np.column_stack([_contacts(tables)[rows] for tables, rows in sides])
    unit, both_s = paired_values(found.before, found.after, pairing)["time"]
    time = {
        group: each
        for group, at in inside.items()
        for own_s in [np.where(at[pairing.configuration][:, None], both_s, np.nan)]
        for each in metric_differences({"time": (unit, own_s)}, pairing, "these")
    }
    adjusted = dict(zip(time, holm([each.adjusted for each in time.values()]), strict=True))
    rates, times = [], []
    lost: dict[tuple[str, str], dict[tuple[str, str], str]] = {}
    for group, one in passing.items():
        change, (a, b) = one.difference, touched[inside[group][pairing.configuration]].sum(axis=0)
        cells = f"{change.pairs}", share(change.before), share(change.after), f"{100 * change.difference:+.1f}"
        rates.append((_label(*group), *cells, points(change.interval), p_text(one.adjusted), f"{a}", f"{b}"))
        if (one.adjusted or 0.0) <= ERROR:
            lost.setdefault(("AB"[change.difference < 0], "passes fewer runs"), {})[group] = (
                f"{100 * abs(change.difference):.1f} points"
            )
    for group, each in time.items():
        ends = "–" if each.interval is None else f"{each.interval[0]:+.1f} to {each.interval[1]:+.1f}"
        means = f"{each.pairs}", f"{each.before:.1f}", f"{each.after:.1f}", f"{each.difference:+.1f}"
        times.append((_label(*group), *means, ends, p_text(adjusted[group])))
        if (adjusted[group] or 0.0) <= ERROR:
            lost.setdefault(("AB"[each.difference > 0], "takes longer"), {})[group] = f"{abs(each.difference):.1f} s"
    numbers = ("pairs", "A", "B", "difference", "95 %", "adjusted p")
    yield terminal_table(("passed (%)",), (*numbers, "A touched", "B touched"), rows=rates)
    yield ""
    yield terminal_table(("time (s) where both reached the goal",), numbers, rows=times)
    yield ""
    for (loser, what), where in lost.items():
        # A level is named where the difference in its whole scene is not shown.
        named = [
            f"{scene}{f' at {level}' if level else ''} ({by})"
            for (scene, level), by in where.items()
            if not level or (scene, "") not in where
        ]
        yield Text(f"{loser} {what} in {', '.join(named)}", "yellow")
    if not lost:
        yield Text("no difference in passing or time is shown in any scene")


def _groups(tables: Tables) -> dict[tuple[str, str], list[str]]:
    """Return the names of configurations by scene and level, with the level "" for all of a scene."""
    table, found = tables.configurations, dict[tuple[str, str], list[str]]()
    rows = chosen_rows(table, range(len(table)), environment_names(tables.directory, table.environments))
    for name, scene, row in zip(table.names, table.families, rows, strict=True):
        key, unit = HARDER_BY.get(scene, ("", ""))
        value = row.get(key, "")
        level = f"{value:g} {unit}" if isinstance(value, int | float) else str(value).replace("_", " ")
        for group in dict.fromkeys(((scene, ""), (scene, level))):
            found.setdefault(group, []).append(name)
    return found


def _label(scene: str, level: str) -> str:
    return f"    {level}" if level else scene


def _contacts(tables: Tables) -> NDArray[np.bool_]:
    """Return (R,) whether a run had a contact."""
    return np.asarray(tables.verdicts.metrics("safety")["contacts"].values > 0)
