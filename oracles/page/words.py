"""Words: rates, intervals, numbers and values as people read them."""

import json
from typing import Any, Final

from vastflow.oracles.evidence.criteria import Criterion
from vastflow.oracles.evidence.rates import Interval

_NARROW: Final = 50
"""Thousandths; from there on a digit behind the point says nothing."""


def percent(rate: float | None) -> str:
    """A rate for people: whole percent, more digits where they would round away the last pass or failure."""
    if rate is None:
        return "–"
    for digits in (0, 1, 2, 3):
        text = f"{100 * rate:.{digits}f}"
        if rate in (0.0, 1.0) or float(text) not in (0.0, 100.0):
            break
    return f"{text}\N{NO-BREAK SPACE}%"


def span(interval: Interval) -> str:
    """An interval for people, see `span_of`."""
    return span_of(*interval.thousandths)


def span_of(low: int, high: int) -> str:
    """An interval from its ends in thousandths: `52–71 %`, rounded outwards, with a digit more where it is narrow."""
    ends = (low / 10, high / 10) if high - low < _NARROW else (low // 10, -(-high // 10))
    return "\N{WORD JOINER}–\N{WORD JOINER}".join(str(end) for end in ends) + "\N{NO-BREAK SPACE}%"


def points(difference: float) -> str:
    """A difference of rates in percentage points, with its sign: `+12`."""
    said = f"{100 * difference:+.0f}"
    return "+0" if said == "-0" else said.replace("-", "−")


def chance(p_value: float | None) -> str:
    """A p-value: `0.012`, `< 0.001`."""
    if p_value is None:
        return "–"
    return "< 0.001" if p_value < 0.001 else f"{p_value:.3f}" if p_value < 0.1 else f"{p_value:.2f}"


def capital(text: str) -> str:
    """`text` with a capital letter."""
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
    """Where something is on a map, in meters."""
    return f"({x_m:.2f}, {y_m:.2f}) m".replace("-", "−")


def short(value: Any) -> str:
    """A value in a table's cell: of a pose where it is, of a list how many there are, of a file its digest."""
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
