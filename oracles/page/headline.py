"""The headline of a campaign, as a notebook shows it: its sentence, causes, and a few of the report's figures."""

import base64
from pathlib import Path
from typing import Final

from jinja2 import Environment

from vastflow.oracles.evidence.causes import causes_of
from vastflow.oracles.evidence.evidence import evidence_of
from vastflow.oracles.judgment.cause import CAUSES
from vastflow.oracles.page import words
from vastflow.oracles.results.tables import read_tables
from vastflow.sim.model.files import read_bytes

_FIGURES: Final = ("maps", "final-poses-*", "failure-rate-*", "passed-*")
"""Names of figures by priority; the first two available are shown."""

_PAGE: Final = """\
<div style="max-width:60rem"><p style="margin:0"><b style="font-size:1.4em">{{ headline }}</b><br>\
{{ "{:,}".format(counts.passed) }} of {{ "{:,}".format(counts.judged) }} judged runs passed, {{ "{:,}".format(counts.not_judged) }} not judged overall.</p>
{% if causes %}<table><tr><th style="text-align:left">Why runs failed</th><th>Runs</th><th></th><th></th></tr>
{% for each in causes %}
<tr><td style="text-align:left"><b>{{ each.cause | capital }}</b></td><td>{{ "{:,}".format(each.runs) }}</td>\
<td style="text-align:left">{{ meanings[each.cause] | sentence }}</td>\
<td style="text-align:left"><code>{{ "" if driven else "vastflow replay . " }}{{ each.configuration }} {{ each.run_index }}</code></td></tr>
{% endfor %}
</table>
{% endif %}
{% for name, content in figures %}
<img style="background:#fff;max-width:49%;height:auto" alt="{{ name }}" src="data:image/png;base64,{{ content }}">
{% endfor %}
<p><code>{{ report }}</code></p></div>"""


def headline_html(directory: Path) -> str:
    """The headline of a campaign directory as self-contained HTML.

    Raises:
        OSError, ValueError: no campaign directory, or a damaged one.
    """
    tables = read_tables(directory)
    environment = Environment(autoescape=True, trim_blocks=True)
    environment.filters.update(vars(words))
    files = [file for name in _FIGURES for file in sorted((directory / "figures").glob(f"{name}.png"))][:2]
    campaign = evidence_of(tables)[None].campaign
    return environment.from_string(_PAGE).render(
        headline=campaign.headline.text,
        counts=campaign.counts,
        causes=causes_of(tables),
        driven=tables.driven,
        meanings=CAUSES,
        figures=[(file.stem.replace("-", " "), base64.b64encode(read_bytes(file)).decode()) for file in files],
        report=directory / "report.html",
    )
