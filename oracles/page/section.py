"""Sections of the report: a title, a summary, and the texts, figures, and tables below them."""

import base64
import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, Final, Literal, TypeAlias

from markupsafe import Markup

from vastflow.oracles.evidence.evidence import Evidence
from vastflow.oracles.figures.drawing import Drawing
from vastflow.oracles.page.film import Film
from vastflow.oracles.page.words import percent, span_of
from vastflow.oracles.statistics.intervals import Counts
from vastflow.oracles.statistics.looks import Mean

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
        """Return column kinds and rows as JSON that is safe to embed in HTML."""
        content = {"kinds": [column.kind for column in self.columns], "rows": self.rows}
        text = json.dumps(content, ensure_ascii=False, separators=(",", ":"), allow_nan=False)
        return Markup(text.replace("<", "\\u003c").replace("&", "\\u0026"))


@dataclass(frozen=True, slots=True)
class Picture:
    """A figure of the report.

    Attributes:
        name: File name below `figures/`, without suffix.
        title: Empty below a heading.
        drawn: Whether the page has the SVG and not the PNG.
        density: Whether it shows a density and not single runs.
        wide: Whether it takes the whole width of the page.
        detail: Whether it shows one map, and is left out first of a full page.
    """

    name: str
    title: str
    alt: str
    caption: str
    drawing: Drawing = field(repr=False)
    drawn: bool = False
    density: bool = False
    wide: bool = False
    detail: bool = False

    @property
    def png(self) -> bytes:
        return self.drawing.files["png"]

    @property
    def svg(self) -> bytes:
        return self.drawing.files["svg"]

    @property
    def size(self) -> tuple[int, int]:
        """Width and height of the PNG in pixels."""
        width, height = (int.from_bytes(self.png[at : at + 4], "big") for at in (16, 20))
        return width, height

    @property
    def source(self) -> str:
        """The picture as a `data:` address."""
        kind, content = ("svg+xml", self.svg) if self.drawn else ("png", self.png)
        return f"data:image/{kind};base64,{base64.b64encode(content).decode()}"


Block: TypeAlias = Markup | Picture | Table


@dataclass(frozen=True, eq=False)
class Section:
    """A section of the page.

    Attributes:
        key: Its anchor, and the name of its text in the template.
        link: Its name in the navigation.
        summary: Text beside the title of a folded section.
        content: Texts, figures, and tables below its text.
        folded: Whether it is hidden until opened.
        values, figures, films: Values, figures, and films of the text in the template.
    """

    key: str
    link: str
    title: str
    summary: str = ""
    content: Sequence[Block] = ()
    folded: bool = True
    values: Mapping[str, Any] = field(default_factory=dict)
    figures: Sequence[Picture] = ()
    films: Sequence[Film] = ()

    @property
    def pictures(self) -> list[Picture]:
        """All of its pictures, in their order."""
        return [*self.figures, *(block for block in self.content if isinstance(block, Picture))]


def rate_cell(counts: Counts, mean: Mean | None) -> list[float | None]:
    """Passed, judged, not judged, the interval's ends in thousandths, and the rate; None for points that a search chose."""
    ends = mean[1].thousandths if mean else (None, None)
    return [counts.passed, counts.judged, counts.not_judged, *ends, mean[0] if mean else None]


def configuration_cells(evidence: Evidence) -> dict[str, list[float | None]]:
    """`rate_cell` of each configuration."""
    of = evidence.families.values()
    return {name: rate_cell(counts, group.means[name]) for group in of for name, counts in group.by_name.items()}


def bar(cell: Sequence[Any]) -> Markup:
    """A rate and its interval as a small picture."""
    *_, low, high, rate = cell
    if rate is None:
        return Markup("")
    style = f"--l:{low / 10:.1f}%;--w:{(high - low) / 10:.1f}%;--a:{100 * rate:.1f}%"
    return Markup('<span class="bar" style="{}" aria-hidden="true"></span>').format(style)


def rate_html(cell: Sequence[Any]) -> Markup:
    """A rate's cell: its words, and a picture of it."""
    passed, judged, not_judged, low, high, rate = cell
    if not judged:
        return Markup("– <small>{}</small>").format("not judged" if not_judged else "not run")
    html = Markup("<small>{:,.0f} of {:,.0f}</small>").format(passed, judged)
    if rate is not None:
        ends = Markup("{}<small>{}</small>").format(bar(cell), span_of(int(low), int(high)))
        html = Markup("{} ").format(percent(rate)) + html + ends
    return html + (Markup("<br><small>{:,.0f} not judged</small>").format(not_judged) if not_judged else "")
