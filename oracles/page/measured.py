"""Sections on what was measured, and on the method."""

import inspect
from collections.abc import Iterator, Mapping
from typing import Any, Final

import numpy as np

from vastflow.oracles.catalog.robustness import DEFAULT_BASIS
from vastflow.oracles.judgement.cause import CAUSES
from vastflow.oracles.judgement.oracle import known_oracles, oracle_class
from vastflow.oracles.page.facts import Facts
from vastflow.oracles.page.pictures import threshold_pictures
from vastflow.oracles.page.section import Block, Group, Section, heading, soft
from vastflow.oracles.page.table import Column, Table, columns
from vastflow.oracles.page.words import percent, plural
from vastflow.oracles.results.tables import Tables

ROBUSTNESS: Final = "robustness"
_BASES: Final = {
    "update": "sum over AMCL's updates",
    "step": "sum over time steps",
    "metre": "sum over meters driven",
    "mean": "mean over time steps",
    "maximum": "greatest",
}


def measured_section(facts: Facts) -> Section:
    """The spread of each metric, and what other thresholds would have said."""
    rows = [
        [
            *(oracle, name.replace("_", " "), spread.minimum, spread.median, spread.maximum),
            *("" if spread.unit == "1" else spread.unit, spread.n),
        ]
        for oracle, metrics in facts.spreads.items()
        for name, spread in metrics.items()
        if spread.n
    ]
    head = [Column("Oracle", "choice"), Column("Metric"), *columns("number", "Smallest", "Median", "Greatest")]
    content: list[Block] = [Table([*head, Column("Unit"), Column("Runs", "number")], rows, "metrics")]
    if thresholds := list(threshold_pictures(facts.criteria)):
        content += [heading("Criteria that separate nothing"), Group("pair", thresholds)]
    content += _bases(facts.tables)
    return Section("measured", "Measured", "Measured", plural(len(rows), "metric"), content)


def method_section(facts: Facts) -> Section:
    """The section on methods and versions."""
    values = {"meanings": CAUSES, "explanations": {oracle: _explanation(oracle) for oracle in facts.tables.oracles}}
    summary = "how all of this is computed, and with which versions"
    return Section("method", "Method", "Method", summary, values=values)


def _explanation(oracle: str) -> Mapping[str, Any]:
    """Description and defaults of an installed oracle."""
    if oracle not in known_oracles():  # a file's name would be looked for in whatever folder this process works in
        return {"text": "An oracle of the campaign's own, see its file.", "defaults": {}}
    found = oracle_class(oracle)
    paragraphs = (inspect.getdoc(found) or "").split("\n\n")
    fields = found.Parameters.model_fields
    return {
        "text": " ".join(" ".join(p for p in paragraphs if not p.startswith("Metrics:")).replace("`", "").split()),
        "defaults": {name: field.default for name, field in fields.items() if not field.is_required()},
    }


def _bases(tables: Tables) -> Iterator[Block]:
    """A table of all bases of the robustness oracle."""
    if ROBUSTNESS not in tables.oracles:
        return
    metrics = tables.verdicts.metrics(ROBUSTNESS)
    asked = (each["parameters"] for each in tables.metadata.get("oracles", []) if each["name"] == ROBUSTNESS)
    parameters: Mapping[str, Any] = next(asked, {})
    judged_by = parameters.get("basis", DEFAULT_BASIS)
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
    if rows:
        yield heading("Localization error on every basis")
        yield soft(
            "A threshold on summed error depends on what is summed. "
            "The campaign judges by the basis in bold; the others say what they would."
        )
        numbers = columns("number", "Median (m)", "95 % below (m)", "Greatest (m)", "Runs above the threshold", "Runs")
        totals = [k for k, row in enumerate(rows) if row[0].endswith("judged by")]
        yield Table([Column("Basis", "name"), Column("Means"), *numbers], rows, totals=totals)
