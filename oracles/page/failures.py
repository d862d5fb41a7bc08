"""Sections on failed runs: why they failed, the worst configurations, and what each oracle said."""

import re
from collections import Counter
from collections.abc import Iterator, Mapping
from typing import Any, Final

import numpy as np
import pandas as pd
from markupsafe import Markup

from vastflow.oracles.evidence.causes import CauseCount
from vastflow.oracles.evidence.findings import Findings
from vastflow.oracles.judgement.cause import CAUSES
from vastflow.oracles.page.facts import Facts
from vastflow.oracles.page.pictures import case_picture, cause_picture
from vastflow.oracles.page.section import Block, Card, Column, Details, Group, Section, Table, columns, paragraph, soft
from vastflow.oracles.page.words import capital, percent, plural, sentence, tag
from vastflow.oracles.results.tables import FAIL, Tables
from vastflow.oracles.statistics.intervals import wilson_intervals

CASES: Final = 9
_CASES_OF_A_FAMILY: Final = 2
_CASES_AT_ONCE: Final = 6
_CAUSES_AT_ONCE: Final = 8
_KINDS: Final = 12
_NUMBER: Final = re.compile(r"\d+(?:\.\d+)?")


def why_section(facts: Facts) -> Section | None:
    """Why runs failed; None where none did."""
    content = [*_causes(facts), *_kinds(facts)]
    return Section("why", "Why", "Why runs failed", content=content, folded=False) if content else None


def worst_section(facts: Facts) -> Section | None:
    """The worst configurations; None where no run failed."""
    found = [_case(facts, k) for k in cases(facts.tables, facts.findings)]
    if not found:
        return None
    content: list[Block] = [
        soft(
            "The failure rates whose 95 % intervals begin highest, at most two of a family while there are others; "
            '<a href="#all">all that failed</a>. '
            "The command replays the first failed run from the campaign directory, bit for bit; run it there."
        ),
        Group("cases", found[:_CASES_AT_ONCE]),
    ]
    if rest := found[_CASES_AT_ONCE:]:
        content.append(Details(f"{len(rest)} more", [Group("cases", rest)]))
    return Section("worst", "Worst", "Worst configurations", content=content, folded=False)


def failed_section(facts: Facts) -> Section | None:
    found = facts.failures.groupby(["configuration", "oracle"], observed=True).reason.agg(["size", "first", "nunique"])
    rows = []
    for (name, oracle), (n, reason, reasons) in zip(found.index, found.itertuples(index=False), strict=True):
        others = f" (and {reasons - 1} other reason{'s' if reasons > 2 else ''})" if reasons > 1 else ""
        rows.append([name, oracle, n, facts.evidence[oracle].configurations[name].judged, reason + others])
    if not rows:
        return None
    rows.sort(key=lambda row: -row[2])
    head = [Column("Configuration"), Column("Oracle", "choice"), *columns("number", "Failed", "Of judged")]
    summary = f"{plural(facts.all.failed, 'run')}, with the words of each oracle"
    return Section("failures", "Failed runs", "Failed runs", summary, [Table([*head, Column("Why")], rows, "failed")])


def kind_of(reason: str) -> str:
    """The kind of a reason: its text without numbers."""
    return _NUMBER.sub("#", reason)


def failure_kinds(failures: pd.DataFrame) -> list[Mapping[str, Any]]:
    """A row for each oracle and kind of reason, the most frequent first.

    Args:
        failures: As `VerdictTable.reasons` has them.
    """
    kinds = failures.assign(kind=pd.factorize(failures.reason.map(kind_of))[0]).groupby(
        ["oracle", "kind"], observed=True
    )
    found = kinds.agg(
        reason=("reason", "first"),
        reasons=("reason", "nunique"),
        runs=("reason", "size"),
        configurations=("configuration", "nunique"),
    )
    rows: list[Mapping[str, Any]] = (
        found.sort_values("runs", ascending=False, kind="stable").reset_index().to_dict("records")
    )
    return rows


def _causes(facts: Facts) -> Iterator[Block]:
    if not facts.causes:
        return
    yield soft(
        'At most one cause a run, by a <a href="#method">fixed precedence</a>. Orange is where the robot was, dashed where it took '
        "itself to be. The command replays the run from the campaign directory."
    )
    cards = [_cause(facts, each) for each in facts.causes]
    yield Group("cases causes", cards[:_CAUSES_AT_ONCE])
    if rest := cards[_CAUSES_AT_ONCE:]:
        yield Details(plural(len(rest), "rarer cause"), [Group("cases causes", rest)])


def _cause(facts: Facts, count: CauseCount) -> Card:
    picture = cause_picture(facts.tables, count, facts.files)
    stood = count.cause == "stood still" and count.runs == facts.stood.runs
    share, where = percent(count.runs / facts.all.failed), plural(count.configurations, "configuration")
    text = paragraph("<b>{}</b>, {} of failures, in {}", plural(count.runs, "run"), share, where)
    text += soft("{}", sentence(facts.stood.text if stood else CAUSES[count.cause]))
    return Card(
        capital(count.cause), text + _replay(picture is not None, count.configuration, count.run_index), picture
    )


def _replay(recorded: bool, configuration: str, run_index: int) -> Markup:
    return Markup("<code>vastflow replay . {} {}</code>").format(configuration, run_index) if recorded else Markup("")


def _kinds(facts: Facts) -> Iterator[Block]:
    found = failure_kinds(facts.failures)
    if not found:
        return
    rows = [
        [
            row["oracle"],
            Markup("{} <small>(for example)</small>").format(row["reason"]) if row["reasons"] > 1 else row["reason"],
            row["runs"],
            percent(row["runs"] / facts.evidence[row["oracle"]].campaign.counts.failed),
            row["configurations"],
        ]
        for row in found[:_KINDS]
    ]
    numbers = columns("number", "Runs", "Of its failures", "Configurations")
    content: list[Block] = [
        soft(
            "Reasons that differ in their numbers alone are one row, with the first of them; each configuration's own are under "
            '<a href="#failures">failed runs</a>.\nA run that several oracles failed is in several rows.'
        ),
        Table([Column("Oracle", "name"), Column("Why", "long"), *numbers], rows),
    ]
    if len(found) > _KINDS:
        content.append(soft("And {}.", plural(len(found) - _KINDS, "rarer kind")))
    yield Details(f"What each oracle said: {plural(len(found), 'kind')} of reasons", content)


def cases(tables: Tables, findings: Findings) -> list[int]:
    """Indices of the worst configurations by the lower bounds of their failure rates, spread over families."""
    failed, judged = findings.counts[:, 1], findings.counts[:, 0] + findings.counts[:, 1]
    low = wilson_intervals(failed, judged)[:, 0]
    worst = sorted(np.flatnonzero(failed), key=lambda k: (-low[k], k))
    found = tables.configurations
    chosen: list[int] = []
    for most in (_CASES_OF_A_FAMILY, CASES):
        taken = Counter(found.families[k] for k in chosen)
        for place in worst:
            k = int(found.distinct[place])
            if len(chosen) < CASES and k not in chosen and taken[found.families[k]] < most:
                chosen.append(k)
                taken[found.families[k]] += 1
    return chosen


def _case(facts: Facts, configuration: int) -> Card:
    """One of the worst configurations, by its index."""
    found, verdicts = facts.tables.configurations, facts.tables.verdicts
    rows = verdicts.rows_of(configuration)
    failed_run = rows.start + int(np.flatnonzero(verdicts.together[rows] == FAIL)[0])
    place = int(np.searchsorted(found.distinct, configuration))
    passed, failed, _ = facts.findings.counts[place].tolist()
    name, picture = found.names[configuration], case_picture(facts.tables, configuration, facts.files)
    varied = [f"{key} {value}" for key in facts.varied if (value := facts.factor(configuration, key))]
    runs = plural(passed + failed, "run")
    text = paragraph("{} · {} of {} failed", tag(facts.findings.classes.names[place]), failed, runs)
    text += soft("{}", " · ".join(varied[:6]))
    reasons = facts.failures[facts.failures.configuration == name].drop_duplicates("oracle")  # the first of each
    said = zip(reasons.oracle, reasons.reason, strict=True)
    text += Markup("").join(paragraph("<b>{}</b>: {}", *each) for each in said)
    return Card(name, text + _replay(picture is not None, name, int(verdicts.run_index[failed_run])), picture)
