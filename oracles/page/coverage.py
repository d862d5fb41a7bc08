"""Section on coverage: what became of everything that was asked for."""

from collections.abc import Iterator

from markupsafe import Markup

from vastflow.oracles.page.facts import Facts
from vastflow.oracles.page.section import Block, Details, Section, bullets, heading, paragraph, soft
from vastflow.oracles.page.table import MAX_ROWS, Column, Table, columns
from vastflow.oracles.page.words import percent, plural
from vastflow.oracles.results import coverage


def coverage_section(facts: Facts) -> Section | None:
    """The section; None for a campaign directory of before there was `coverage.json`."""
    if not (facts.tables.directory / coverage.FILE).is_file():
        return None
    found = coverage.read_coverage(facts.tables.directory)
    content = [*_families(found), *_losses(found), *_dimensions(found), *_pairs(found)]
    return Section("coverage", "Coverage", "Coverage", content, "what became of everything that was asked for")


def _families(found: coverage.Coverage) -> Iterator[Block]:
    yield soft(
        "What became of everything that was asked for: requested = excluded by constraints + unrealisable by producers + duplicate +\n"
        "realised, where a request that ended early counts once. The share is of what constraints and producers leave as possible and "
        "different\n(“valid”); with a design, of the whole space of which it takes some."
    )
    rows = [
        [
            name if "design" in part else "Whole campaign",
            *coverage.counts(part),
            percent(part["share"]),
            coverage.design_text(part["design"]) if "design" in part else "",
        ]
        for name, part in coverage.parts(found)
    ]
    counted = columns("number", *(count.capitalize() for count in coverage.COUNTS), "Share")
    totals = [k for k, row in enumerate(rows) if not row[-1]]
    yield Table([Column("Family", "name"), *counted, Column("Design")], rows, totals=totals)


def _losses(found: coverage.Coverage) -> Iterator[Block]:
    losses = [
        Markup("{}: constraint <b>{}</b> excludes {:,}.").format(loss.family, loss.by, loss.times)
        for loss in coverage.excluded(found)
    ]
    losses += [
        Markup(
            '{}: <b>{}</b> can\'t build {:,}; the reasons are under <a href="#untested">what was not tested</a>.'
        ).format(family, producer, said["count"])
        for family, part in found["families"].items()
        for producer, said in part["unrealisable_by"].items()
    ]
    if losses:
        yield bullets(losses)


def _dimensions(found: coverage.Coverage) -> Iterator[Block]:
    yield heading("By dimension")
    rows = [
        [
            *(each.family, each.what, each.distinct, f"{each.covered:,} of {each.admissible:,}"),
            *(percent(each.share), ", ".join(each.factors) or "–"),
        ]
        for each in coverage.dimensions(found)
    ]
    head = [Column("Family", "name"), Column("Dimension"), *columns("number", "Different", "Choices covered", "Share")]
    yield Table([*head, Column("Written by")], rows)


def _pairs(found: coverage.Coverage) -> Iterator[Block]:
    listed, covered = list(coverage.pairs(found)), found["t_way"]
    if not listed:
        return
    yield heading("By pairs of producers")
    yield paragraph(
        "{:,} of {:,} possible pairs of choices are in some configuration: {}.",
        *(covered["covered"], covered["admissible"], percent(covered["share"])),
    )
    rows = [
        [each.family, each.what, each.covered, each.admissible, each.combinations, percent(each.share)]
        for each in listed[:MAX_ROWS]
    ]
    head = [Column("Family", "name"), Column("Producers of"), *columns("number", "Covered", "Possible", "All", "Share")]
    summary = f"{plural(len(rows), 'pair')} of producers, the least covered first"
    yield Details(summary, [Table(head, rows)], open=len(rows) <= 20)
    if left_out := len(listed[MAX_ROWS:]) + coverage.pairs_not_listed(found):
        yield soft("Counted, not listed: {}.", plural(left_out, "pair"))
