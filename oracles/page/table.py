"""Tables of the page: as plain HTML, and as the data that its script sorts and filters."""

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, Final, Literal, TypeAlias

from markupsafe import Markup

from vastflow.oracles.evidence.evidence import Evidence, configuration_intervals
from vastflow.oracles.evidence.rates import Counts
from vastflow.oracles.page.words import percent, span_of
from vastflow.oracles.statistics.intervals import thousandths

ColumnKind: TypeAlias = Literal["text", "choice", "number", "rate", "class", "code"]
"""What a column has: words, words that can be chosen from, numbers, rates, classes of configurations, commands."""

PLAIN_ROWS: Final = 40
"""Rows that the page has without its script; `evidence.json` and the parquet files have all."""


@dataclass(frozen=True, slots=True)
class Column:
    """A column; `label` is its head."""

    label: str
    kind: ColumnKind = "text"


@dataclass(frozen=True, slots=True)
class DataTable:
    """Rows that can be sorted and filtered.

    Attributes:
        key: Its id in the page.
        rows: Cells as JSON values; of a rate what `rate_cell` gives.
        where: Where all rows are, for readers of a page without its script.
    """

    key: str
    columns: Sequence[Column]
    rows: Sequence[Sequence[Any]] = field(repr=False)
    where: str = "verdicts.parquet"

    @property
    def plain(self) -> Sequence[Sequence[Any]]:
        """The rows of the plain table."""
        return self.rows[:PLAIN_ROWS]

    @property
    def data(self) -> Markup:
        """Kinds and rows as JSON that may stand in a page."""
        content = {"kinds": [column.kind for column in self.columns], "rows": self.rows}
        text = json.dumps(content, ensure_ascii=False, separators=(",", ":"), allow_nan=False)
        return Markup(text.replace("<", "\\u003c").replace("&", "\\u0026"))


def rate_cell(counts: Counts) -> list[float]:
    """Passed, judged, not judged, and the interval's ends in thousandths."""
    return [counts.passed, counts.judged, counts.not_judged, *counts.interval.thousandths]


def configuration_cells(evidence: Evidence) -> dict[str, list[float]]:
    """`rate_cell` of each configuration."""
    ends = thousandths(configuration_intervals(evidence)).tolist()
    return {
        name: [counts.passed, counts.judged, counts.not_judged, *interval]
        for (name, counts), interval in zip(evidence.configurations.items(), ends, strict=True)
    }


def bar(cell: Sequence[float]) -> Markup:
    """A rate and its interval as a small picture; says nothing that is not beside it in words."""
    passed, judged, _, low, high = cell
    if not judged:
        return Markup("")
    style = f"--l:{low / 10:.1f}%;--w:{(high - low) / 10:.1f}%;--a:{100 * passed / judged:.1f}%"
    return Markup('<span class="bar" style="{}" aria-hidden="true"></span>').format(style)


def rate_words(cell: Sequence[float]) -> Mapping[str, str]:
    """The words of a rate's cell."""
    passed, judged, not_judged, low, high = cell
    if not judged:
        return {"rate": "–", "of": "not judged" if not_judged else "not run", "span": "", "rest": ""}
    return {
        "rate": percent(passed / judged),
        "of": f"{passed:,.0f} of {judged:,.0f}",
        "span": span_of(int(low), int(high)),
        "rest": f"{not_judged:,.0f} not judged" if not_judged else "",
    }
