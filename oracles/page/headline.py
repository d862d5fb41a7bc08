"""The headline of a campaign, as a notebook shows it: rate, causes, and a few of the report's figures."""

import base64
from collections.abc import Iterator
from pathlib import Path
from typing import Final

from markupsafe import Markup

from vastflow.oracles.evidence.causes import CauseCount, causes_of
from vastflow.oracles.evidence.evidence import evidence_of
from vastflow.oracles.judgement.cause import CAUSES
from vastflow.oracles.page.words import capital, percent, sentence, span
from vastflow.oracles.results.tables import read_tables

_FIGURES: Final = ("maps", "final-poses-*", "failure-rate-*", "passed-*")
"""Names of figures, what tells most first; the first two that there are."""

_PAGE: Final = Markup(
    '<div style="max-width:60rem"><p style="margin:0"><b style="font-size:2em">{rate}</b> of the judged runs passed: '
    "{passed:,} of {judged:,}, {unjudged:,} not judged overall.{interval}</p>\n{causes}{figures}"
    "<p><code>{report}</code></p></div>"
)
_ROW: Final = Markup(
    '<tr><td style="text-align:left"><b>{}</b></td><td>{:,}</td><td style="text-align:left">{}</td>'
    '<td style="text-align:left"><code>vastflow replay . {} {}</code></td></tr>\n'
)
_FIGURE: Final = Markup(
    '<img style="background:#fff;max-width:49%;height:auto" alt="{}" src="data:image/png;base64,{}">\n'
)


def headline_html(directory: Path) -> str:
    """The headline of the campaign directory `directory`, with nothing beside it that a notebook would have to fetch.

    Raises:
        OSError, ValueError: no campaign directory, or a damaged one.
    """
    tables = read_tables(directory)
    counts = evidence_of(tables)[None].campaign.counts
    interval = f" 95 % interval {span(counts.interval)} for these configurations." if counts.judged else ""
    return _PAGE.format(
        rate=percent(counts.rate),
        passed=counts.passed,
        judged=counts.judged,
        unjudged=counts.not_judged,
        interval=interval,
        causes=_causes(causes_of(tables)),
        figures=Markup("").join(_figures(directory / "figures")),
        report=directory / "report.html",
    )


def _causes(found: tuple[CauseCount, ...]) -> Markup:
    if not found:
        return Markup("")
    rows = [
        _ROW.format(capital(each.cause), each.runs, sentence(CAUSES[each.cause]), each.configuration, each.run_index)
        for each in found
    ]
    head = Markup('<tr><th style="text-align:left">Why runs failed</th><th>Runs</th><th></th><th></th></tr>\n')
    return Markup("<table>{}{}</table>\n").format(head, Markup("").join(rows))


def _figures(folder: Path) -> Iterator[Markup]:
    found = [file for name in _FIGURES for file in sorted(folder.glob(f"{name}.png"))][:2]
    for file in found:
        yield _FIGURE.format(file.stem.replace("-", " "), base64.b64encode(file.read_bytes()).decode())
