"""The report: one HTML file that stands alone, from nothing but a campaign directory."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any, Final

import numpy as np
from jinja2 import Environment, StrictUndefined
from markupsafe import Markup

from vastflow.oracles.evidence.causes import CauseCount, causes_json, causes_of
from vastflow.oracles.evidence.criteria import criteria_json, criteria_of
from vastflow.oracles.evidence.evidence import Evidence, evidence_json, evidence_of, spreads_of
from vastflow.oracles.evidence.findings import Findings, findings_json, findings_of, shape_of, stopping_rule
from vastflow.oracles.evidence.standstills import Standstills, standstills_of
from vastflow.oracles.evidence.wide import wide_table, write_wide
from vastflow.oracles.figures.palette import CLASS_COLORS
from vastflow.oracles.figures.picture import plain_style
from vastflow.oracles.figures.scene import MAX_SCENES, scenes_of
from vastflow.oracles.judgement.cause import CAUSES, Cause
from vastflow.oracles.page import reasons, rows
from vastflow.oracles.page.pictures import (
    MAX_EMBEDDED,
    Picture,
    all_maps_picture,
    case_picture,
    cause_picture,
    contrast_pictures,
    factor_pictures,
    map_pictures,
    rate_pictures,
    threshold_pictures,
)
from vastflow.oracles.page.search_section import search_section
from vastflow.oracles.page.table import bar, rate_cell, rate_words
from vastflow.oracles.page.words import (
    capital,
    chance,
    criterion_text,
    difference_text,
    factor_text,
    number,
    others_text,
    p_text,
    pair_text,
    percent,
    points,
    sentence,
    span,
)
from vastflow.oracles.page.work_section import with_work
from vastflow.oracles.results.executed import KeptFiles, environment_names
from vastflow.oracles.results.tables import Tables, read_tables
from vastflow.oracles.statistics.classes import passes_that_show, runs_for_a_claim
from vastflow.sim.model.files import Unreadable, yaml_value

_PAGE: Final = Path(__file__).parent
_MOST_LISTED: Final = 200
"""Runs of a configuration up to which the page says how many passes show a class."""


@dataclass(frozen=True, eq=False)
class MapPictures:
    """A map and its pictures."""

    name: str
    size: str
    pictures: Sequence[Picture]


@dataclass(frozen=True, eq=False)
class Gallery:
    """All pictures of a report, by what they are about.

    Attributes:
        contrasts: By design and name of the factor, of those that matter.
        factors: Of each design.
        thresholds: Of the criteria that separate nothing.
        overview: All maps beside each other; None where there is but one.
        causes: By cause, of the run to look at.
        cases: By the index of the configuration.
        search: Of a search; none where the file listed the configurations.
    """

    rates: Sequence[Picture]
    contrasts: Mapping[tuple[int, str], Picture]
    factors: Sequence[Sequence[Picture]]
    thresholds: Sequence[Picture]
    overview: Picture | None
    places: Sequence[MapPictures]
    causes: Mapping[Cause, Picture]
    cases: Mapping[int, Picture]
    search: Sequence[Picture] = ()

    @property
    def pictures(self) -> Iterable[Picture]:
        """All of them, what a reader should have at hand first."""
        yield from self.contrasts.values()
        yield from self.search
        yield from self.causes.values()
        yield from self.cases.values()
        if self.overview is not None:
            yield self.overview
        yield from self.rates
        for found in self.factors:
            yield from found
        yield from self.thresholds
        for place in self.places:
            yield from place.pictures


@plain_style()
def write_report(directory: Path) -> None:
    """Write `evidence.json`, `runs_wide.parquet`, `figures/` and `report.html` into the campaign directory `directory`.

    Raises:
        OSError: a table that should be there is not.
        ValueError: a table is damaged.
    """
    tables = read_tables(directory)
    names = environment_names(directory, dict.fromkeys(filter(None, tables.configurations.environments)))
    evidence, findings = evidence_of(tables), findings_of(tables, names)
    if tables.metadata.get(
        "search"
    ):  # the strategy chose the points by what others came to: no factor can be told from that
        findings = replace(findings, designs=())
    spreads = spreads_of(tables)
    stood, causes, criteria = standstills_of(tables), causes_of(tables), criteria_of(tables)
    said = {
        **findings_json(findings),
        "causes": causes_json(causes),
        "stood_still": {"runs": stood.runs, **asdict(stood)},
        "separates_nothing": criteria_json(criteria),
    }
    (directory / "evidence.json").write_text(evidence_json(tables, evidence, spreads, said), encoding="utf-8")
    write_wide(directory, wide_table(tables))
    scenes, searched = scenes_of(tables), search_section(tables)
    gallery = Gallery(
        list(rate_pictures({oracle: evidence[oracle] for oracle in rows.shown_oracles(evidence)})),
        contrast_pictures(findings.designs),
        factor_pictures(findings.designs),
        list(threshold_pictures(criteria)),
        all_maps_picture(scenes, [names[s.environment] for s in scenes]) if len(scenes) > 1 else None,
        [
            MapPictures(names[s.environment], _size(s.occupancy), list(map_pictures(s, names[s.environment])))
            for s in scenes
        ],
        *_run_pictures(tables, findings, causes),
        search=searched.pictures if searched else (),
    )
    figures = directory / "figures"
    figures.mkdir(exist_ok=True)
    for picture in gallery.pictures:
        (figures / f"{picture.name}.png").write_bytes(picture.png)
        (figures / f"{picture.name}.svg").write_bytes(picture.svg)
    page = _html(
        tables=tables,
        names=names,
        evidence=evidence,
        findings=findings,
        stood=stood,
        criteria=criteria,
        counted=causes,
        gallery=gallery,
        searched=searched,
        environments=rows.environment_table(tables, names),
        places=rows.place_table(scenes, names),
        measured=rows.measured_table(spreads),
    )
    whole = with_work(page, tables.metadata)
    (directory / "report.html").write_text(whole, encoding="utf-8", errors="backslashreplace")


def _run_pictures(
    tables: Tables, findings: Findings, causes: Iterable[CauseCount]
) -> tuple[dict[Cause, Picture], dict[int, Picture]]:
    """Pictures of causes, and those of the worst configurations."""
    files = KeptFiles(tables.directory)
    of_causes = {each.cause: cause_picture(tables, each, files) for each in causes}
    of_cases = {k: case_picture(tables, k, files) for k in rows.cases(tables, findings)}
    return {k: p for k, p in of_causes.items() if p is not None}, {k: p for k, p in of_cases.items() if p is not None}


def _html(
    *,
    tables: Tables,
    names: Mapping[str, str],
    evidence: Mapping[str | None, Evidence],
    findings: Findings,
    stood: Standstills,
    counted: Iterable[CauseCount],
    **found: Any,
) -> str:
    environment = Environment(autoescape=True, undefined=StrictUndefined, trim_blocks=True, lstrip_blocks=True)
    environment.filters.update(
        percent=percent,
        span=span,
        number=number,
        points=points,
        chance=chance,
        sentence=sentence,
        capital=capital,
        words=rate_words,
        bar=bar,
        cell=rate_cell,
        criterion=criterion_text,
        matters=factor_text,
        for_others=others_text,
        together=pair_text,
        p=p_text,
        difference=difference_text,
    )
    gallery: Gallery = found["gallery"]
    embedded = _embedded(gallery.pictures)
    said = tables.verdicts.reasons("fail")
    rule = stopping_rule(tables.metadata)
    most_runs = int(findings.counts[:, :2].sum(axis=1).max(initial=0))
    return environment.from_string((_PAGE / "report.html.j2").read_text(encoding="utf-8")).render(
        name=tables.metadata["name"],
        about=_about(tables.campaign),
        metadata=tables.metadata,
        oracles=tables.oracles,
        evidence=evidence,
        everything=evidence[None],
        families=tables.families,
        findings=findings,
        stood=stood,
        class_names=list(CLASS_COLORS),
        shape=shape_of(findings),
        noun="path" if any(tables.configurations.environments) else "situation",
        most_runs=most_runs,
        shown_by={} if rule is not None or most_runs > _MOST_LISTED else passes_that_show(most_runs),
        least_runs=0 if rule is not None and rule.decidable else min(runs_for_a_claim().values()),
        totals=rows.totals(tables),
        group=evidence[None].campaign,
        family_table=rows.family_table(evidence, stood),
        group_rows=rows.group_rows(evidence),
        shown_oracles=rows.shown_oracles(evidence),
        configurations=rows.configuration_table(tables, evidence, findings, stood, names),
        failing=int(np.count_nonzero(findings.counts[:, 1])),
        undecided=rows.undecided_table(tables, findings),
        causes=[(each, gallery.causes.get(each.cause)) for each in counted],
        meanings=CAUSES,
        failure_kinds=reasons.failure_kinds(tables),
        failures=reasons.failure_table(tables, evidence),
        cases=[
            (rows.case_row(tables, k, findings, said, names), picture)
            for k, picture in _cases(tables, findings, gallery)
        ],
        bases=rows.basis_rows(tables),
        designs=list(zip(findings.designs, gallery.factors, strict=True)),
        rejections=reasons.rejection_rows(tables),
        coverage=rows.coverage_rows(tables),
        duplicates=[
            (name, of)
            for name, of in zip(tables.configurations.names, tables.configurations.duplicate_of, strict=True)
            if of
        ],
        not_judged=reasons.not_judged_rows(tables),
        explanations={oracle: rows.explanation(oracle) for oracle in tables.oracles},
        embedded=embedded,
        campaign_text=tables.campaign,
        max_rows=rows.MAX_ROWS,
        max_scenes=MAX_SCENES,
        style=Markup((_PAGE / "report.css").read_text(encoding="utf-8")),
        script=Markup((_PAGE / "report.js").read_text(encoding="utf-8")),
        **found,
    )


def _cases(tables: Tables, findings: Findings, gallery: Gallery) -> Iterable[tuple[int, Picture | None]]:
    for k in rows.cases(tables, findings):
        yield k, gallery.cases.get(k)


def _embedded(pictures: Iterable[Picture]) -> set[str]:
    """Names of the pictures that the page has room for."""
    left = MAX_EMBEDDED
    names = set()
    for picture in pictures:
        left -= len(picture.svg if picture.drawn else picture.png)
        if left >= 0:
            names.add(picture.name)
    return names


def _about(campaign: str) -> Mapping[str, str]:
    """Title and description of the campaign, empty where its file has none."""
    try:
        said = yaml_value(campaign)["metadata"]
        return {key: str(said.get(key) or "") for key in ("title", "description")}
    except (Unreadable, KeyError, TypeError, AttributeError):
        return {"title": "", "description": ""}


def _size(occupancy: Any) -> str:
    (height, width), resolution_m = occupancy.shape, occupancy.resolution_m
    return f"{width * resolution_m:.1f} m × {height * resolution_m:.1f} m"
