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

ColumnKind: TypeAlias = Literal["text", "name", "long", "choice", "number", "rate", "class"]
"""Content of a column: words, names, sentences, choices, numbers, rates, classes."""

MAX_ROWS: Final = 500
"""Most rows of a list; the files beside the report have all."""

PLAIN_ROWS: Final = 40
"""Rows of a table without a script."""


@dataclass(frozen=True, slots=True)
class Column:
    """A column; `label` is its head."""

    label: str
    kind: ColumnKind = "text"


def columns(kind: ColumnKind, *labels: str) -> list[Column]:
    """Columns of one kind."""
    return [Column(label, kind) for label in labels]


@dataclass(frozen=True, slots=True)
class Table:
    """Rows of the page, which can be sorted and filtered if they have a key.

    Attributes:
        rows: Cells; of rates as of `rate_cell`. With a key all are JSON values.
        key: Id in the page; empty for a short table without a script.
        where: File with all rows, for pages without a script.
        totals: Indices of stressed rows.
        failing: Number of configurations with failures, which the script shows first.
        style: `share` for shares of failures.
    """

    columns: Sequence[Column]
    rows: Sequence[Sequence[Any]] = field(repr=False)
    key: str = ""
    where: str = "verdicts.parquet"
    totals: Sequence[int] = ()
    failing: int = 0
    style: str = ""

    @property
    def plain(self) -> Sequence[Sequence[Any]]:
        """The rows of the plain table."""
        return self.rows[:PLAIN_ROWS] if self.key else self.rows

    @property
    def classes(self) -> str:
        """Names for the style sheet."""
        rates = sum(column.kind == "rate" for column in self.columns)
        roomy = "roomy" if len(self.columns) <= 5 and rates <= 2 else ""
        width = "crowded" if len(self.columns) > 7 else roomy
        return " ".join(filter(None, ("card scroll", self.style, width if self.key else "")))

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
    """A rate and its interval as a small picture."""
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


def rate_html(cell: Sequence[float]) -> Markup:
    """A rate's cell: its words, and a picture of it."""
    said = rate_words(cell)
    html = Markup("{} <small>{}</small>{}").format(said["rate"], said["of"], bar(cell))
    html += Markup("<small>{}</small>").format(said["span"]) if said["span"] else ""
    return html + (Markup("<br><small>{}</small>").format(said["rest"]) if said["rest"] else "")
