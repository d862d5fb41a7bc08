"""A plan and the coverage of a test space, for people and as JSON."""

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict
from typing import Any, Final

import pyarrow as pa
from rich.console import RenderableType
from rich.table import Table
from rich.text import Text

from vastflow.flows.plan.plan import Plan
from vastflow.flows.results.provenance import STAGES, Stage
from vastflow.flows.results.reasons import whys
from vastflow.flows.results.tables import configuration_row
from vastflow.flows.terminal.display import terminal_table
from vastflow.flows.terminal.progress import count_text, duration_text
from vastflow.oracles.evidence.findings import by_varying_keys
from vastflow.oracles.evidence.varied import chosen_rows
from vastflow.oracles.page.words import plural, power_text
from vastflow.oracles.results.coverage import (
    COUNTS,
    Coverage,
    Covered,
    Loss,
    counts,
    design_text,
    dimensions,
    excluded,
    pairs,
    pairs_not_listed,
    parts,
    unrealizable,
)
from vastflow.oracles.results.factors import factors_of
from vastflow.oracles.results.schema import CONFIGURATIONS
from vastflow.oracles.results.tables import ConfigurationTable
from vastflow.oracles.results.units import units_of
from vastflow.oracles.statistics.power import power_of

MOST_LOSSES: Final = 20
MOST_PAIRS: Final = 30
"""Pairs of producers in the terminal, the least covered of each family first; `--json` has more."""
MOST_REASONS: Final = 20
"""Reasons in the terminal; `--json` has all."""
MOST_SUBJECTS: Final = 3

UNITS: Final[Mapping[Stage, str]] = {"instantiate": "evaluation", "execute": "run", "observe": "run", "judge": "run"}


def plan_json(plan: Plan, file: str) -> dict[str, Any]:
    """Return the plan as JSON values."""
    return {
        "campaign": plan.name,
        "file": file,
        "runs": plan.runs,
        "at_most": plan.least is not None,
        "configurations": len(plan.distinct),
        "sampled_from": plan.sampled_from,
        "coverage": plan.coverage,
        "compared_with": None if plan.past is None else str(plan.past.directory),
        "stages": stages_json(plan),
        "families": {family: stages_json(plan, family) for family in plan.families},
        "robots": list(plan.robots),
        "estimate_s": round(plan.estimate.wall_s, 1),
        "why": why_json(plan),
        "power": list(planned_power(plan)),
        "faults": [*map(str, plan.unexecutable), *map(str, plan.faults)],
    }


def stages_json(plan: Plan, family: str | None = None) -> dict[Stage, dict[str, int]]:
    """Return stored and due amounts by stage."""
    return {stage: {"reused": plan.found(stage, family), "computed": plan.computed(stage, family)} for stage in STAGES}


def why_json(plan: Plan) -> list[dict[str, Any]]:
    """Return due work by stage, family, and reason."""
    return [
        {
            "stage": why.stage,
            "family": why.family,
            "kind": why.kind,
            "reason": str(why),
            "computed": why.amount,
            "of": list(why.subjects),
        }
        for why in whys(plan.steps)
    ]


def plan_text(plan: Plan, *, why: bool = False, coverage: bool = False) -> Iterator[RenderableType]:
    """Format the plan, with the reasons (`why`), or with dimensions and pairs of producers (`coverage`)."""
    yield from coverage_text(plan.coverage, details=coverage)
    yield ""
    if not plan.unexecutable:
        table = terminal_table(("stage", "family"), ("in the store", "to compute"), ("",))
        for stage in STAGES:
            for family in plan.families:
                numbers = (plan.found(stage, family), plan.computed(stage, family))
                table.add_row(stage, family, *(f"{n:,}" for n in numbers), f"{UNITS[stage]}s")
        yield from (table, "")
    if plan.sampled_from is not None:
        yield Text(f"a sample of {len(plan.distinct):,} of {plan.sampled_from:,} distinct configurations")
    if plan.least is not None:
        yield Text(
            f"runs at most: a configuration has {plan.least} to {plan.runs}, and ends when its class is decided, "
            "so that less may be computed"
        )
    for each in plan.robots:
        yield Text(f"{', '.join(each['families'])}: {'; '.join(each['robot'])}", "dim")
    if not plan.due and not plan.unexecutable:
        yield Text("everything is in the store: nothing would be computed, Prefect would not start")
    elif plan.due and not any(each.amount for each in plan.due):
        yield Text("every verdict is in the store: no oracle would judge, causes of failures would follow anew")
    elif simulated_s := plan.estimate.simulated_s:
        about = "about" if plan.least is None else "at most about"
        times = f"{duration_text(plan.estimate.wall_s)} for {duration_text(simulated_s)} of simulated time"
        yield Text(f"estimate: {about} {times} ({plan.estimate.how})")
    for shown in planned_power(plan):
        yield Text(shown["text"], "dim")
    if why:
        yield from _why_text(plan)
    for fault in plan.faults:
        yield Text(str(fault), "red")


def _why_text(plan: Plan) -> Iterator[RenderableType]:
    if plan.past is None:
        yield Text("compared with nothing: no earlier campaign of this name in the folder of results", "dim")
    else:
        yield Text(f"compared with {plan.past.directory}", "dim")
    due = whys(plan.steps)
    reasons = [why for why in due if why.kind != "follows"]
    for why in reasons[:MOST_REASONS]:
        more = len(why.subjects) - MOST_SUBJECTS
        subjects = ", ".join(list(why.subjects)[:MOST_SUBJECTS]) + (f" and {more} more" if more > 0 else "")
        yield Text(f"{why.stage} {count_text(why.amount, UNITS[why.stage])} of {subjects}: {why}")
    if len(reasons) > MOST_REASONS:
        yield Text(f"and {len(reasons) - MOST_REASONS} more reasons (--json has all)", "dim")
    if len(reasons) < len(due):
        yield Text("what is computed anew is observed and judged, but a run that comes out as before keeps both", "dim")


def coverage_text(coverage: Coverage, *, details: bool = True) -> Iterator[RenderableType]:
    """Counts of each family, what constraints and producers took, and with `details` dimensions and pairs of producers."""
    whole = terminal_table(("family",), (*COUNTS, "share"), ("design",))
    for name, part in parts(coverage):
        design = design_text(part["design"]) if "design" in part else ""
        whole.add_row(name, *(f"{n:,}" for n in counts(part)), share_text(part["share"]), design)
    yield whole
    yield from _lost("excluded by constraints", list(excluded(coverage)))
    yield from _lost("unrealizable", list(unrealizable(coverage)))
    if not details:
        return
    yield ""
    yield _covered_table("dimension", list(dimensions(coverage)))
    if listed := list(pairs(coverage)):
        yield ""
        yield _covered_table("pair of producers", listed[:MOST_PAIRS])
        if rest := len(listed) - len(listed[:MOST_PAIRS]) + pairs_not_listed(coverage):
            yield Text(f"and {rest:,} more pairs (--json lists more)", "dim")


def _covered_table(what: str, rows: Sequence[Covered]) -> Table:
    with_contents = any(row.distinct is not None for row in rows)
    table = terminal_table(
        ("family", what),
        (*["contents"][:with_contents], "choices", "admissible", "covered", "share"),
        ["written by"][:with_contents],
    )
    for row in rows:
        numbers = (*[row.distinct or 0][:with_contents], row.combinations, row.admissible, row.covered)
        by = [", ".join(row.factors) or "–"][:with_contents]
        table.add_row(row.family, row.what, *(f"{n:,}" for n in numbers), share_text(row.share), *by)
    return table


def share_text(share: float | None) -> str:
    """A share as text, rounded down, so that only the whole is 100 %."""
    if share is None:
        return "–"
    if 0.0 < share < 0.001:
        return "< 0.1 %"
    return f"{math.floor(share * 1000 + 1e-9) / 10:.1f} %"


def _lost(title: str, rows: list[Loss]) -> Iterator[RenderableType]:
    if not rows:
        return
    table = terminal_table()
    table.add_column(justify="right", no_wrap=True)
    for row in rows[:MOST_LOSSES]:
        table.add_row(f"{row.times:,} ×", row.family, row.by, row.reason)
    yield from ("", Text(title, "bold"), table)
    if rest := rows[MOST_LOSSES:]:
        yield Text(f"and {sum(row.times for row in rest):,} more for {len(rest):,} other reasons (see --json)", "dim")


MOST_PLANNED: Final = 5000
"""Configurations up to which a plan tells it: larger campaigns show any effect of interest, and reading them takes seconds."""


def planned_power(plan: Plan) -> Iterator[dict[str, Any]]:
    """Least effects on the failure rate that a campaign of this size shows; none above `MOST_PLANNED` configurations.

    A row is of factors with as many levels, in families where the same things vary; its `runs` are those of a situation at a level.
    """
    if len(distinct := plan.distinct) > MOST_PLANNED:
        return
    table = ConfigurationTable(pa.Table.from_pylist([*map(configuration_row, distinct)], CONFIGURATIONS))
    units = units_of(table.contents)
    for places in by_varying_keys(table).values():
        codes = units.codes[places].tolist()
        situations, families = len(set(codes)), [*dict.fromkeys(table.families[k] for k in places)]
        varied = factors_of(chosen_rows(table, places, {}))[0]
        within = [each for each in varied if len(set(zip(codes, each.codes.tolist(), strict=True))) > situations]
        for levels in sorted({len(each.levels) for each in within}):
            names = [each.name for each in within if len(each.levels) == levels]
            runs = max(1, round((plan.least or plan.runs) * len(places) / (situations * levels)))
            power = power_of(situations, levels, runs, len(within))
            size = f"{plural(situations, units.noun)}, with {plural(runs, 'run')} at each of {levels} levels of {', '.join(names)}"
            yield {
                "text": f"{', '.join(families)}: {size}. {power_text(power, units)}",
                "families": families,
                "factors": names,
                "units": units.noun,
                "situations": situations,
                "levels": levels,
                "runs": runs,
                "power": asdict(power),
            }
