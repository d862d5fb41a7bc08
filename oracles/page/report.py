"""The report: one self-contained HTML file from a campaign directory."""

import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np
from jinja2 import Environment, StrictUndefined
from markupsafe import Markup

from vastflow.oracles.evidence.causes import causes_json, criteria_json
from vastflow.oracles.evidence.evidence import evidence_json
from vastflow.oracles.evidence.findings import findings_json, shape_of
from vastflow.oracles.evidence.headline import robot_text
from vastflow.oracles.evidence.wide import wide_table, write_wide
from vastflow.oracles.figures.drawing import Before
from vastflow.oracles.figures.style import CLASS_COLORS, plain_style
from vastflow.oracles.page import sections, words
from vastflow.oracles.page.call import finish_report
from vastflow.oracles.page.facts import Facts
from vastflow.oracles.page.failures import failed_section, why_section, worst_section
from vastflow.oracles.page.pictures import MAX_EMBEDDED, contrast_pictures
from vastflow.oracles.page.search_section import search_section
from vastflow.oracles.page.section import Picture, Section, bar, rate_cell, rate_html
from vastflow.oracles.results.schema import floats
from vastflow.oracles.results.tables import read_tables
from vastflow.sim.model.files import Unreadable, yaml_value

SECTIONS: Final = (
    search_section,
    why_section,
    worst_section,
    sections.maps_section,
    sections.factors_section,
    sections.configurations_section,
    failed_section,
    sections.rates_section,
    sections.classes_section,
    sections.measured_section,
    sections.poses_section,
    sections.coverage_section,
    sections.untested_section,
    sections.method_section,
)
"""Sections in their order; each is None if it has nothing to show."""

_FINDING: Final = re.compile(r'contrast">\s*<p>(.*?)</p>|<li class="(?:bad|good|warn)">(.*?)</li>', re.DOTALL)
_PAGE: Final = Path(__file__).parent
_FILTERS: Final = {
    **vars(words),
    "rate": rate_html,
    "bar": bar,
    "cell": rate_cell,
    "kind": lambda of: type(of).__name__,
}


@dataclass(frozen=True)
class Lasting:
    """A written report: its headline as JSON, and names of figures by the keys of their drawings."""

    headline: dict[str, Any]
    drawn: dict[str, str]


def write_report(directory: Path) -> dict[str, Any]:
    """Write `evidence.json`, `runs_wide.parquet`, `figures/` and `report.html` into the campaign directory `directory`.

    Returns:
        The campaign's headline as JSON.

    Raises:
        OSError: a table that should be there is not.
        ValueError: a table is damaged.
    """
    lasting = write_lasting(directory)
    finish_report(directory)
    return lasting.headline


@plain_style()
def write_lasting(directory: Path, before: Before = lambda key: None) -> Lasting:
    """Write a report without what differs from call to call, which `finish_report` adds.

    Args:
        before: Gives drawings of earlier reports that the same code made.

    Raises:
        OSError: a table that should be there is not.
        ValueError: a table is damaged.
    """
    tables = read_tables(directory)
    write_wide(directory, wide_table(tables))  # before the facts, as it takes most memory of all
    facts = Facts(tables, before)
    said = {
        **findings_json(facts.findings),
        "causes": causes_json(facts.causes),
        "stood_still": {"runs": facts.stood.runs, **asdict(facts.stood)},
        "separates_nothing": criteria_json(facts.criteria),
    }
    shown = [found for section in SECTIONS if (found := section(facts)) is not None]
    contrasts = contrast_pictures(facts.findings.designs)
    pictures = [*contrasts.values(), *(picture for section in shown for picture in section.pictures)]
    figures = directory / "figures"
    figures.mkdir(exist_ok=True)
    films = [film for section in shown for film in section.films]
    for picture in pictures:
        picture.drawing.take(before)
        (figures / f"{picture.name}.png").write_bytes(picture.png)
        (figures / f"{picture.name}.svg").write_bytes(picture.svg)
    for film in films:
        (figures / f"{film.name}.mp4").write_bytes(film.mp4)
    page = _html(facts, shown, contrasts, _embedded(pictures))
    said["findings"] = _findings_in(page)
    with open(directory / "evidence.json", "w", encoding="utf-8") as file:
        file.writelines(evidence_json(tables, facts.evidence, facts.spreads, said))
    (directory / "report.html").write_text(page, encoding="utf-8", errors="backslashreplace")
    drawn = {each.drawing.key: each.name for each in pictures} | {each.drawing.key: each.name for each in films}
    return Lasting(facts.everything.campaign.headline.as_json, drawn)


def _html(
    facts: Facts, shown: Sequence[Section], contrasts: Mapping[tuple[int, str], Picture], embedded: set[str]
) -> str:
    environment = Environment(autoescape=True, undefined=StrictUndefined, trim_blocks=True, lstrip_blocks=True)
    environment.filters.update(_FILTERS)
    runs = facts.tables.runs
    return environment.from_string((_PAGE / "report.html.j2").read_text(encoding="utf-8")).render(
        facts=facts,
        sections=shown,
        contrasts=contrasts,
        embedded=embedded,
        about=_about(facts.tables.campaign),
        simulated_s=float(np.nansum(floats(runs["simulated_s"]))),
        distance_m=float(np.nansum(floats(runs["distance_m"]))),
        shape=shape_of(facts.findings),
        robot=robot_text(facts.metadata),
        class_names=list(CLASS_COLORS),
        places=len(facts.places),
        left_out=sections.left_out(facts),
        style=Markup((_PAGE / "report.css").read_text(encoding="utf-8")),
        script=Markup((_PAGE / "report.js").read_text(encoding="utf-8")),
    )


def _findings_in(page: str) -> list[str]:
    opening = page[page.index('<section class="verdict') : page.index('<nav aria-label="Sections">')]
    return [Markup("".join(each)).striptags() for each in _FINDING.findall(opening)]


def _embedded(pictures: Iterable[Picture]) -> set[str]:
    left = MAX_EMBEDDED
    names = set()
    for picture in sorted(pictures, key=lambda picture: picture.detail):
        left -= len(picture.svg if picture.drawn else picture.png)
        if left >= 0:
            names.add(picture.name)
    return names


def _about(campaign: str) -> Mapping[str, str]:
    try:
        said = yaml_value(campaign)["metadata"]
        return {key: str(said.get(key) or "") for key in ("title", "description")}
    except (Unreadable, KeyError, TypeError, AttributeError):
        return {"title": "", "description": ""}
