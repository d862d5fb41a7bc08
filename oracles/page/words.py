"""Words: rates, intervals, numbers, values, and factors as people read them."""

import json
from collections.abc import Mapping
from itertools import groupby
from typing import Any

from markupsafe import Markup

from vastflow.oracles.evidence.causes import Criterion
from vastflow.oracles.evidence.headline import percent_text, span_text
from vastflow.oracles.results.units import Units
from vastflow.oracles.statistics.analysis import FactorAnalysis
from vastflow.oracles.statistics.classes import ClassName
from vastflow.oracles.statistics.effects import Claim, FactorEffect, InteractionEffect, LevelEffect
from vastflow.oracles.statistics.intervals import Interval
from vastflow.oracles.statistics.measured import MetricEffect
from vastflow.oracles.statistics.power import Power


def percent(rate: float | None) -> str:
    return "–" if rate is None else unbroken(percent_text(rate))


def span(interval: Interval) -> str:
    """An interval as of `span_of`."""
    return span_of(*interval.thousandths)


def span_of(low: int, high: int) -> str:
    """An interval as of `span_text`, on one line."""
    return unbroken(span_text(low, high))


def unbroken(text: str) -> str:
    """`text` without places where a line of a page may end."""
    return text.replace("–", "\N{WORD JOINER}–\N{WORD JOINER}").replace(" ", "\N{NO-BREAK SPACE}")


def points(difference: float) -> str:
    """A difference of rates in percentage points, with its sign: `+12`."""
    said = f"{100 * difference:+.0f}"
    return "+0" if said == "-0" else said.replace("-", "−")


def chance(p_value: float | None) -> str:
    """A p-value: `0.012`, `< 0.001`."""
    if p_value is None:
        return "–"
    return "< 0.001" if p_value < 0.001 else f"{p_value:.3f}" if p_value < 0.1 else f"{p_value:.2f}"


def plural(n: int, noun: str) -> str:
    return f"{n:,} {noun}{'' if n == 1 else 's'}"


def tag(name: str) -> Markup:
    """The name of a class of configurations, with its color."""
    return Markup('<span class="tag"><i class="{0}"></i>{0}</span>').format(name)


def capital(text: str) -> str:
    return f"{text[:1].upper()}{text[1:]}"


def sentence(text: str) -> str:
    """`text` with a capital letter and a full stop."""
    return capital(text).rstrip(".") + "."


def number(value: float | None) -> str:
    """A measured number with three significant digits, none beyond the third decimal."""
    if value is None:
        return "–"
    value = round(value, 3) + 0.0  # + 0.0 turns -0.0 into 0.0
    text = f"{value:,.0f}" if abs(value) >= 100 or value == int(value) else f"{value:.3g}"
    return text.replace("-", "−")


def criterion_text(criterion: Criterion) -> str:
    """`robustness separates nothing here: all 480 judged runs fail, and the least update is 2.57 m, 8.6 times the threshold`."""
    said = f"separates nothing here: all {criterion.runs:,} judged runs {'pass' if criterion.passes else 'fail'}"
    score, nearest = criterion.score, criterion.nearest
    if score is None or nearest is None:
        return said
    value, threshold = float(score.values[nearest]), float(score.thresholds[nearest])
    unit = "" if score.unit in ("", "1") else f"\N{NO-BREAK SPACE}{score.unit}"
    end = "least" if score.is_margin == criterion.passes else "greatest"
    what = f"{said}, and the {end} {score.metric.replace('_', ' ')} is {number(value)}{unit}"
    return f"{what}; below 0 fails" if score.is_margin else f"{what}, {value / threshold:.2g} times the threshold"


def position(x_m: float, y_m: float) -> str:
    """A place on a map in meters."""
    return f"({x_m:.2f}, {y_m:.2f}) m".replace("-", "−")


def short(value: Any) -> str:
    """A value as a table cell: poses by place, lists by length, files by digest."""
    if isinstance(value, float):
        return number(value)
    if isinstance(value, list):
        return f"{len(value)} of them" if len(value) != 1 else "one"
    if isinstance(value, dict):
        if isinstance(at := value.get("position", value), dict) and "x" in at:
            return position(at["x"], at["y"])
        if set(value) == {"file"}:
            return str(value["file"])[:8]
        return json.dumps(value, ensure_ascii=False)
    return str(value)


def factor_text(factor: FactorEffect, units: Units) -> str:
    """`radius matters on these 4 paths: 0.45 fails 20 of 20 runs (p ≤ 0.0001). …`"""
    if not factor.these.shown:
        told = (
            f"; on these {units.noun}s it is not shown ({p_text(factor.these)})"
            if factor.these.p_value is not None
            else ""
        )
        said = f"{factor.name} matters for other {units.others} ({p_text(factor.others)})"
        return f"{said}: {_levels_text(factor)}{told}."
    said = f"{factor.name} matters on {_these(factor, units)}: {_levels_text(factor)} ({p_text(factor.these)})."
    return f"{said} {others_text(factor, units)}"


def _these(effect: FactorEffect | MetricEffect, units: Units) -> str:
    return f"these {effect.situations} {units.noun}s" if effect.situations > 1 else f"this {units.noun}"


def metric_text(effect: MetricEffect, units: Units) -> str:
    """`controller matters for the time on these 7 paths: MPPI 36.8 s, DWB 18.5 s (p ≤ 0.0001). …`"""
    unit = "" if effect.unit in ("", "1") else f"\N{NO-BREAK SPACE}{effect.unit}"
    means = sorted(zip(effect.means, effect.levels, strict=True), reverse=True)
    listed = ", ".join(f"{level} {number(mean)}{unit}" for mean, level in means)
    (most, highest), (least, lowest) = means[0], means[-1]
    said = (
        f"{effect.name} matters for the {effect.metric} on {_these(effect, units)}: {listed} ({p_text(effect.these)})."
    )
    if not effect.these.shown:
        said = f"{effect.name} matters for the {effect.metric} on other {units.others}: {listed}."
    apart = f"{highest} is above {lowest} in {effect.above} of {effect.sets} situations, by {number(most - least)}{unit} on average"
    ends = effect.interval if effect.others.shown else None
    if ends is not None and (ends[0] > 0 or ends[1] < 0):
        apart += f" ({number(ends[0])} … {number(ends[1])} on other {units.others})"
    return f"{said} {apart}. {others_text(effect, units)} {reached_text(effect)}"


def reached_text(effect: MetricEffect) -> str:
    """`Compared where all reached the goal: 40 of 42 rounds.`"""
    why = f"where fewer than half of the runs did, or have a known {effect.metric}"
    out = f", without {', '.join(effect.left_out)}, {why}" if effect.left_out else ""
    return f"Compared where all reached the goal: {effect.rounds:,} of {plural(effect.of, 'round')}{out}."


def power_text(power: Power, units: Units) -> str:
    """`So many runs show 35 points on these paths in 8 of 10 campaigns, …`"""
    these, others = (None if each is None else f"{100 * each:.0f} points" for each in (power.these, power.others))
    here = f"{these or 'no effect'} on these {units.noun}s in 8 of 10 campaigns"
    return f"So many runs show {here}, and {others or 'none, however large,'} for other {units.others}."


def class_needs_text(runs: int, needs: Mapping[ClassName, int]) -> str:
    """`3 runs of a configuration can't show that it is flaky (at least 10), …`, or empty."""
    by_runs: dict[int, list[str]] = {}
    for name, least in sorted(needs.items()):
        if runs < least:
            by_runs.setdefault(least, []).append(name)
    parts = [f"{' or '.join(names)} (at least {least})" for least, names in sorted(by_runs.items())]
    return f"{plural(runs, 'run')} of a configuration cannot show that it is {', or '.join(parts)}." if parts else ""


def others_text(effect: FactorEffect | MetricEffect, units: Units) -> str:
    """Whether an effect is shown for other situations, and if not, the situations needed."""
    if effect.needed is not None and not effect.others.shown:
        some = f"{effect.situations} {units.noun}s" if effect.situations > 1 else f"One {units.noun}"
        said = f"{some} cannot show it for other {units.others}; {effect.needed.fewest} only if all agree"
        enough = effect.needed.enough
        return f"{said}{'' if enough is None else f', and about {enough} show 30 points in 8 of 10 campaigns'}."
    if effect.others.adjusted is None:
        return f"For other {units.others} it cannot be told: {effect.others.note}."
    shown = "" if effect.others.shown else ", which shows nothing"
    return f"For other {units.others}: {p_text(effect.others)}{shown}."


def powerless_text(found: FactorAnalysis, units: Units) -> str:
    """`6 paths are too few to show, for other paths on this map, an effect of a, …`, or empty."""
    noun = units.noun
    names, pairs = found.powerless
    claims = [f"an effect of {' or '.join(names)}"] if names else []
    claims += [f"any of {pairs} interactions" if pairs > 1 else "an interaction"] if pairs else []
    few = f"{plural(found.blocks, noun)} {'is' if found.blocks == 1 else 'are'} too few to show, for other {units.others}, "
    return f"{few}{', or '.join(claims)}, however large." if claims else ""


def pair_text(pair: InteractionEffect) -> str:
    """`noise and speed act together (p = 0.012)`."""
    return f"{pair.names[0]} and {pair.names[1]} act together ({p_text(pair.claim)})"


def p_text(claim: Claim) -> str:
    """`p = 0.012`, adjusted."""
    if (p := claim.adjusted) is None:
        return "p unknown"
    return "p ≤ 0.0001" if p <= 1.05e-4 else f"p = {p:.2g}" if p < 0.995 else "p = 1"  # the bound of random orders


def difference_text(level: LevelEffect) -> str:
    """`+64 (+42 … +80)` points."""
    if level.difference is None or level.difference_interval is None:
        return "–"
    low, high = level.difference_interval
    return f"{points(level.difference)} ({points(low)} … {points(high)})"


def _levels_text(factor: FactorEffect) -> str:
    """Failures of the levels with runs, the worst first; levels that never fail, or always fail, together."""
    compared = [level for level in factor.levels if level.runs] or factor.levels
    worst = sorted(compared, key=lambda level: -level.failed / max(level.runs, 1))
    if len(worst) > 5:
        worst = [worst[0], worst[-1]]
    parts: list[str] = []
    for share, alike in groupby(worst, key=lambda level: level.failed / max(level.runs, 1)):
        group = list(alike)
        for together in [group] if share in (0.0, 1.0) else [[level] for level in group]:
            names = [level.level for level in together]
            failed, runs = sum(level.failed for level in together), sum(level.runs for level in together)
            listed = f"{', '.join(names[:-1])} and {names[-1]}" if len(names) > 1 else names[0]
            fails = ("fail" if len(names) > 1 else "fails") + " " if failed or not parts else ""
            parts.append(f"{listed} {fails}{failed if failed else 'none'} of {runs}{' runs' if not parts else ''}")
    return ", ".join(parts)
