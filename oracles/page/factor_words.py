"""Factor words: what the report says of a factor, in sentences."""

from itertools import groupby

from vastflow.oracles.page.words import points
from vastflow.oracles.statistics.effects import Claim, FactorEffect, LevelEffect
from vastflow.oracles.statistics.interactions import InteractionEffect


def factor_text(factor: FactorEffect, noun: str) -> str:
    """`robot_radius matters on these 4 paths: 0.45 fails 20 of 20 runs, 0.2 and 0.3 none of 40 (p ≤ 0.0001). For other paths: p = 0.012.`

    Args:
        noun: What a situation is, such as `path`.
    """
    if not factor.these.shown:
        told = (
            f"; on these {noun}s it is not shown ({p_text(factor.these)})" if factor.these.p_value is not None else ""
        )
        return f"{factor.name} matters for {noun}s like these ({p_text(factor.others)}): {_levels_text(factor)}{told}."
    where = f"these {factor.situations} {noun}s" if factor.situations > 1 else f"this {noun}"
    said = f"{factor.name} matters on {where}: {_levels_text(factor)} ({p_text(factor.these)})."
    return f"{said} {others_text(factor, noun)}"


def others_text(factor: FactorEffect, noun: str) -> str:
    """Whether it is shown for other situations, and if not, what would be needed."""
    if factor.needed is not None and not factor.others.shown:
        some = f"{factor.situations} {noun}s" if factor.situations > 1 else f"One {noun}"
        return f"{some} cannot show it for other {noun}s; {factor.needed} can."
    if factor.others.adjusted is None:
        return f"For other {noun}s it cannot be told: {factor.others.note}."
    shown = "" if factor.others.shown else ", which shows nothing"
    return f"For other {noun}s: {p_text(factor.others)}{shown}."


def pair_text(pair: InteractionEffect) -> str:
    """`noise and speed act together (p = 0.012)`."""
    return f"{pair.names[0]} and {pair.names[1]} act together ({p_text(pair.claim)})"


def p_text(claim: Claim) -> str:
    """`p = 0.012`, adjusted for all that its table asks."""
    return f"p {p_value_text(claim.adjusted)}" if claim.adjusted is not None else "p unknown"


def p_value_text(p_value: float) -> str:
    """`= 0.012`; of a very small one what random orders can show."""
    return "≤ 0.0001" if p_value <= 1.05e-4 else f"= {p_value:.2g}" if p_value < 0.995 else "= 1"


def difference_text(level: LevelEffect) -> str:
    """`+64 (+42 … +80)` points."""
    if level.difference is None or level.difference_interval is None:
        return "–"
    low, high = level.difference_interval
    return f"{points(level.difference)} ({points(low)} … {points(high)})"


def _levels_text(factor: FactorEffect) -> str:
    """Failures of the levels, the worst first; levels without any failure, and those that always fail, together."""
    worst = sorted(factor.levels, key=lambda level: -level.failed / max(level.runs, 1))
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
