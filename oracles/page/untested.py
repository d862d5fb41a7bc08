"""Section on what was not tested: rejections, runs that were not judged, faults, duplicates, and notes."""

import json
from collections.abc import Iterable, Iterator, Mapping
from typing import Any, Final

from markupsafe import Markup

from vastflow.oracles.page.facts import Facts
from vastflow.oracles.page.failures import example, kind_of
from vastflow.oracles.page.section import Block, Details, Section, bullets, heading, paragraph, soft
from vastflow.oracles.page.table import MAX_ROWS, Column, Table
from vastflow.oracles.page.words import plural, short
from vastflow.oracles.results.tables import Tables

_MOST_NAMED: Final = 4
"""Configurations that are named of those with runs that were not judged."""


def untested_section(facts: Facts) -> Section:
    """The section."""
    content = [*_rejected(facts), *_not_judged(facts), *_faults(facts), *_duplicates(facts), *_notes(facts)]
    summary = left_out(facts) or "nothing was left out"
    return Section("untested", "Not tested", "What was not tested", content, summary)


def left_out(facts: Facts) -> str:
    """What was left out, in a line; empty where nothing was."""
    unjudged = {oracle: facts.evidence[oracle].campaign.counts.not_judged for oracle in facts.tables.oracles}
    faults, notes = (facts.metadata.get(key) or () for key in ("faults", "notes"))
    duplicates = _duplicate_names(facts.tables)
    if not (facts.tables.rejections or duplicates or any(unjudged.values()) or faults or notes):
        return ""
    by = ", ".join(f"{n:,} by {oracle}" for oracle, n in unjudged.items() if n)
    overall = " overall" + (f" ({by})" if by else "") if facts.several else ""
    return (
        f"{plural(len(facts.tables.rejections), 'rejected request')}, {plural(len(duplicates), 'duplicate')}, "
        f"{plural(facts.all.not_judged, 'run')} not judged{overall}, {plural(len(faults), 'fault')}, "
        f"{plural(len(notes), 'note')} on the campaign file"
    )


def rejection_rows(tables: Tables) -> list[Mapping[str, Any]]:
    """A row for each family, producer and kind of reason: the first reason, and whether all are the same."""
    grouped: dict[tuple[str, str, str], list[Mapping[str, Any]]] = {}
    for row in tables.rejections:
        grouped.setdefault((row["family"], row["producer"], kind_of(row["reason"])), []).append(row)
    return [
        {
            "family": family,
            "producer": producer,
            "reason": alike[0]["reason"],
            "alike": len({row["reason"] for row in alike}) == 1,
            "times": len(alike),
            "requested": _requests(alike[:3]),
        }
        for (family, producer, _), alike in grouped.items()
    ]


def _requests(rejections: Iterable[Mapping[str, Any]]) -> list[str]:
    asked = (json.loads(row["requested"]).items() for row in rejections)
    return list(dict.fromkeys(", ".join(f"{key} {short(value)}" for key, value in each) for each in asked))


def _rejected(facts: Facts) -> Iterator[Block]:
    yield heading("Rejected: requests that can't be built")
    found = rejection_rows(facts.tables)
    if not found:
        yield paragraph("None.")
        return
    if len(found) > MAX_ROWS:
        yield soft("The first {} kinds are listed; all are in rejections.parquet.", MAX_ROWS)
    rows = [
        [
            *(row["family"], row["producer"], row["times"], example(row["reason"], row["alike"])),
            "; ".join(row["requested"]) + ("; …" if row["times"] > len(row["requested"]) else ""),
        ]
        for row in found[:MAX_ROWS]
    ]
    head = [Column("Family", "name"), Column("Producer"), Column("Times", "number"), Column("Why", "long")]
    yield Table([*head, Column("Asked for")], rows)


def _not_judged(facts: Facts) -> Iterator[Block]:
    yield heading("Not judged, and why")
    said, names = facts.tables.verdicts.reasons("not judged"), facts.tables.configurations.names
    grouped: dict[tuple[int, int], list[int]] = {}
    for oracle, reason, configuration in zip(
        said.oracle.tolist(), said.reason.tolist(), said.configuration.tolist(), strict=True
    ):
        grouped.setdefault((oracle, reason), []).append(configuration)
    if not grouped:
        yield paragraph("Every run was judged by every oracle.")
        return
    if facts.several:
        yield soft(
            "A run is not judged overall where no oracle fails it and one can't judge it: {}. The rows count for each oracle.",
            plural(facts.all.not_judged, "run"),
        )
    rows = []
    for (oracle, reason), where in list(grouped.items())[:MAX_ROWS]:
        distinct = [names[k] for k in dict.fromkeys(where)]
        more = f" and {len(distinct) - _MOST_NAMED} more" if len(distinct) > _MOST_NAMED else ""
        named = ", ".join(distinct[:_MOST_NAMED]) + more
        rows.append([facts.tables.oracles[oracle], len(where), said.known[reason], named])
    yield Table([Column("Oracle"), Column("Runs", "number"), Column("Why"), Column("Configurations")], rows)


def _faults(facts: Facts) -> Iterator[Block]:
    if faults := facts.metadata.get("faults"):
        yield heading("Faults")
        yield soft(
            "A scenario can't work, or something of vastflow or of the machine broke. "
            "These runs are never counted as failures of the system under test."
        )
        yield bullets(_fault_text(fault) for fault in faults[:MAX_ROWS])


def _fault_text(fault: Mapping[str, Any]) -> str:
    run = "" if fault["run_index"] is None else f", run {fault['run_index']}"
    return f"{fault['configuration'] or 'campaign'}{run}, {fault['stage']}: {fault['error']}"


def _duplicate_names(tables: Tables) -> list[tuple[str, str]]:
    found = tables.configurations
    return [(name, of) for name, of in zip(found.names, found.duplicate_of, strict=True) if of]


def _duplicates(facts: Facts) -> Iterator[Block]:
    yield heading("Duplicates")
    found = _duplicate_names(facts.tables)
    if not found:
        yield paragraph("None.")
        return
    yield soft("Of the same content as another configuration: run once, and counted once, under the first name.")
    listed: list[Block] = [bullets((f"{name} is {of}" for name, of in found[:MAX_ROWS]), "dense")]
    if len(found) > MAX_ROWS:
        listed.append(soft("The first {} are listed; all are in evidence.json.", MAX_ROWS))
    yield Details(plural(len(found), "duplicate"), listed, open=len(found) <= 12)


def _notes(facts: Facts) -> Iterator[Block]:
    if notes := facts.metadata.get("notes"):
        yield heading("Notes on the campaign file")
        yield Markup('<div class="note">{}</div>\n').format(bullets(notes))
