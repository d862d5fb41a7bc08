"""The plan of a run: configurations, coverage, stored results, due work, and reasons."""

import itertools
import math
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Final, TypeAlias

from vastflow.flows.plan.reasons import NEVER, Evaluated, EvaluationReasons, HereEvaluator, RunReasons
from vastflow.flows.request.campaign_file import campaign_name, read_campaign
from vastflow.flows.request.campaign_keys import campaign_keys
from vastflow.flows.request.configurations import Selection, distinct_configurations, narrowed
from vastflow.flows.request.run_request import RunRequest
from vastflow.flows.request.stopping import Stopping, stopping_of
from vastflow.flows.results.past import Past, newest_past, past_of
from vastflow.flows.results.provenance import STAGES, DueReason, ReasonKind, Stage, ingredients_row, origin_row
from vastflow.producers.instantiation.family import robots_json
from vastflow.producers.model.configuration import Configuration
from vastflow.producers.places.stops import PATH_LENGTH_KEY
from vastflow.producers.search.criteria import plan_text
from vastflow.sim.model.faults import Fault, FileError
from vastflow.sim.reading.script import script_of
from vastflow.tasks.engine.index import ConfigurationRuns, Index, missing
from vastflow.tasks.engine.instantiation import Instantiated, Instantiator, ProducerFault
from vastflow.tasks.engine.pool import cores
from vastflow.tasks.keys.keys import Keys
from vastflow.tasks.keys.source import installed_tree
from vastflow.tasks.store.artifact import Stored
from vastflow.tasks.store.store import Lost, open_store

MEAN_SPEED_MPS: Final = 0.3
"""Along the path, with stops and recoveries: 120 runs of some 6 m in `campaigns/quickstart` are about 40 minutes."""
TIMES_REAL_TIME: Final = 200.0
"""Of one core. `vastflow dev bench sim` measures it; less than it printed on a shared core of 2026, for runs are judged too."""


@dataclass(frozen=True, slots=True)
class Estimate:
    """Simulated time of all runs, and the time it takes on a number of cores.

    Attributes:
        timeout_s: Simulated time that no run exceeds.
    """

    simulated_s: float
    timeout_s: float
    cores: int

    @property
    def wall_s(self) -> float:
        """Time it may take on this machine."""
        return self.simulated_s / (TIMES_REAL_TIME * self.cores)

    @property
    def how(self) -> str:
        """The assumptions, in one sentence."""
        cores = "1 core" if self.cores == 1 else f"{self.cores} cores"
        return (
            f"each run its path at {MEAN_SPEED_MPS:g} m/s, {self.timeout_s:g} s at most, {cores} of {TIMES_REAL_TIME:g} times "
            "real time each; without Prefect's start and compilation"
        )


def estimate_of(
    configurations: Iterable[Configuration], runs: Mapping[str, int], timeout_s: float, cores: int
) -> Estimate:
    """The estimate for so many runs of each configuration by name."""
    simulated_s = sum(
        runs[each.name] * min(timeout_s, route_m(each) / MEAN_SPEED_MPS) for each in configurations if runs[each.name]
    )
    return Estimate(simulated_s, timeout_s, cores)


def route_m(configuration: Configuration) -> float:
    """Length of a configuration's route: of its path, else straight from stop to stop; infinite where it has no mission."""
    try:
        script = script_of(configuration.scenario)
    except ValueError:
        return math.inf
    if script.start is None or not script.goals:
        return math.inf
    length_m = configuration.provenance.get(PATH_LENGTH_KEY)
    if isinstance(length_m, int | float):
        return script.rounds * length_m
    stops = (script.start, *script.goals)  # of every round
    return sum(math.hypot(b.x_m - a.x_m, b.y_m - a.y_m) for a, b in itertools.pairwise(stops))


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
class Plan:
    """The plan of a run.

    Attributes:
        name: The campaign's.
        runs: Of each configuration; the maximum where `least` is given.
        least: Minimum number of runs where they end when a configuration's class is decided; what is due of an undecided one is
            then an upper bound.
        past: The earlier campaign that reasons are told from.
        configurations: The selected ones with their provenance, duplicates included.
        coverage: Of the whole campaign: requested, excluded, rejected with reasons, and realized instances.
        robots: Of the families, see `vastflow.producers.instantiation.family`.
        sampled_from: Number of distinct configurations that the sample is drawn from; None without a sample.
        reused: Stage and family to what is in the store: runs, at `instantiate` evaluations.
        due: What is not.
        stored: Configuration to what is in the store of it.
        estimate: Of the runs that are due.
        faults: Producers that raised, as they would in a run, and families that lack a file.
        unexecutable: Why this version can't run the campaign; then nothing is due but evaluations.
    """

    name: str
    runs: int
    least: int | None
    past: Past | None
    configurations: Sequence[Configuration] = field(repr=False)
    coverage: Mapping[str, Any] = field(repr=False)
    robots: Sequence[Mapping[str, Any]]
    sampled_from: int | None
    reused: Mapping[tuple[Stage, str], int]
    due: Sequence[Due] = field(repr=False)
    stored: Mapping[str, Sequence[Stored]] = field(repr=False)
    estimate: Estimate
    faults: Sequence[ProducerFault]
    unexecutable: Sequence[Fault]
    keys: Keys = field(repr=False)

    @property
    def distinct(self) -> list[Configuration]:
        """The selected configurations without duplicates."""
        return [each for each in self.configurations if each.duplicate_of is None]

    def found(self, stage: Stage, family: str | None = None) -> int:
        """Count stored results of a stage, for one family or all."""
        return sum(n for (of, name), n in self.reused.items() if of == stage and family in (None, name))

    def computed(self, stage: Stage, family: str | None = None) -> int:
        """Count due work of a stage, for one family or all."""
        return sum(due.amount for due in self.due if due.stage == stage and family in (None, due.family))

    @property
    def families(self) -> list[str]:
        """Families in order, those of whose configurations nothing is left included."""
        return list(dict.fromkeys([*(family for _, family in self.reused), *(due.family for due in self.due)]))


def plan_of(request: RunRequest, environments: Path, since: Path | None = None) -> Plan:
    """Return what a run of this request would compute.

    Evaluations of producers come from the store, or are made in this process and not stored.

    Args:
        environments: Folder for the files that producers make here.
        since: The campaign directory to compare with, else the newest of this campaign's name in `request.results`.

    Raises:
        FileError: faults of the file, or an unknown name in `only`.
        UnusableDirectory: `since` is not a campaign directory.
        StoreError: the store can't be used.
    """
    map_dir = None if request.map_dir is None else Path(request.map_dir)
    campaign, oracles = read_campaign(Path(request.campaign), map_dir, as_v1=request.as_v1, strict=request.strict)
    if campaign.search is not None:
        words = plan_text(campaign.search.spec, campaign.runs, at_most=campaign.sequential is not None)
        what = f"what a search proposes follows from its runs; it is a {words}"
        raise FileError(
            [campaign.fault(("search",), what, "vastflow run, which goes on from what the store has", "key")]
        )
    name = campaign_name(campaign)
    past = newest_past(Path(request.results), name) if since is None else past_of(since)
    tree = installed_tree()
    keys = campaign_keys(tree, campaign.seed, oracles)
    today = {} if past is None else {**origin_row(keys), **ingredients_row(tree, campaign.families, oracles)}
    store = open_store(request.store, read_only=True)
    store.refresh()
    evaluations = None if past is None else EvaluationReasons(past, today, campaign.families)
    evaluator = HereEvaluator(store, evaluations, environments)
    found = _instantiated(Instantiator(campaign, store, keys, tree), evaluator)
    chosen = narrowed(found, Selection(request.only, request.sample, campaign.seed), campaign.document.file)
    instantiation = chosen.instantiation
    runs = campaign.runs_asked(request.runs, request.sample)
    configurations = [] if campaign.unexecutable else distinct_configurations(instantiation, runs)
    index = Index(store, keys)
    sequential = campaign.sequential if request.runs is None else None
    if (stopping := stopping_of(sequential)) is not None:
        configurations = [_ending(stopping, index, configuration) for configuration in configurations]
    stored = {configuration.name: index.stored(configuration) for configuration in configurations}
    reasons = None if past is None else RunReasons(past, today, found.instantiation.configurations)
    reused, due = _evaluations(evaluator.evaluated.values())
    for configuration in configurations:
        _count(configuration, stored[configuration.name], reasons, reused, due)
    executed: Counter[str] = Counter()
    for each in due:
        executed[each.subject] += each.amount * (each.stage == "execute")
    return Plan(
        name=name,
        runs=runs,
        least=None if sequential is None else sequential.min,
        past=past,
        configurations=instantiation.configurations,
        coverage=found.instantiation.coverage,
        robots=robots_json(campaign.families),
        sampled_from=instantiation.sampled_from,
        reused=reused,
        due=due,
        stored=stored,
        estimate=estimate_of(instantiation.configurations, executed, campaign.timeout_s, cores()),
        faults=chosen.faults,
        unexecutable=campaign.unexecutable,
        keys=keys,
    )


def _ending(stopping: Stopping, index: Index, configuration: ConfigurationRuns) -> ConfigurationRuns:
    """Limit a configuration to the runs that decide its class; undecided ones keep the maximum."""
    wanted, stored = stopping.stored(index, configuration)
    whole = all(each.verdicts for each in stored) and not missing([each.block for each in stored], wanted.runs)
    return wanted if whole else configuration


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
    configuration: ConfigurationRuns,
    stored: Sequence[Stored],
    reasons: RunReasons | None,
    reused: Reused,
    due: list[Due],
) -> None:
    """Count a configuration's stored and missing runs, stage by stage."""
    absent = missing([each.block for each in stored], configuration.runs)
    states: dict[Stage, set[int]] = {"execute": set(), "observe": set(), "judge": set()}
    for each in stored:
        span = range(each.block.start, min(each.block.stop, configuration.runs))
        states["execute"].update(span)
        states["observe"].update(span if each.trace else ())
        states["judge"].update(span if each.verdicts else ())
    for stage, there in states.items():
        reused[stage, configuration.family] += len(there)

    def add(stage: Stage, amount: int, reason: DueReason) -> None:
        if amount:
            due.append(Due(stage, configuration.family, configuration.name, amount, reason))

    recorded, observed, judged = states.values()
    if absent:
        for reason, amount in reasons.execute(configuration, absent) if reasons else [(NEVER, len(absent))]:
            add("execute", amount, reason)
        add("observe", len(absent), _FOLLOWS_EXECUTE)
    if unobserved := len(recorded - observed):
        add("observe", unobserved, reasons.later("observe", configuration) if reasons else NEVER)
    add("judge", configuration.runs - len(observed), _FOLLOWS_EXECUTE if absent else _FOLLOWS_OBSERVE)
    if unjudged := len(observed - judged):
        add("judge", unjudged, reasons.later("judge", configuration) if reasons else NEVER)


_FOLLOWS_EXECUTE: Final = DueReason("follows", "follows from execute")
_FOLLOWS_OBSERVE: Final = DueReason("follows", "follows from observe")


@dataclass
class Why:
    """Due work of a stage and family with one reason.

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
    """Group due work by stage, family, and reason."""
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
