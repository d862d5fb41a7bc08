"""What the report's tables and lists show, row by row."""

import inspect
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Final

import numpy as np

from vastflow.oracles.catalog.robustness import DEFAULT_BASIS
from vastflow.oracles.evidence.criteria import MEASURES_ALONE
from vastflow.oracles.evidence.evidence import Evidence, Group, Spread
from vastflow.oracles.evidence.findings import Findings
from vastflow.oracles.evidence.standstills import Standstills
from vastflow.oracles.evidence.varied import named
from vastflow.oracles.figures.scene import Scene, environment_counts
from vastflow.oracles.judgement.oracle import known_oracles, oracle_class
from vastflow.oracles.page.table import Column, DataTable, configuration_cells, rate_cell
from vastflow.oracles.page.words import position, short
from vastflow.oracles.results import coverage
from vastflow.oracles.results.column import floats
from vastflow.oracles.results.tables import Tables
from vastflow.oracles.results.verdict_table import FAIL, Reasons
from vastflow.oracles.statistics.intervals import thousandths, wilson_intervals

MAX_ROWS: Final = 500
"""Rows of a list; the files beside the report have all."""
ROBUSTNESS: Final = "robustness"
BASES: Final = ("update", "step", "metre", "mean", "maximum")
CASES: Final = 9
PLACES: Final = 3
"""Places listed of a map."""
_CASES_OF_A_FAMILY: Final = 2


@dataclass(frozen=True, slots=True)
class Basis:
    """Localization error summed or taken on one basis, over all runs that have it.

    Attributes:
        judged: Whether the campaign judges by it.
        above: Share of runs above the threshold: the failure rate on this basis.
    """

    name: str
    judged: bool
    n: int
    median: float
    high: float
    maximum: float
    above: float


def group_rows(evidence: Mapping[str | None, Evidence]) -> list[tuple[str, Mapping[str | None, Group]]]:
    """The campaign and each family, with their group per oracle."""
    whole = ("Whole campaign", {oracle: found.campaign for oracle, found in evidence.items()})
    families = evidence[None].families
    return [whole, *((name, {oracle: e.families[name] for oracle, e in evidence.items()}) for name in families)]


def family_table(evidence: Mapping[str | None, Evidence], stood: Standstills) -> DataTable:
    """Rates of each family, by each oracle, and how many of its runs stood still where any did."""
    columns = [Column("Family"), Column("Configurations", "number")]
    columns += [Column(oracle or "All oracles", "rate") for oracle in shown_oracles(evidence)]
    columns += _stood_still(stood)
    rows = [
        [
            *(name, groups[None].configurations),
            *(rate_cell(groups[oracle].counts) for oracle in shown_oracles(evidence)),
            *([stood.of(groups[None].members)] if stood.runs else []),
        ]
        for name, groups in group_rows(evidence)[1:]
    ]
    return DataTable("families", columns, rows, "evidence.json")


def _stood_still(stood: Standstills) -> list[Column]:
    return [Column("Stood still", "number")] if stood.runs else []


def shown_oracles(evidence: Mapping[str | None, Evidence]) -> list[str | None]:
    """All together and each oracle that can fail a run; all together alone where there is but one."""
    judging = [oracle for oracle in evidence if oracle not in MEASURES_ALONE]
    return judging if len(judging) > 2 else [None]


def configuration_table(
    tables: Tables,
    evidence: Mapping[str | None, Evidence],
    findings: Findings,
    stood: Standstills,
    names: Mapping[str, str],
) -> DataTable:
    """A row for each distinct configuration, the worst first.

    Args:
        names: Of maps, by digest.
    """
    found = tables.configurations
    varied = varied_factors(tables)
    oracles = shown_oracles(evidence)
    columns = [Column("Configuration"), Column("Family", "choice"), Column("Class", "class")]
    columns += [Column(oracle or "All oracles", "rate") for oracle in oracles]
    columns += _stood_still(stood)
    columns += [Column(key, "number" if numeric else "text") for key, numeric in varied.items()]
    cells_of = [configuration_cells(evidence[oracle]) for oracle in oracles]
    rows = []
    for k, name in zip(found.distinct, findings.classes.names, strict=True):
        factors = found.factors[k]
        cells = [
            factors.get(key) if numeric else short(named(factors[key], names)) if key in factors else ""
            for key, numeric in varied.items()
        ]
        rates = [by_name[found.names[k]] for by_name in cells_of]
        still = [stood.of([found.names[k]])] if stood.runs else []
        rows.append([found.names[k], found.families[k], name, *rates, *still, *cells])
    rows.sort(key=lambda row: (row[3][4], row[3][0] - row[3][1]))  # the success rate's upper bound, then failures
    return DataTable("configurations", columns, rows, "evidence.json")


def undecided_table(tables: Tables, findings: Findings) -> DataTable:
    """The configurations without a class, and how likely each is to be reliable, the likeliest first."""
    found, counts = tables.configurations, findings.counts
    rows = [
        [
            *(findings.names[k], found.families[found.distinct[k]]),
            *(int(counts[k, 0]), int(counts[k, :2].sum()), round(float(findings.reliable_chance[k]), 3)),
        ]
        for k in findings.undecided
    ]
    columns = [
        Column("Configuration"),
        Column("Family", "choice"),
        Column("Passed", "number"),
        Column("Of judged", "number"),
    ]
    return DataTable("undecided", [*columns, Column("P(rate ≥ 80 %)", "number")], rows, "evidence.json")


def varied_factors(tables: Tables) -> dict[str, bool]:
    """Keys whose value is not the same in every configuration, and whether all their values are numbers."""
    values: dict[str, set[str]] = {}
    numeric: dict[str, bool] = {}
    present: Counter[str] = Counter()
    for factors in tables.configurations.factors:
        present.update(factors.keys())
        for key, value in factors.items():
            values.setdefault(key, set()).add(repr(value))
            is_number = isinstance(value, int | float) and not isinstance(value, bool)
            numeric[key] = numeric.get(key, True) and is_number
    return {
        key: numeric[key] for key, seen in values.items() if len(seen) > 1 or present[key] < len(tables.configurations)
    }


def environment_table(tables: Tables, names: Mapping[str, str]) -> DataTable:
    """The rate on each map."""
    rows = [[names[key], rate_cell(counts)] for key, counts in environment_counts(tables).items()]
    return DataTable("environments", [Column("Map"), Column("All oracles", "rate")], rows)


def place_table(scenes: Sequence[Scene], names: Mapping[str, str]) -> DataTable:
    """The places that are shown to be failed at more than elsewhere, the worst first, neighbors of a worse one left out."""
    rows: list[list[Any]] = []
    for scene in scenes:
        found = scene.failures
        rate, intervals, hot = found.rate(), found.intervals(), found.hot()
        taken: list[tuple[int, int]] = []
        for row, column in sorted(map(tuple, np.argwhere(hot).tolist()), key=lambda at: -rate[at]):
            if len(taken) < PLACES and all(abs(row - r) > 4 or abs(column - c) > 4 for r, c in taken):
                taken.append((row, column))
                x = found.grid.origin_xy_m[0] + (column + 0.5) * found.grid.cell_m
                y = found.grid.origin_xy_m[1] + (row + 0.5) * found.grid.cell_m
                n, failed = int(found.visits[row, column]), int(found.failures[row, column])
                ends = thousandths(intervals[row, column]).tolist()
                rows.append([names[scene.environment], position(x, y), [failed, n, 0, *ends]])
    rows.sort(key=lambda row: -row[2][0] / row[2][1])
    columns = [Column("Map", "choice"), Column("Place"), Column("Failed of visits", "rate")]
    return DataTable("places", columns, rows)


def cases(tables: Tables, findings: Findings) -> list[int]:
    """Indices of the worst configurations by the lower bound of their failure rates, few of any one family while there are others."""
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


def case_row(
    tables: Tables, configuration: int, findings: Findings, said: Reasons, names: Mapping[str, str]
) -> Mapping[str, Any]:
    """What the page says of one of the worst configurations.

    Args:
        said: All failures.
        names: Of maps, by digest.
    """
    found, verdicts = tables.configurations, tables.verdicts
    first, last = np.searchsorted(verdicts.configuration, (configuration, configuration + 1))
    bad = first + int(np.flatnonzero(verdicts.together[first:last] == FAIL)[0])
    place = int(np.searchsorted(found.distinct, configuration))
    passed, failed, not_judged = findings.counts[place].tolist()
    varied = varied_factors(tables)
    return {
        "name": found.names[configuration],
        "family": found.families[configuration],
        "class": findings.classes.names[place],
        "failed": failed,
        "judged": passed + failed,
        "not_judged": not_judged,
        "run_index": int(verdicts.run_index[bad]),
        "factors": [
            (key, short(named(found.factors[configuration][key], names)))
            for key in varied
            if key in found.factors[configuration]
        ][:6],
        "said": list(_first_reasons(tables, configuration, said)),
    }


def _first_reasons(tables: Tables, configuration: int, said: Reasons) -> Iterator[tuple[str, str]]:
    """Each oracle that failed a run of the configuration, and the first of its reasons."""
    seen: set[int] = set()
    for k in np.flatnonzero(said.configuration == configuration):
        oracle = int(said.oracle[k])
        if oracle not in seen:
            seen.add(oracle)
            yield tables.oracles[oracle], said.known[said.reason[k]]


def basis_rows(tables: Tables) -> list[Basis]:
    """What each basis of the robustness oracle would say beside the one that judges; empty where it is not in use."""
    if ROBUSTNESS not in tables.oracles:
        return []
    metrics = tables.verdicts.metrics(ROBUSTNESS)
    judged: Mapping[str, Any] = next(
        (o["parameters"] for o in tables.metadata.get("oracles", []) if o["name"] == ROBUSTNESS), {}
    )
    rows = []
    for name in BASES:
        if name in metrics and "threshold" in metrics:
            known = np.isfinite(metrics[name].values) & np.isfinite(metrics["threshold"].values)
            values, threshold = metrics[name].values[known], metrics["threshold"].values[known]
            if len(values):
                quantiles = (float(np.median(values)), float(np.quantile(values, 0.95)), float(values.max()))
                above = float((values > threshold).mean())
                rows.append(Basis(name, name == judged.get("basis", DEFAULT_BASIS), len(values), *quantiles, above))
    return rows


def measured_table(spreads: Mapping[str, Mapping[str, Spread]]) -> DataTable:
    """The spread of each metric."""
    columns = [
        Column("Oracle", "choice"),
        Column("Metric"),
        *(Column(c, "number") for c in ("Smallest", "Median", "Greatest")),
    ]
    rows = [
        [oracle, name.replace("_", " "), spread.minimum, spread.median, spread.maximum, _unit(spread), spread.n]
        for oracle, metrics in spreads.items()
        for name, spread in metrics.items()
        if spread.n
    ]
    return DataTable("metrics", [*columns, Column("Unit"), Column("Runs", "number")], rows)


def _unit(spread: Spread) -> str:
    return "" if spread.unit == "1" else spread.unit


def totals(tables: Tables) -> Mapping[str, Any]:
    """Sums over all runs."""
    return {
        "environments": len({*tables.configurations.environments} - {None}),
        "simulated_s": float(np.nansum(floats(tables.runs["simulated_s"]))),
        "distance_m": float(np.nansum(floats(tables.runs["distance_m"]))),
        "runs": len(tables.verdicts),
    }


def coverage_rows(tables: Tables) -> Mapping[str, Any] | None:
    """What the section on coverage shows; None for a campaign directory of before there was `coverage.json`."""
    if not (tables.directory / coverage.FILE).is_file():
        return None
    found = coverage.read_coverage(tables.directory)
    listed = list(coverage.pairs(found))
    return {
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


def explanation(oracle: str) -> Mapping[str, Any]:
    """What an installed oracle says of itself; an oracle of a file beside the campaign can't be asked here."""
    if oracle not in known_oracles():  # a file's name would be looked for in whatever folder this process works in
        return {"text": "An oracle of the campaign's own, see its file.", "defaults": {}}
    found = oracle_class(oracle)
    paragraphs = (inspect.getdoc(found) or "").split("\n\n")
    fields = found.Parameters.model_fields
    return {
        "text": " ".join(" ".join(p for p in paragraphs if not p.startswith("Metrics:")).replace("`", "").split()),
        "defaults": {name: field.default for name, field in fields.items() if not field.is_required()},
    }
