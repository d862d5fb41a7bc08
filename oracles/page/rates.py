"""Sections on configurations: their rates, those of their families, and their classes."""

from collections.abc import Iterator
from typing import Any, Final

import numpy as np
from markupsafe import Markup

from vastflow.oracles.evidence.evidence import Evidence, Group
from vastflow.oracles.evidence.findings import stopping_rule
from vastflow.oracles.evidence.rates import Interval
from vastflow.oracles.figures.palette import CLASS_COLORS
from vastflow.oracles.page.facts import Facts
from vastflow.oracles.page.pictures import rate_pictures
from vastflow.oracles.page.section import Block, Section, heading, paragraph, soft
from vastflow.oracles.page.table import Column, Table, columns, configuration_cells, rate_cell, rate_html
from vastflow.oracles.page.words import chance, number, percent, plural, sentence, span, tag
from vastflow.oracles.statistics.classes import passes_that_show

_MOST_LISTED: Final = 200
"""Runs of a configuration up to which the page says how many passes show a class."""
_ADVICE: Final = {
    "reliable": "Nothing; it is evidence for the system.",
    "systematic": "Look for a cause in the system: one replay shows it.",
    "flaky": "Look for what differs between its runs; compare a passed with a failed replay.",
    "undecided": "Run it more often, if it matters.",
}


def configurations_section(facts: Facts) -> Section:
    """A row for each distinct configuration, the worst first."""
    found, stood = facts.tables.configurations, facts.stood
    cells_of = [configuration_cells(facts.evidence[oracle]) for oracle in facts.shown_oracles]
    rows = []
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
    return Section("all", "Configurations", "Configurations", [table if rows else paragraph("None.")], summary)


def rates_section(facts: Facts) -> Section:
    """Success rates of the campaign, of its families, and by each oracle."""
    content = [*_campaign(facts), *_families(facts), *rate_pictures(_shown(facts)), *_dispersion(facts)]
    summary = "of the campaign, families and oracles, with intervals"
    return Section("rates", "Success rates", "Success rates", content, summary)


def classes_section(facts: Facts) -> Section:
    """How many configurations are shown to be reliable, systematic, or flaky."""
    classes, most, least = facts.findings.classes, facts.most_runs, facts.least_runs
    counted = {name: classes.count(name) for name in CLASS_COLORS if classes.count(name)}
    summary = ", ".join(f"{n:,} {name}" for name, n in counted.items())
    if classes.count("undecided") == len(classes.names):
        why = f": {plural(most, 'run')} can't show a class, that takes at least {least}" if most < least else ""
        summary = f"all {len(classes.names):,} undecided{why}"
    rows = [[tag(name), n, _ADVICE[name]] for name, n in counted.items()]
    content: list[Block] = [
        soft(
            "A configuration is <b>reliable</b> where its success rate is shown to be at least 80 %, <b>systematic</b> where it is shown "
            "to be at most 20 %, <b>flaky</b>\nwhere it is shown to be between these, and <b>undecided</b> where its runs show none of "
            "them, which is no verdict on it. {}{}",
            *(sentence(classes.controls), _shown_by(facts)),
        ),
        Table([Column("Class"), Column("Configurations", "number"), Column("What to do")], rows),
        *_undecided(facts),
    ]
    return Section("classes", "Classes", "Reliable, systematic, flaky", content, summary)


def _shown(facts: Facts) -> dict[str | None, Evidence]:
    return {oracle: facts.evidence[oracle] for oracle in facts.shown_oracles}


def _rate_columns(facts: Facts) -> list[Column]:
    """A column for each oracle that is shown, and one for standstills where there were any."""
    stood = columns("number", "Stood still") if facts.stood.runs else []
    return [*columns("rate", *(oracle or "All oracles" for oracle in facts.shown_oracles)), *stood]


def _campaign(facts: Facts) -> Iterator[Block]:
    yield soft(
        "Share of passed among judged runs with its 95 % Wilson interval. That interval is about these very configurations, were they\n"
        "run again. Runs of one configuration resemble each other, and configurations on one path do, so the interval for others of the "
        "kind (“others”, with\npaths as clusters, or configurations where there is one path) is usually wider. "
        "Runs that were not judged are in no rate."
    )
    groups = [found.campaign for found in _shown(facts).values()]
    rows: list[list[Any]] = [
        [plural(facts.everything.campaign.configurations, "configuration"), *map(_group_cell, groups)]
    ]
    if weighted := facts.findings.weighted:
        counts = weighted.counts
        said = Markup("{} <small>{:,} of {:,}</small>\n<br><small>{}</small>{}").format(
            *(percent(weighted.rate), counts.passed, counts.judged, span(weighted.interval)),
            _others(weighted.clustered),
        )
        label = Markup("Each duplicate counted,<br>as the paper counts")
        rows.append([label, said, *[""] * (len(groups) - 1)])
    head = columns("text", *(oracle or "All oracles" for oracle in facts.shown_oracles))
    yield Table([Column("Whole campaign", "name"), *head], rows, totals=[0])


def _group_cell(group: Group) -> Markup:
    return rate_html(rate_cell(group.counts)) + _others(group.clustered)


def _others(interval: Interval | None) -> Markup:
    return Markup("<br><small>others {}</small>").format(span(interval)) if interval else Markup("")


def _families(facts: Facts) -> Iterator[Block]:
    families = facts.everything.families
    if len(families) < 2:
        return
    rows = [
        [
            *(name, group.configurations),
            *(rate_cell(found.families[name].counts) for found in _shown(facts).values()),
            *([facts.stood.of(group.members)] if facts.stood.runs else []),
        ]
        for name, group in families.items()
    ]
    yield heading("By family")
    head = [Column("Family"), Column("Configurations", "number"), *_rate_columns(facts)]
    yield Table(head, rows, "families", "evidence.json")


def _dispersion(facts: Facts) -> Iterator[Block]:
    spread = facts.findings.dispersion
    if spread is None:
        return
    yield heading("How much runs of one configuration resemble each other")
    if spread.icc is None:
        yield paragraph("One judged run a configuration says nothing of that.")
        return
    shown = "is" if spread.p_value <= 0.05 else "is not"
    yield paragraph(
        "Intraclass correlation {}: 0 were runs that know nothing of their configuration, 1 runs of a configuration that\n"
        "all end alike. A pooled rate is as uncertain as one of {} times fewer independent runs\n(over-dispersion {} shown, p {}).",
        *(number(spread.icc), number(spread.design_effect), shown, chance(spread.p_value)),
    )


def _shown_by(facts: Facts) -> str:
    """How many passes show each class of a configuration alone; empty where a rule ends runs, or there are many."""
    if stopping_rule(facts.metadata) is not None or facts.most_runs > _MOST_LISTED:
        return ""
    passes = passes_that_show(facts.most_runs)
    if not passes:
        return ""
    said = ", ".join(f"{name} by {a if a == b else f'{a} to {b}'}" for name, (a, b) in passes.items())
    runs = plural(facts.most_runs, "run")
    return f" With {runs} a configuration alone is shown to be {said} that pass; among many it takes more."


def _undecided(facts: Facts) -> Iterator[Block]:
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
    if not rows:
        return
    yield heading("Undecided, the likeliest to be reliable first")
    at_limit = findings.dispersion is not None and findings.dispersion.alpha is None
    yield soft(
        "The probability that the success rate is at least 80 %, given the runs and how configurations differ (posterior of the "
        "beta-binomial{}). Run those in the middle first: they tell most.",
        ", at a limit here: with Jeffreys' prior instead" if at_limit else "",
    )
    head = [Column("Configuration"), Column("Family", "choice")]
    numbers = columns("number", "Passed", "Of judged", "P(rate ≥ 80 %)")
    yield Table([*head, *numbers], rows, "undecided", "evidence.json")
