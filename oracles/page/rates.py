"""Sections on configurations: their rates, their classes, and what matters."""

from typing import Any, Final

import numpy as np

from vastflow.oracles.evidence.findings import stopping_rule
from vastflow.oracles.figures.style import CLASS_COLORS
from vastflow.oracles.page.facts import Facts
from vastflow.oracles.page.pictures import factor_pictures, rate_pictures
from vastflow.oracles.page.section import Block, Section, paragraph
from vastflow.oracles.page.table import Column, Table, columns, configuration_cells, rate_cell
from vastflow.oracles.page.words import plural
from vastflow.oracles.statistics.classes import passes_that_show

_MOST_LISTED: Final = 200
"""Runs of a configuration up to which the page says how many passes show a class."""


def factors_section(facts: Facts) -> Section | None:
    """The section on factors; None where nothing can be compared."""
    designs = facts.findings.designs
    drawn = factor_pictures(designs)
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
        values = [
            found.factors[k].get(key) if numeric else facts.factor(k, key) for key, numeric in facts.varied.items()
        ]
        rows.append([found.names[k], found.families[k], name, *rates, *still, *values])
    rows.sort(key=lambda row: (row[3][4], row[3][0] - row[3][1]))  # the success rate's upper bound, then failures
    head = [Column("Configuration"), Column("Family", "choice"), Column("Class", "class"), *_rate_columns(facts)]
    head += [Column(key, "number" if numeric else "text") for key, numeric in facts.varied.items()]
    failing = int(np.count_nonzero(facts.findings.counts[:, 1]))
    table: Block = Table(head, rows, "configurations", "evidence.json", failing=failing)
    summary = f"{plural(failing, 'configuration')} with failures, of {len(rows):,}" if failing else "none failed"
    return Section("all", "Configurations", "Configurations", summary, [table if rows else paragraph("None.")])


def rates_section(facts: Facts) -> Section:
    """Success rates of the campaign, of its families, and by each oracle."""
    shown = {oracle: facts.evidence[oracle] for oracle in facts.shown_oracles}
    rows = [
        [
            *(name, group.configurations),
            *(rate_cell(found.families[name].counts) for found in shown.values()),
            *([facts.stood.of(group.by_name)] if facts.stood.runs else []),
        ]
        for name, group in facts.everything.families.items()
    ]
    head = [Column("Family"), Column("Configurations", "number"), *_rate_columns(facts)]
    pictures = list(rate_pictures(shown))
    values = {"families": Table(head, rows, "families", "evidence.json"), "pictures": pictures}
    summary = "of the campaign, families and oracles, with intervals"
    return Section("rates", "Success rates", "Success rates", summary, values=values, figures=pictures)


def classes_section(facts: Facts) -> Section:
    """The section on reliable, systematic, and flaky configurations."""
    classes, most, least = facts.findings.classes, facts.most_runs, facts.least_runs
    summary = ", ".join(f"{classes.count(name):,} {name}" for name in CLASS_COLORS if classes.count(name))
    if classes.count("undecided") == len(classes.names):
        why = f": {plural(most, 'run')} can't show a class, that takes at least {least}" if most < least else ""
        summary = f"all {len(classes.names):,} undecided{why}"
    many = stopping_rule(facts.metadata) is not None or most > _MOST_LISTED
    values = {"shown_by": {} if many else passes_that_show(most), "undecided": _undecided(facts)}
    return Section("classes", "Classes", "Reliable, systematic, flaky", summary, values=values)


def _rate_columns(facts: Facts) -> list[Column]:
    """A column for each oracle that is shown, and one for standstills where there were any."""
    stood = columns("number", "Stood still") if facts.stood.runs else []
    return [*columns("rate", *(oracle or "All oracles" for oracle in facts.shown_oracles)), *stood]


def _undecided(facts: Facts) -> Table:
    """The configurations without a class, and how likely each is to be reliable."""
    findings, found = facts.findings, facts.tables.configurations
    rows = [
        [
            *(findings.names[k], found.families[found.distinct[k]]),
            *(int(findings.counts[k, 0]), int(findings.counts[k, :2].sum())),
            round(float(findings.reliable_chance[k]), 3),
        ]
        for k in findings.undecided
    ]
    head = [Column("Configuration"), Column("Family", "choice")]
    numbers = columns("number", "Passed", "Of judged", "P(rate ≥ 80 %)")
    return Table([*head, *numbers], rows, "undecided", "evidence.json")
