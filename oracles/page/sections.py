"""Sections of the report, except for those on failed runs and searches."""

import inspect
import json
import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any, Final

import numpy as np
import pandas as pd
from markupsafe import Markup

from vastflow.oracles.catalog.robustness import DEFAULT_BASIS
from vastflow.oracles.evidence.causes import oracle_parameters
from vastflow.oracles.evidence.findings import stopping_rule
from vastflow.oracles.figures.style import CLASS_COLORS
from vastflow.oracles.judgment.cause import CAUSES
from vastflow.oracles.judgment.registry import known_oracles, oracle_class
from vastflow.oracles.page import pictures
from vastflow.oracles.page.facts import Facts
from vastflow.oracles.page.failures import first_of, kind_of
from vastflow.oracles.page.section import (
    MAX_ROWS,
    Block,
    Column,
    Section,
    Table,
    columns,
    configuration_cells,
    rate_cell,
)
from vastflow.oracles.page.words import class_needs_text, percent, plural, short
from vastflow.oracles.query.scene import MAX_SCENES
from vastflow.oracles.results import coverage
from vastflow.oracles.results.tables import Tables
from vastflow.oracles.statistics.classes import passes_that_show
from vastflow.oracles.statistics.repeatability import repeatability_of

ROBUSTNESS: Final = "robustness"
NAVIGATION: Final = "navigation"
_FINAL: Final = ("final_x", "final_y", "final_yaw")
_BASES: Final = {
    "update": "sum over AMCL's updates",
    "step": "sum over time steps",
    "metre": "sum over meters driven",
    "mean": "mean over time steps",
    "maximum": "greatest",
}
_MOST_LISTED: Final = 200
"""Runs of a configuration up to which the page says how many passes show a class."""


def maps_section(facts: Facts) -> Section | None:
    """The section on where runs failed; None for a campaign without maps."""
    if not facts.maps:
        return None
    found = facts.tables.configurations
    names_of: dict[str, list[str]] = {}
    for k in found.distinct.tolist():
        if environment := found.environments[k]:
            names_of.setdefault(environment, []).append(found.names[k])
    groups = {facts.names[key]: facts.everything.campaign.of(names) for key, names in names_of.items()}
    rows = [[name, rate_cell(group.counts, group.mean)] for name, group in groups.items()]
    scenes, names = [], [facts.names[scene.environment] for scene in facts.scenes]
    for scene, name in zip(facts.scenes, names, strict=True):
        height_m, width_m = (scene.occupancy.resolution_m * n for n in scene.occupancy.shape)
        drawn = [replace(picture, detail=True) for picture in pictures.map_pictures(scene, name)]
        scenes.append((name, f"{width_m:.1f} m × {height_m:.1f} m", drawn))
    overview = [pictures.all_maps_picture(facts.scenes, names)] if len(scenes) > 1 else []
    head = [Column("Map", "choice"), Column("Place"), Column("Failed of visits", "rate")]
    values = {
        "overview": overview,
        "environments": Table([Column("Map"), Column("All oracles", "rate")], rows, "environments"),
        "most": MAX_SCENES,
        "scenes": scenes,
        "places": Table(head, facts.places, "places", style="share"),
    }
    figures = [*overview, *(picture for _, _, drawn in scenes for picture in drawn)]
    return Section("maps", "Where", "Where it happened", folded=False, values=values, figures=figures)


def factors_section(facts: Facts) -> Section | None:
    """The section on factors; None where nothing can be compared."""
    designs = facts.findings.designs
    drawn = pictures.factor_pictures(designs)
    values, figures = {"designs": list(zip(designs, drawn, strict=True))}, [p for found in drawn for p in found]
    title = "What varied and what matters"
    return Section("factors", "What matters", title, folded=False, values=values, figures=figures) if designs else None


def configurations_section(facts: Facts) -> Section:
    """A row for each distinct configuration, the worst first."""
    found, stood = facts.tables.configurations, facts.stood
    cells_of = [configuration_cells(facts.evidence[oracle]) for oracle in facts.shown_oracles]
    rows: list[list[Any]] = []
    for k, name in zip(found.distinct.tolist(), facts.findings.classes.names, strict=True):
        rates = [by_name[found.names[k]] for by_name in cells_of]
        still = [stood.of([found.names[k]])] if stood.runs else []
        rows.append([found.names[k], found.families[k], name, *rates, *still, *_varied_cells(facts, k)])
    # The rate's upper bound, then failures; what was not judged is last.
    rows.sort(key=lambda row: (row[3][4] or (0 if row[3][1] else 1000), row[3][0] - row[3][1]))
    head = [Column("Configuration"), Column("Family", "choice"), Column("Class", "class"), *_rate_columns(facts)]
    head += _varied_columns(facts)
    failing = int(np.count_nonzero(facts.findings.counts[:, 1]))
    table: Block = Table(head, rows, "configurations", "evidence.json", failing=failing)
    summary = f"{plural(failing, 'configuration')} with failures, of {len(rows):,}" if failing else "none failed"
    return Section("all", "Configurations", "Configurations", summary, [table if rows else Markup("<p>None.</p>\n")])


def rates_section(facts: Facts) -> Section:
    """Rates of the campaign, of its families, and by each oracle."""
    shown = {oracle: facts.evidence[oracle] for oracle in facts.shown_oracles}
    rows = [
        [
            *(name, group.configurations),
            *(rate_cell(own.counts, own.mean) for own in (found.families[name] for found in shown.values())),
            *([facts.stood.of(group.by_name)] if facts.stood.runs else []),
        ]
        for name, group in facts.everything.families.items()
    ]
    head = [Column("Family"), Column("Configurations", "number"), *_rate_columns(facts)]
    drawn = list(pictures.rate_pictures(shown))
    values = {"families": Table(head, rows, "families", "evidence.json"), "pictures": drawn}
    summary = "of the campaign, families and oracles, with intervals"
    return Section("rates", "Rates", "Share of passed runs", summary, values=values, figures=drawn)


def classes_section(facts: Facts) -> Section:
    """The section on reliable, systematic, and flaky configurations."""
    findings, found = facts.findings, facts.tables.configurations
    classes, most = findings.classes, facts.most_runs
    summary = ", ".join(f"{classes.count(name):,} {name}" for name in CLASS_COLORS if classes.count(name))
    if classes.count("undecided") == len(classes.names):
        summary = f"all {len(classes.names):,} undecided. {class_needs_text(most, facts.class_needs)}".rstrip(". ")
    many = stopping_rule(facts.metadata) is not None or most > _MOST_LISTED
    rows = [
        [
            *(findings.names[k], found.families[found.distinct[k]]),
            *(int(findings.counts[k, 0]), int(findings.counts[k, :2].sum())),
            round(float(findings.reliable_chance[k]), 3),
        ]
        for k in findings.undecided
    ]
    head = [Column("Configuration"), Column("Family", "choice")]
    head += columns("number", "Passed", "Of judged", "P(rate ≥ 80 %)")
    values = {
        "shown_by": {} if many else passes_that_show(most),
        "undecided": Table(head, rows, "undecided", "evidence.json"),
    }
    return Section("classes", "Classes", "Reliable, systematic, flaky", summary, values=values)


def _rate_columns(facts: Facts) -> list[Column]:
    stood = columns("number", "Stood still") if facts.stood.runs else []
    return [*columns("rate", *(oracle or "All oracles" for oracle in facts.shown_oracles)), *stood]


def measured_section(facts: Facts) -> Section:
    """The spread of each metric, and pass rates at other thresholds."""
    rows = [
        [oracle, name.replace("_", " "), s.minimum, s.median, s.maximum, "" if s.unit == "1" else s.unit, s.n]
        for oracle, metrics in facts.spreads.items()
        for name, s in metrics.items()
        if s.n
    ]
    head = [Column("Oracle", "choice"), Column("Metric"), *columns("number", "Smallest", "Median", "Greatest")]
    thresholds = list(pictures.threshold_pictures(facts.criteria))
    values = {
        "metrics": Table([*head, Column("Unit"), Column("Runs", "number")], rows, "metrics"),
        "thresholds": thresholds,
        "bases": _bases(facts.tables),
    }
    summary = plural(len(rows), "metric")
    return Section("measured", "Measured", "Measured", summary, values=values, figures=thresholds)


def poses_section(facts: Facts) -> Section | None:
    """Accuracy and repeatability of final poses by configuration; None without enough that `navigation` measured."""
    found, verdicts = facts.tables.configurations, facts.tables.verdicts
    metrics = verdicts.metrics(NAVIGATION) if NAVIGATION in facts.tables.oracles else {}
    rows: list[list[Any]] = []
    for k in found.distinct.tolist() if metrics.keys() >= {*_FINAL} else ():
        spread = repeatability_of(*(metrics[each].values[verdicts.rows_of(k)] for each in _FINAL))
        if spread is not None:
            mm = [round(1000 * each, 1) for each in (spread.accuracy_m, spread.repeatability_m)]
            turns = [round(math.degrees(each), 2) for each in (spread.yaw_accuracy_rad, spread.yaw_repeatability_rad)]
            rows.append([found.names[k], found.families[k], spread.ends, *mm, *turns, *_varied_cells(facts, k)])
    if not rows:
        return None
    rows.sort(key=lambda row: -row[4])
    numbers = ("Reached", "Accuracy (mm)", "Repeatability (mm)", "Yaw accuracy (°)", "Yaw repeatability (°)")
    head = [Column("Configuration"), Column("Family", "choice"), *columns("number", *numbers), *_varied_columns(facts)]
    text = Markup(
        '<p class="soft">Accuracy is the distance of the mean final position from the goal, repeatability the mean distance from that'
        " position and three standard deviations, as in ISO 9283: of true poses, over the runs that reached the goal.</p>"
    )
    summary = f"accuracy up to {max(row[3] for row in rows):g} mm, repeatability up to {rows[0][4]:g} mm"
    table = Table(head, rows, "poses", "runs_wide.parquet")
    return Section("poses", "Final poses", "Accuracy and repeatability of final poses", summary, [text, table])


def _varied_cells(facts: Facts, k: int) -> list[Any]:
    factors = facts.tables.configurations.factors[k]
    return [factors.get(key) if numeric else facts.factor(k, key) for key, numeric in facts.varied.items()]


def _varied_columns(facts: Facts) -> list[Column]:
    return [Column(key, "number" if numeric else "text") for key, numeric in facts.varied.items()]


def method_section(facts: Facts) -> Section:
    """The section on methods and versions."""
    values = {"meanings": CAUSES, "explanations": {oracle: _explanation(oracle) for oracle in facts.tables.oracles}}
    summary = "how all of this is computed, and with which versions"
    return Section("method", "Method", "Method", summary, values=values)


def _explanation(oracle: str) -> Mapping[str, Any]:
    if oracle not in known_oracles():  # a file's name would be looked for in whatever folder this process works in
        return {"text": "An oracle of the campaign's own, see its file.", "defaults": {}}
    found = oracle_class(oracle)
    paragraphs = (inspect.getdoc(found) or "").split("\n\n")
    fields = found.Parameters.model_fields
    return {
        "text": " ".join(" ".join(p for p in paragraphs if not p.startswith("Metrics:")).replace("`", "").split()),
        "defaults": {name: field.default for name, field in fields.items() if not field.is_required()},
    }


def _bases(tables: Tables) -> Table:
    metrics = tables.verdicts.metrics(ROBUSTNESS) if ROBUSTNESS in tables.oracles else {}
    judged_by = oracle_parameters(tables, ROBUSTNESS).get("basis", DEFAULT_BASIS)
    rows: list[list[Any]] = []
    for name, means in _BASES.items():
        if not {name, "threshold"} <= metrics.keys():
            continue
        known = np.isfinite(metrics[name].values) & np.isfinite(metrics["threshold"].values)
        values, threshold = metrics[name].values[known], metrics["threshold"].values[known]
        if len(values):
            quantiles = np.quantile(values, (0.5, 0.95, 1.0)).tolist()
            said = f"{name}, judged by" if name == judged_by else name
            rows.append([said, means, *quantiles, percent(float((values > threshold).mean())), len(values)])
    numbers = columns("number", "Median (m)", "95 % below (m)", "Greatest (m)", "Runs above the threshold", "Runs")
    totals = [k for k, row in enumerate(rows) if row[0].endswith("judged by")]
    return Table([Column("Basis", "name"), Column("Means"), *numbers], rows, totals=totals)


def coverage_section(facts: Facts) -> Section | None:
    """The section on coverage; None without `coverage.json`."""
    if not (facts.tables.directory / coverage.FILE).is_file():
        return None
    found = coverage.read_coverage(facts.tables.directory)
    listed = list(coverage.pairs(found))
    parts, families = coverage.parts(found), found["families"].items()
    whole = [
        [name if design else "Whole campaign", *coverage.counts(part), percent(part["share"]), design]
        for name, part in parts
        for design in [coverage.design_text(part["design"]) if "design" in part else ""]
    ]
    by_dimension = [
        [row.family, row.what, row.distinct, f"{row.covered:,} of {row.admissible:,}", percent(row.share), by]
        for row in coverage.dimensions(found)
        for by in [", ".join(row.factors) or "–"]
    ]
    by_pair = [
        [row.family, row.what, row.covered, row.admissible, row.combinations, percent(row.share)]
        for row in listed[:MAX_ROWS]
    ]
    family, counted = Column("Family", "name"), columns("number", *map(str.capitalize, coverage.COUNTS), "Share")
    covered = columns("number", "Different", "Choices covered", "Share")
    pairs = [family, Column("Producers of"), *columns("number", "Covered", "Possible", "All", "Share")]
    values = {
        "parts": Table([family, *counted, Column("Design")], whole, totals=[len(whole) - 1] if len(whole) > 1 else []),
        "excluded": list(coverage.excluded(found)),
        "unrealizable": [
            (f, by, said["count"]) for f, part in families for by, said in part["unrealizable_by"].items()
        ],
        "dimensions": Table([family, Column("Dimension"), *covered, Column("Written by")], by_dimension),
        "t_way": found["t_way"],
        "pairs": Table(pairs, by_pair),
        "pairs_left_out": len(listed[MAX_ROWS:]) + coverage.pairs_not_listed(found),
    }
    return Section("coverage", "Coverage", "Coverage", "what became of everything that was asked for", values=values)


def untested_section(facts: Facts) -> Section:
    """Rejections, runs that were not judged, faults, duplicates, and notes."""
    said = facts.tables.verdicts.reasons("not judged").groupby(["oracle", "reason"], observed=True, sort=False)
    unjudged = said.configuration.agg(runs="size", configurations=lambda names: list(names.unique()))
    not_judged = [
        [oracle, runs, reason, ", ".join(names[:4]) + (f" and {len(names) - 4} more" if len(names) > 4 else "")]
        for (oracle, reason), (runs, names) in zip(unjudged.index, unjudged.to_numpy(), strict=True)
    ]
    rejected = [
        [row["family"], row["producer"], row["times"], first_of(row), row["requested"]]
        for row in rejection_rows(facts.tables.rejections)
    ]
    times, runs = columns("number", "Times", "Runs")
    head = [Column("Family", "name"), Column("Producer"), times, Column("Why", "long"), Column("Requested")]
    values = {
        "rejections": Table(head, rejected[:MAX_ROWS]),
        "not_judged": Table([Column("Oracle"), runs, Column("Why"), Column("Configurations")], not_judged[:MAX_ROWS]),
        "duplicates": list(facts.tables.configurations.duplicates.items()),
        "max_rows": MAX_ROWS,
    }
    summary = left_out(facts) or "nothing was left out"
    return Section("untested", "Not tested", "What was not tested", summary, values=values)


def left_out(facts: Facts) -> str:
    """A line on everything left out; empty if nothing was."""
    unjudged = {oracle: facts.evidence[oracle].campaign.counts.not_judged for oracle in facts.tables.oracles}
    faults, notes = (facts.metadata.get(key) or () for key in ("faults", "notes"))
    rejected, duplicates = len(facts.tables.rejections), len(facts.tables.configurations.duplicates)
    if not (rejected or duplicates or any(unjudged.values()) or faults or notes):
        return ""
    by = ", ".join(f"{n:,} by {oracle}" for oracle, n in unjudged.items() if n)
    overall = " overall" + (f" ({by})" if by else "") if facts.several else ""
    return (
        f"{plural(rejected, 'rejected request')}, {plural(duplicates, 'duplicate')}, "
        f"{plural(facts.all.not_judged, 'run')} not judged{overall}, {plural(len(faults), 'fault')}, "
        f"{plural(len(notes), 'note')} on the campaign file"
    )


def rejection_rows(rejections: Sequence[Mapping[str, Any]]) -> list[Mapping[str, Any]]:
    """A row for each family, producer, and kind of reason: the first reason, and their number."""
    found = pd.DataFrame(rejections, columns=["family", "producer", "reason", "requested"])
    kinds = found.groupby(["family", "producer", found.reason.map(kind_of).rename("kind")], sort=False)
    rows: list[Mapping[str, Any]] = (
        kinds.agg(
            reason=("reason", "first"),
            reasons=("reason", "nunique"),
            times=("reason", "size"),
            requested=(
                "requested",
                lambda texts: "; ".join(dict.fromkeys([*map(_request, texts[:3]), *["…"][: len(texts) - 3]])),
            ),
        )
        .reset_index()
        .to_dict("records")
    )
    return rows


def _request(text: str) -> str:
    return ", ".join(f"{key} {short(value)}" for key, value in json.loads(text).items())
