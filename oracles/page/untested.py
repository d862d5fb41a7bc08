"""Sections on coverage, and on what was not tested."""

import json
from collections.abc import Iterable, Mapping, Sequence
from typing import Any

import pandas as pd

from vastflow.oracles.page.facts import Facts
from vastflow.oracles.page.failures import kind_of
from vastflow.oracles.page.section import Section
from vastflow.oracles.page.table import MAX_ROWS
from vastflow.oracles.page.words import plural, short
from vastflow.oracles.results import coverage
from vastflow.oracles.results.tables import Tables


def coverage_section(facts: Facts) -> Section | None:
    """The section on coverage; None without `coverage.json`."""
    if not (facts.tables.directory / coverage.FILE).is_file():
        return None
    found = coverage.read_coverage(facts.tables.directory)
    listed = list(coverage.pairs(found))
    values = {
        "parts": [
            (name, part, coverage.design_text(part["design"]) if "design" in part else "")
            for name, part in coverage.parts(found)
        ],
        "excluded": list(coverage.excluded(found)),
        "unrealisable": [
            (family, producer, said["count"])
            for family, part in found["families"].items()
            for producer, said in part["unrealisable_by"].items()
        ],
        "dimensions": list(coverage.dimensions(found)),
        "t_way": found["t_way"],
        "pairs": listed[:MAX_ROWS],
        "pairs_left_out": len(listed[MAX_ROWS:]) + coverage.pairs_not_listed(found),
    }
    return Section("coverage", "Coverage", "Coverage", "what became of everything that was asked for", values=values)


def untested_section(facts: Facts) -> Section:
    """Rejections, runs that were not judged, faults, duplicates, and notes."""
    values = {
        "rejections": rejection_rows(facts.tables.rejections),
        "not_judged": _not_judged_rows(facts.tables),
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
    """A row for each family, producer and kind of reason: the first reason, and how many there are."""
    found = pd.DataFrame(rejections, columns=["family", "producer", "reason", "requested"])
    kinds = found.groupby(["family", "producer", found.reason.map(kind_of).rename("kind")], sort=False)
    rows: list[Mapping[str, Any]] = (
        kinds.agg(
            reason=("reason", "first"),
            reasons=("reason", "nunique"),
            times=("reason", "size"),
            requested=("requested", lambda asked: _requests(asked[:3])),
        )
        .reset_index()
        .to_dict("records")
    )
    return rows


def _requests(texts: Iterable[str]) -> list[str]:
    asked = (json.loads(text).items() for text in texts)
    return list(dict.fromkeys(", ".join(f"{key} {short(value)}" for key, value in each) for each in asked))


def _not_judged_rows(tables: Tables) -> list[Mapping[str, Any]]:
    """A row for each oracle and reason."""
    said = tables.verdicts.reasons("not judged").groupby(["oracle", "reason"], observed=True, sort=False)
    found = said.configuration.agg(runs="size", configurations=lambda names: list(names.unique()))
    rows: list[Mapping[str, Any]] = found.reset_index().to_dict("records")
    return rows
