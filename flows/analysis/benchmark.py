"""The benchmark of controllers as tables: its scenes and their levels, of one campaign or of two compared."""

from collections import Counter
from collections.abc import Iterator, Mapping
from typing import Final

import numpy as np
from numpy.typing import NDArray
from rich.console import RenderableType
from rich.text import Text

from vastflow.flows.analysis.comparison import Compared
from vastflow.flows.analysis.comparison_text import points, share
from vastflow.flows.terminal.display import terminal_table
from vastflow.flows.terminal.progress import count_text
from vastflow.oracles.evidence.evidence import evidence_of
from vastflow.oracles.evidence.paired_metrics import paired_values
from vastflow.oracles.evidence.varied import chosen_rows
from vastflow.oracles.results.executed import environment_names
from vastflow.oracles.results.tables import PASS, Tables
from vastflow.oracles.statistics.comparison import difference
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
"""Probability, at most, that any interval of scenes misses, in both tables of a comparison together, or one of a table of one file."""


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
        ends = None if level else interval_of_mean(passed_s, ERROR)
        cells = (
            f"{group.counts.judged}",
            share(group.mean[0]),
            f"{low:.1f} to {high:.1f}",
            f"{int((touched & inside).sum())}",
        )
        time = f"{passed_s.mean():.1f} s" if len(passed_s) else "–", f"{ends[0]:.1f} to {ends[1]:.1f}" if ends else ""
        rows.append((_label(scene, level), *cells, *time))
    yield terminal_table(("scene",), ("runs", "passed", "95 %", "with a contact", "time if passed", "95 %"), rows=rows)
    if alike:
        yield Text(f"all runs end alike, so at most their times tell controllers apart: {', '.join(alike)}", "yellow")
    for scene, count in Counter(row["family"] for row in tables.rejections).items():
        why = next(row["reason"] for row in tables.rejections if row["family"] == scene)
        yield Text(f"not run: {count_text(count, 'configuration')} of {scene}, such as: {why}", "yellow")


def scenes_text(found: Compared) -> Iterator[RenderableType]:
    """Yield tables of passing and of time where both reached the goal, and sentences on where A or B loses.

    The intervals of all scenes in both tables hold together; levels have none, and times have none where runs ended by what they showed.
    """
    pairing, pairs, after = found.pairing, found.pairing.pairs(), [match.after for match in found.pairing.matches]
    groups = {group: np.isin(after, names) for group, names in _groups(found.after).items()}
    error = ERROR / sum(2 for _, level in groups if not level)
    _, both_s = paired_values(found.before, found.after, pairing)["time"]
    sides = ((found.before, pairing.row_before), (found.after, pairing.row_after))
    touched = np.column_stack([_contacts(tables)[rows] for tables, rows in sides])
    rates, times, lost = [], [], dict[str, list[str]]()

    def shown(scene: str, ends: tuple[float, float] | None, worse: tuple[str, str], by: str) -> None:
        """Note who loses in a scene, A or B, where the interval of B less A says so."""
        if ends is not None and not ends[0] <= 0.0 <= ends[1]:
            lost.setdefault(worse[ends[0] > 0.0], []).append(f"{scene} ({by})")

    for (scene, level), at in groups.items():
        one = difference(pairs.of(at[pairs.configuration]), level=1.0 - error, at_any_look=found.gate.until_decided)
        inside = at[pairing.configuration]
        if one is not None:
            change, (a, b) = 100 * one.difference, touched[inside].sum(axis=0)
            ends = "" if level else points(one.interval)
            cells = f"{one.pairs}", share(one.before), share(one.after), f"{change:+.1f}", ends, f"{a}", f"{b}"
            rates.append((_label(scene, level), *cells))
            if not level:
                shown(
                    scene,
                    one.interval,
                    ("B passes fewer runs in", "A passes fewer runs in"),
                    f"{abs(change):.1f} points",
                )
        own_s = both_s[inside & np.isfinite(both_s).all(axis=1)]
        if len(own_s):
            (a_s, b_s), span_s = own_s.mean(axis=0), interval_of_mean(own_s[:, 1] - own_s[:, 0], error)
            span_s = None if found.gate.until_decided else span_s
            ends = "" if level or span_s is None else f"{span_s[0]:+.1f} to {span_s[1]:+.1f}"
            times.append((_label(scene, level), f"{len(own_s)}", f"{a_s:.1f}", f"{b_s:.1f}", f"{b_s - a_s:+.1f}", ends))
            if not level:
                shown(scene, span_s, ("A takes longer in", "B takes longer in"), f"{abs(b_s - a_s):.1f} s")
    numbers = ("pairs", "A", "B", "difference", "95 %, all scenes")
    yield terminal_table(("passed",), (*numbers, "A touched", "B touched"), rows=rates)
    yield ""
    yield terminal_table(("time (s) where both reached the goal",), numbers, rows=times)
    yield ""
    for what, where in lost.items():
        yield Text(f"{what} {', '.join(where)}", "yellow")
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
