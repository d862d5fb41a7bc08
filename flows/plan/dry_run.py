"""A dry run: what a run of a campaign would find in the store and what it would compute, and why. It writes nothing."""

import tempfile
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Final, TypeAlias

from rich.console import RenderableType
from rich.text import Text

from vastflow.flows.plan.reasons import NEVER, Evaluated, EvaluationReasons, HereEvaluator, RunReasons
from vastflow.flows.request.campaign_file import campaign_name, read_campaign
from vastflow.flows.request.campaign_keys import campaign_keys
from vastflow.flows.request.configurations import Selection, members_of, narrowed
from vastflow.flows.request.stopping import Stopping, stopping_of
from vastflow.flows.results.past import Past, newest_past, past_of
from vastflow.flows.results.provenance import DueReason, ReasonKind, Stage, ingredients_row, origin_row
from vastflow.flows.terminal.table import terminal_table
from vastflow.flows.terminal.words import count_text
from vastflow.producers.instantiation.family import robots_json
from vastflow.producers.model.configuration import Configuration
from vastflow.producers.model.faults import CampaignError
from vastflow.producers.search.criteria import plan_text
from vastflow.tasks.engine.index import Index, Member, missing
from vastflow.tasks.engine.instantiation import Instantiated, Instantiator, ProducerFault
from vastflow.tasks.keys.keys import Keys
from vastflow.tasks.keys.source import installed_tree
from vastflow.tasks.store.artifact import Stored
from vastflow.tasks.store.store import Lost, open_store

STAGES: Final[tuple[Stage, ...]] = ("instantiate", "execute", "observe", "judge")

_TRIES: Final = 3


@dataclass(frozen=True, slots=True)
class Due:
    """Something that a run would compute.

    Attributes:
        subject: A configuration; at `instantiate` a producer.
        amount: Runs of it; at `instantiate` one evaluation.
    """

    stage: Stage
    family: str
    subject: str
    amount: int
    reason: DueReason


@dataclass(frozen=True)
class DryRun:
    """What a run would do.

    Attributes:
        name: The campaign's.
        runs: Of each configuration.
        sequential: Whether that is the most: what is due of those whose class is not decided is then what they may want.
        past: The campaign it was compared with.
        configurations: Of what was asked, duplicates included.
        robots: Of the families, see `vastflow.producers.instantiation.family`.
        sampled_from: How many distinct configurations these are a sample of; None where they are no sample.
        reused: Stage and family to what is in the store: runs, at `instantiate` evaluations.
        due: What is not.
        stored: Configuration to what is in the store of it.
        faults: Producers that raised, as they would in a run.
    """

    name: str
    runs: int
    past: Past | None
    configurations: Sequence[Configuration] = field(repr=False)
    reused: Mapping[tuple[Stage, str], int]
    due: Sequence[Due] = field(repr=False)
    stored: Mapping[str, Sequence[Stored]] = field(repr=False)
    faults: Sequence[ProducerFault]
    keys: Keys = field(repr=False)
    sampled_from: int | None = None
    sequential: bool = False
    robots: Sequence[Mapping[str, Any]] = ()

    def found(self, stage: Stage, family: str | None = None) -> int:
        """What is in the store of a stage, of one family or of all."""
        return sum(n for (of, name), n in self.reused.items() if of == stage and family in (None, name))

    def computed(self, stage: Stage, family: str | None = None) -> int:
        """What a stage would compute, of one family or of all."""
        return sum(due.amount for due in self.due if due.stage == stage and family in (None, due.family))

    @property
    def families(self) -> list[str]:
        """Families in order, those of whose configurations nothing is left included."""
        return list(dict.fromkeys([*(family for _, family in self.reused), *(due.family for due in self.due)]))


def dry_run(
    file: Path,
    *,
    runs: int | None = None,
    results: Path = Path("results"),
    store: str | None = None,
    only: Sequence[str] = (),
    sample: int | None = None,
    map_dir: Path | None = None,
    as_v1: bool = False,
    strict: bool = False,
    since: Path | None = None,
) -> DryRun:
    """Find out what a run of the campaign at `file` would do with the same arguments.

    What producers make is taken from the store, or made in this process and not stored.

    Args:
        since: The campaign directory to compare with, else the newest of this campaign's name in `results`.

    Raises:
        CampaignError: faults of the file, or a name in `only` that nothing has.
        UnusableDirectory: `since` is no campaign directory.
        StoreError: the store can't be used.
    """
    campaign, oracles = read_campaign(file, map_dir, as_v1=as_v1, strict=strict)
    if campaign.unexecutable:
        raise CampaignError(campaign.unexecutable)
    if campaign.search is not None:
        plan = plan_text(campaign.search.spec, campaign.runs, at_most=campaign.sequential is not None)
        what = f"what a search proposes follows from its runs; it is a {plan}"
        raise CampaignError(
            [campaign.fault(("search",), what, "vastflow run, which goes on from what the store has", "key")]
        )
    name = campaign_name(campaign)
    past = newest_past(results, name) if since is None else past_of(since)
    tree = installed_tree()
    keys = campaign_keys(tree, campaign.seed, oracles)
    today = {} if past is None else {**origin_row(keys), **ingredients_row(tree, campaign.families, oracles)}
    looked_at = open_store(store, read_only=True)
    looked_at.survey()
    with tempfile.TemporaryDirectory(prefix="vastflow-") as environments:
        evaluations = None if past is None else EvaluationReasons(past, today, campaign.families)
        evaluator = HereEvaluator(looked_at, evaluations, Path(environments))
        found = _instantiated(Instantiator(campaign, looked_at, keys, tree), evaluator)
    chosen = narrowed(found, Selection(only, sample, campaign.seed), campaign.document.file)
    instantiation = chosen.instantiation
    wanted = campaign.runs_asked(runs, sample)
    members = members_of(instantiation, wanted)
    index = Index(looked_at, keys)
    stopping = stopping_of(campaign.sequential) if runs is None else None
    if stopping is not None:
        members = [_ending(stopping, index, member) for member in members]
    stored = {member.name: index.stored(member) for member in members}
    reasons = None if past is None else RunReasons(past, today, found.instantiation.configurations)
    reused, due = _evaluations(evaluator.evaluated.values())
    for member in members:
        _count(member, stored[member.name], reasons, reused, due)
    return DryRun(
        name,
        wanted,
        past,
        instantiation.configurations,
        reused,
        due,
        stored,
        chosen.faults,
        keys,
        instantiation.sampled_from,
        stopping is not None,
        robots_json(campaign.families),
    )


def _ending(stopping: Stopping, index: Index, member: Member) -> Member:
    """A member with the runs at which its class is decided, or with the most as long as it is not."""
    wanted, stored = stopping.stored(index, member)
    whole = all(each.verdicts for each in stored) and not missing([each.block for each in stored], wanted.runs)
    return wanted if whole else member


def _instantiated(instantiator: Instantiator, evaluator: HereEvaluator) -> Instantiated:
    for _ in range(_TRIES):
        try:
            return instantiator.instantiated(evaluator)
        except Lost:  # a damaged evaluation: now it seems gone, and is made here
            continue
    raise Lost("what the producers made is lost again and again")


Reused: TypeAlias = Counter[tuple[Stage, str]]


def _evaluations(evaluated: Iterable[Evaluated]) -> tuple[Reused, list[Due]]:
    reused: Reused = Counter()
    due = []
    for each in evaluated:
        reused["instantiate", each.family] += each.reason is None
        if each.reason is not None:
            due.append(Due("instantiate", each.family, each.producer, 1, each.reason))
    return reused, due


def _count(
    member: Member, stored: Sequence[Stored], reasons: RunReasons | None, reused: Reused, due: list[Due]
) -> None:
    """Sort a member's runs into what is there and what is to be computed, stage by stage."""
    absent = missing([each.block for each in stored], member.runs)
    states: dict[Stage, set[int]] = {"execute": set(), "observe": set(), "judge": set()}
    for each in stored:
        span = range(each.block.start, min(each.block.stop, member.runs))
        states["execute"].update(span)
        states["observe"].update(span if each.trace else ())
        states["judge"].update(span if each.verdicts else ())
    for stage, there in states.items():
        reused[stage, member.family] += len(there)

    def add(stage: Stage, amount: int, reason: DueReason) -> None:
        if amount:
            due.append(Due(stage, member.family, member.name, amount, reason))

    recorded, observed, judged = states.values()
    if absent:
        for reason, amount in reasons.execute(member, absent) if reasons else [(NEVER, len(absent))]:
            add("execute", amount, reason)
        add("observe", len(absent), _FOLLOWS_EXECUTE)
    if unobserved := len(recorded - observed):
        add("observe", unobserved, reasons.later("observe", member) if reasons else NEVER)
    add("judge", member.runs - len(observed), _FOLLOWS_EXECUTE if absent else _FOLLOWS_OBSERVE)
    if unjudged := len(observed - judged):
        add("judge", unjudged, reasons.later("judge", member) if reasons else NEVER)


_FOLLOWS_EXECUTE: Final = DueReason("follows", "follows from execute")
_FOLLOWS_OBSERVE: Final = DueReason("follows", "follows from observe")


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
