"""Section on factors: what varied, and what of it matters."""

from collections.abc import Iterator, Sequence
from typing import Final

from markupsafe import Markup

from vastflow.oracles.evidence.findings import Design
from vastflow.oracles.page.facts import Facts
from vastflow.oracles.page.pictures import Picture, factor_pictures
from vastflow.oracles.page.section import Block, Details, Section, heading, paragraph, soft
from vastflow.oracles.page.table import Column, Table, columns
from vastflow.oracles.page.words import (
    chance,
    difference_text,
    factor_text,
    number,
    others_text,
    p_text,
    pair_text,
    percent,
    plural,
    points,
)
from vastflow.oracles.statistics.analysis import FactorAnalysis
from vastflow.oracles.statistics.effects import FactorEffect
from vastflow.oracles.statistics.margins import Trend

_QUIET: Final = 3
"""Designs that are named though nothing of them is shown to matter."""
_PAIRS: Final = 40


def factors_section(facts: Facts) -> Section | None:
    """The section; None where nothing can be compared."""
    designs = facts.findings.designs
    if not designs:
        return None
    several, noun = len(designs) > 1, facts.noun
    content: list[Block] = []
    for design in designs:
        if design.matters:
            content += [heading(design_name(design))] if several else []
            content.append(_shown(design.analysis, noun))
    quiet = [design for design in designs if not design.matters]
    for design in quiet[:_QUIET]:
        name = Markup("<b>{}</b>: ").format(design_name(design, 3)) if several else ""
        varied = plural(len(design.analysis.factors), "factor")
        content.append(paragraph("{}{} varied, and none is shown to matter.", name, varied))
    if len(quiet) > _QUIET:
        others = plural(len(quiet) - _QUIET, "other group")
        content.append(paragraph("Nor in {} of configurations.", others))
    explained = soft(
        "“These” is a test on these very {0}s: runs that are equal in all but the factor are compared. “Others” asks whether {0}s\n"
        "like these would show it on the whole; each of them counts once. P-values are adjusted for the number of factors. "
        "The difference is that to the level\nwith the fewest failures, over configurations that are equal in all else.",
        noun,
    )
    details: list[Block] = [explained]
    for design, pictures in zip(designs, factor_pictures(designs), strict=True):
        details += [heading(design_name(design))] if several else []
        details += _design(design.analysis, pictures, noun)
    content.append(Details("All factors, with intervals", details))
    return Section("factors", "What matters", "What varied and what matters", content, folded=False)


def design_name(design: Design, most: int = 6) -> str:
    """The families of a design, and the keys that tell it from others."""
    more = f" and {len(design.families) - most} more" if len(design.families) > most else ""
    alone = f", with {', '.join(design.alone)}" if design.alone else ""
    lacking = f", without {', '.join(design.lacking)}" if design.lacking and not alone else ""
    return f"{', '.join(design.families[:most])}{more}{alone}{lacking}"


def level_table(factor: FactorEffect, noun: str) -> Markup:
    """Failures and differences of a factor's levels, and the p-values of its tests."""
    row = Markup(
        '<tr><td>{}</td><td class="n"><span class="tag">{:,} of {:,}</span></td><td class="n"><span class="tag">{}</span></td></tr>\n'
    )
    rows = Markup("").join(
        row.format(each.level, each.failed, each.runs, difference_text(each)) for each in factor.levels
    )
    these, others = (p_text(each) if each.p_value is not None else each.note for each in (factor.these, factor.others))
    return Markup(
        '<table><thead><tr><th scope="col">Level</th><th scope="col" class="n">Failed</th>'
        '<th scope="col" class="n">Difference (points, 95 %)</th></tr></thead><tbody>\n{}</tbody></table>\n{}'
    ).format(rows, soft("These {}s: {} · Others: {}", noun, these, others))


def _shown(analysis: FactorAnalysis, noun: str) -> Markup:
    shown = [factor_text(factor, noun) for factor in analysis.factors if factor.matters]
    rest = len(analysis.factors) - len(shown)
    shown += [f"{pair_text(pair)}." for pair in analysis.interactions if pair.claim.shown]
    lines = Markup("").join(Markup('<li class="warn">{}</li>\n').format(line) for line in shown)
    if rest:
        verb = "is" if rest == 1 else "are"
        lines += Markup("<li>{} varied and {} not shown to matter.</li>\n").format(plural(rest, "more factor"), verb)
    return Markup('<ul class="findings">\n{}</ul>\n').format(lines)


def _design(analysis: FactorAnalysis, pictures: Sequence[Picture], noun: str) -> Iterator[Block]:
    if analysis.factors:
        yield from pictures
        for factor in analysis.factors:
            trend = f" Trend: {_trend(factor.trend)}." if factor.trend else ""
            share = percent(factor.share)
            text = soft(
                "{}{} Goes with {} of the differences between configurations.", others_text(factor, noun), trend, share
            )
            yield Markup('<div class="card scroll" tabindex="0"><b>{}</b>{}{}</div>\n').format(
                factor.name, level_table(factor, noun), text
            )
        yield from _surroundings(analysis)
        yield from _pairs(analysis)
    else:
        yield paragraph("Nothing varies in a way that can be compared.")
    parts = analysis.variance
    dropped = ", ".join(f"{each.name} ({each.reason})" for each in analysis.dropped)
    yield soft(
        "Of the variance of a run's outcome, {} goes with these factors, {} with their pairs,\n"
        "{} with other differences between configurations, {} with chance from run to run.{}",
        *map(percent, (parts.factors, parts.interactions, parts.unexplained, parts.repetition)),
        f" Not compared: {dropped}." if dropped else "",
    )


def _trend(trend: Trend) -> str:
    low, high = map(points, trend.change_interval)
    ends = f"from {number(trend.smallest)} to {number(trend.greatest)}"
    return f"{points(trend.change)} points ({low} … {high}) {ends}"


def _surroundings(analysis: FactorAnalysis) -> Iterator[Block]:
    found = analysis.surroundings
    if not found:
        return
    shown = Markup("; ").join(
        Markup("<b>{}</b> goes with failures, most at {}, least at {}{} ({})").format(
            *(each.name, each.highest, each.lowest),
            *(f", {_trend(each.trend)}" if each.trend else "", p_text(each.others)),
        )
        for each in found
        if each.others.shown
    )
    rest = ", ".join(each.name for each in found if not each.others.shown)
    yield paragraph(
        "What surrounds the path, each beside these factors: {}.{}",
        shown or "nothing is shown to go with failures",
        f" Not shown to: {rest}." if rest else "",
    )


def _pairs(analysis: FactorAnalysis) -> Iterator[Block]:
    found = analysis.interactions
    if not found:
        return
    rows = [
        [
            " × ".join(pair.names),
            "–" if pair.claim.p_value is None else points(pair.departure),
            chance(pair.claim.adjusted),
            pair.claim.note or ("act together" if pair.claim.shown else "not shown to act together"),
        ]
        for pair in found[:_PAIRS]
    ]
    numbers = columns("number", "Largest departure from adding up (points)", "p, adjusted")
    table = Table([Column("Pair"), *numbers, Column("Shown?")], rows)
    yield Details(f"{plural(len(found), 'pair')} of factors", [table], open=len(found) <= 10)
