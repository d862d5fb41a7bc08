"""Sections on failed runs: causes, worst configurations, and reasons by oracle."""

import re
from collections import Counter
from collections.abc import Mapping
from typing import Any, Final

import numpy as np
import pandas as pd
from markupsafe import Markup

from vastflow.oracles.evidence.findings import Findings
from vastflow.oracles.judgment.cause import CAUSES
from vastflow.oracles.page.facts import Facts
from vastflow.oracles.page.film import cause_film
from vastflow.oracles.page.pictures import case_picture, cause_picture
from vastflow.oracles.page.section import Column, Section, Table, columns
from vastflow.oracles.page.words import percent, plural
from vastflow.oracles.results.tables import FAIL, Tables
from vastflow.oracles.statistics.intervals import wilson_intervals

CASES: Final = 9
_CASES_OF_A_FAMILY: Final = 2
_KINDS: Final = 12
_NUMBER: Final = re.compile(r"\d+(?:\.\d+)?")


def why_section(facts: Facts) -> Section | None:
    """Why runs failed; None where none did."""
    kinds = failure_kinds(facts.failures)
    if not kinds:
        return None
    rows = [
        [
            *(row["oracle"], first_of(row), row["runs"]),
            percent(row["runs"] / facts.evidence[row["oracle"]].campaign.counts.failed),
            row["configurations"],
        ]
        for row in kinds[:_KINDS]
    ]
    numbers = columns("number", "Runs", "Of its failures", "Configurations")
    drawn = [cause_picture(facts.tables, each, facts.files) for each in facts.causes]
    films = [
        film
        for each in facts.causes[:1]
        if (film := cause_film(facts.tables, each, facts.files, facts.before)) is not None
    ]
    values = {
        "causes": list(zip(facts.causes, drawn, strict=True)),
        "films": films,
        "meanings": CAUSES,
        "kinds": Table([Column("Oracle", "name"), Column("Why", "long"), *numbers], rows),
        "of_kinds": len(kinds),
    }
    figures = [picture for picture in drawn if picture is not None]
    return Section("why", "Why", "Why runs failed", folded=False, values=values, figures=figures, films=films)


def worst_section(facts: Facts) -> Section | None:
    """The worst configurations; None where no run failed."""
    found = [_case(facts, k) for k in cases(facts.tables, facts.findings)]
    figures = [case["picture"] for case in found if case["picture"] is not None]
    title, values = "Worst configurations", {"cases": found}
    return Section("worst", "Worst", title, folded=False, values=values, figures=figures) if found else None


def failed_section(facts: Facts) -> Section | None:
    """The failed runs of each configuration with the words of each oracle; None where none failed."""
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


def first_of(kind: Mapping[str, Any]) -> str:
    """The first reason of a kind, marked where there are others."""
    reason: str = kind["reason"]
    return Markup("{} <small>(for example)</small>").format(reason) if kind["reasons"] > 1 else reason


def failure_kinds(failures: pd.DataFrame) -> list[Mapping[str, Any]]:
    """A row for each oracle and kind of reason, the most frequent first.

    Args:
        failures: Failures in the form of `VerdictTable.reasons`.
    """
    kinds = failures.assign(kind=pd.factorize(failures.reason.map(kind_of))[0]).groupby(
        ["oracle", "kind"], observed=True
    )
    found = kinds.agg(
        reason=("reason", "first"),
        reasons=("reason", "nunique"),
        runs=("reason", "size"),
        configurations=("configuration", "nunique"),
        configuration=("configuration", "first"),
        run_index=("run_index", "first"),
    )
    rows: list[Mapping[str, Any]] = (
        found.sort_values("runs", ascending=False, kind="stable").reset_index().to_dict("records")
    )
    return rows


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


def _case(facts: Facts, configuration: int) -> dict[str, Any]:
    found, verdicts = facts.tables.configurations, facts.tables.verdicts
    name, rows = found.names[configuration], verdicts.rows_of(configuration)
    place = int(np.searchsorted(found.distinct, configuration))
    passed, failed, _ = facts.findings.counts[place].tolist()
    varied = [f"{key} {value}" for key in facts.varied if (value := facts.factor(configuration, key))]
    reasons = facts.failures[facts.failures.configuration == name].drop_duplicates("oracle")  # the first of each
    return {
        "name": name,
        "class": facts.findings.classes.names[place],
        "failed": failed,
        "judged": passed + failed,
        "varied": " · ".join(varied[:6]),
        "reasons": list(zip(reasons.oracle, reasons.reason, strict=True)),
        "run_index": int(verdicts.run_index[rows][verdicts.together[rows] == FAIL][0]),
        "picture": case_picture(facts.tables, configuration, facts.files),
    }
