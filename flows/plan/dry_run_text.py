"""A dry run in JSON and for people."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Final

from rich.console import RenderableType
from rich.text import Text

from vastflow.flows.plan.dry_run import STAGES, DryRun, Due
from vastflow.flows.results.ingredients import ReasonKind, Stage
from vastflow.flows.terminal.table import terminal_table
from vastflow.flows.terminal.words import count_text

MOST_REASONS: Final = 20
"""Reasons in the terminal; `--json` has all."""
MOST_SUBJECTS: Final = 3

UNITS: Final[Mapping[Stage, str]] = {"instantiate": "evaluation", "execute": "run", "observe": "run", "judge": "run"}


@dataclass
class Why:
    """What is computed of a stage and family for the same reason.

    Attributes:
        subjects: Configurations, or at `instantiate` producers, in order.
        detail: Of the first of them.
        alike: Whether it is that of all.
    """

    stage: Stage
    family: str
    kind: ReasonKind
    what: str
    detail: str
    alike: bool = True
    amount: int = 0
    subjects: dict[str, None] = field(default_factory=dict)

    def __str__(self) -> str:
        if not self.detail:
            return self.what
        return (
            f"{self.what}: {self.detail}"
            if self.alike
            else f"{self.what}, such as {next(iter(self.subjects))} {self.detail}"
        )


def whys(due: Sequence[Due]) -> list[Why]:
    """What is due, by stage, family and reason."""
    found: dict[tuple[str, str, str, str], Why] = {}
    for each in due:
        key = each.stage, each.family, each.reason.kind, each.reason.what
        why = found.setdefault(
            key, Why(each.stage, each.family, each.reason.kind, each.reason.what, each.reason.detail)
        )
        why.alike = why.alike and why.detail == each.reason.detail
        why.amount += each.amount
        why.subjects[each.subject] = None
    return sorted(found.values(), key=lambda why: STAGES.index(why.stage))


def dry_run_json(found: DryRun, file: Path) -> dict[str, Any]:
    """Counts of each stage, of the campaign and of each family, and the reasons."""
    return {
        "campaign": found.name,
        "file": str(file),
        "runs": found.runs,
        "at_most": found.sequential,
        "configurations": _distinct(found),
        "sampled_from": found.sampled_from,
        "compared_with": None if found.past is None else str(found.past.directory),
        "stages": {stage: _counts(found, stage) for stage in STAGES},
        "families": {family: {stage: _counts(found, stage, family) for stage in STAGES} for family in found.families},
        "robots": list(found.robots),
        "why": [
            {
                "stage": why.stage,
                "family": why.family,
                "kind": why.kind,
                "reason": str(why),
                "computed": why.amount,
                "of": list(why.subjects),
            }
            for why in whys(found.due)
        ],
        "faults": [str(fault) for fault in found.faults],
    }


def _distinct(found: DryRun) -> int:
    return sum(each.duplicate_of is None for each in found.configurations)


def _counts(found: DryRun, stage: Stage, family: str | None = None) -> dict[str, int]:
    return {"reused": found.found(stage, family), "computed": found.computed(stage, family)}


def dry_run_text(found: DryRun) -> Iterator[RenderableType]:
    """A table of counts, and a line for each reason."""
    table = terminal_table(("stage", "family"), ("in the store", "to compute"), ("",))
    for stage in STAGES:
        for family in found.families:
            counts = _counts(found, stage, family)
            table.add_row(stage, family, f"{counts['reused']:,}", f"{counts['computed']:,}", f"{UNITS[stage]}s")
    yield table
    yield ""
    if found.sampled_from is not None:
        yield Text(f"a sample of {_distinct(found):,} of {found.sampled_from:,} distinct configurations")
    if found.sequential:
        yield Text(
            "runs end when a configuration's class is decided: there is no more to compute than this, but maybe less"
        )
    for each in found.robots:
        yield Text(f"{', '.join(each['families'])}: {'; '.join(each['robot'])}", "dim")
    if found.past is None:
        yield Text("compared with nothing: no earlier campaign of this name in the folder of results", "dim")
    else:
        yield Text(f"compared with {found.past.directory}", "dim")
    if not found.due:
        yield Text("everything is in the store: nothing would be computed, Prefect would not start")
    reasons = [why for why in whys(found.due) if why.kind != "follows"]
    for why in reasons[:MOST_REASONS]:
        yield Text(_sentence(why))
    if len(reasons) > MOST_REASONS:
        yield Text(f"and {len(reasons) - MOST_REASONS} more reasons; --json has all", "dim")
    if any(due.reason.kind == "follows" for due in found.due):
        yield Text("what is computed anew is observed and judged; a run that comes out as before keeps both", "dim")
    for fault in found.faults:
        yield Text(str(fault), "red")


def _sentence(why: Why) -> str:
    more = len(why.subjects) - MOST_SUBJECTS
    subjects = ", ".join(list(why.subjects)[:MOST_SUBJECTS]) + (f" and {more} more" if more > 0 else "")
    return f"{why.stage} {count_text(why.amount, UNITS[why.stage])} of {subjects}: {why}"
