"""The plan of a run: configurations and their pictures, coverage, stored results, due work, and reasons."""

import itertools
import math
import sys
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from vastflow.flows.request.campaign_file import campaign_keys, campaign_name, read_campaign
from vastflow.flows.request.configurations import distinct_configurations, narrowed
from vastflow.flows.request.run_request import RunRequest
from vastflow.flows.request.stopping import stopping_of
from vastflow.flows.results.past import Past, newest_past, past_of
from vastflow.flows.results.provenance import Stage, ingredients_row, origin_row
from vastflow.flows.results.reasons import Reasons, Step, run_steps
from vastflow.flows.terminal.progress import count_text
from vastflow.oracles.observation.situation import situation_of
from vastflow.producers.floorplan.environment import environments_in
from vastflow.producers.instantiation.robots import robots_json
from vastflow.producers.model.configuration import Configuration
from vastflow.producers.model.producer import evaluate
from vastflow.producers.places.stops import PATH_KEY, PATH_LENGTH_KEY
from vastflow.producers.search.criteria import plan_text
from vastflow.sim.model.faults import Fault, FileError
from vastflow.sim.reading.script import script_of
from vastflow.sim.world.environment import world_of
from vastflow.tasks.engine.evaluation import FRAGMENTS, write_evaluation
from vastflow.tasks.engine.forced import Forced
from vastflow.tasks.engine.index import Index, missing
from vastflow.tasks.engine.instantiation import EvaluationRequest, Instantiator, ProducerFault
from vastflow.tasks.engine.pool import cores
from vastflow.tasks.keys.keys import Keys
from vastflow.tasks.keys.source import installed_tree
from vastflow.tasks.store.store import Lost, Store, open_store

MEAN_SPEED_MPS: Final = 0.3
"""Along the path, with stops and recoveries: 120 runs of some 6 m in `campaigns/quickstart` are about 40 minutes."""
TIMES_REAL_TIME: Final = 200.0
"""Speed of one core, judging included: below what `python docs/studies/bench_simulator.py` printed on a shared core of 2026."""


@dataclass(frozen=True, slots=True)
class Estimate:
    """Simulated time of all runs, none longer than `timeout_s`, and the time it takes on a number of cores."""

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
        return (
            f"each run its path at {MEAN_SPEED_MPS:g} m/s, {self.timeout_s:g} s at most, {count_text(self.cores, 'core')} "
            f"of {TIMES_REAL_TIME:g} times real time each, without Prefect's start and compilation"
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


@dataclass(frozen=True)
class Plan:
    """The plan of a run.

    Attributes:
        runs: Number of runs of each configuration; the maximum where `least` is given.
        least: Minimum number of runs where they end when a configuration's class is decided; what is due of an undecided one is
            then an upper bound.
        past: The earlier campaign that reasons are told from.
        configurations: The selected ones with their provenance, duplicates included.
        coverage: Coverage of the whole campaign: requested, excluded, rejected with reasons, and realized instances.
        sampled_from: Number of distinct configurations that the sample is drawn from; None without a sample.
        steps: Steps that a run finds in the store, and those that it computes.
        estimate: Estimate for the runs that are due.
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
    steps: Sequence[Step] = field(repr=False)
    estimate: Estimate
    faults: Sequence[ProducerFault]
    unexecutable: Sequence[Fault]
    keys: Keys = field(repr=False)

    @property
    def distinct(self) -> list[Configuration]:
        """The selected configurations without duplicates."""
        return [each for each in self.configurations if each.duplicate_of is None]

    @property
    def due(self) -> list[Step]:
        """The steps that a run computes."""
        return [each for each in self.steps if each.reason is not None]

    def found(self, stage: Stage, family: str | None = None) -> int:
        """Count stored results of a stage, for one family or all."""
        steps = (each for each in self.steps if each.reason is None)
        return sum(each.amount for each in steps if each.stage == stage and family in (None, each.family))

    def computed(self, stage: Stage, family: str | None = None) -> int:
        """Count due work of a stage, for one family or all."""
        return sum(each.amount for each in self.due if each.stage == stage and family in (None, each.family))

    @property
    def families(self) -> list[str]:
        """Families in order, including ones without remaining configurations."""
        return list(dict.fromkeys(each.family for each in self.steps))


def plan_of(request: RunRequest, environments: Path, since: Path | None = None) -> Plan:
    """Return the work of a run of this request.

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
    campaign, oracles = read_campaign(Path(request.campaign), map_dir, strict=request.strict)
    if campaign.search is not None:
        words = plan_text(campaign.search.spec, campaign.runs, at_most=campaign.sequential is not None)
        what = f"the results of a search determine its next proposals: it is a {words}"
        raise FileError(
            [campaign.fault(("search",), what, "use vastflow run, which goes on from what the store has", "key")]
        )
    name = campaign_name(campaign)
    past = newest_past(Path(request.results), name) if since is None else past_of(since)
    tree = installed_tree()
    keys = campaign_keys(tree, campaign.seed, oracles)
    today = {} if past is None else {**origin_row(keys), **ingredients_row(tree, campaign.families, oracles)}
    store = open_store(request.store, read_only=True)
    store.refresh()
    forced = Forced(request.forced)
    reasons = Reasons(past, today, campaign.families, forced)
    evaluator = HereEvaluator(store, reasons, environments)
    instantiator = Instantiator(campaign, store, keys, tree, forced=forced)
    for _ in range(_TRIES):
        with suppress(Lost):  # a damaged evaluation: now it seems gone, and is made here
            found = instantiator.instantiated(evaluator)
            break
    else:
        raise Lost("what the producers made is lost again and again")
    chosen = narrowed(found, campaign.document.file, request.only, request.sample, campaign.seed)
    instantiation = chosen.instantiation
    runs = campaign.runs_asked(request.runs, request.sample)
    configurations = [] if campaign.unexecutable else distinct_configurations(instantiation, runs)
    index = Index(store, keys)
    sequential = campaign.sequential if request.runs is None else None
    stopping = None if sequential is None else stopping_of(sequential)
    forced.remove_results(index, configurations)
    reasons.configurations = {each.name: each for each in found.instantiation.configurations}
    steps = list(evaluator.steps.values())
    for configuration in configurations:
        certain = configuration.runs
        if stopping is not None:  # an undecided one keeps the maximum
            decided, blocks = stopping.stored(index, configuration)
            whole = all(each.verdicts for each in blocks) and not missing([b.block for b in blocks], decided.runs)
            configuration, certain = decided if whole else configuration, decided.runs
        steps += run_steps(configuration, certain, index.stored(configuration), reasons)
    executed: Counter[str] = Counter()
    for step in steps:
        executed[step.subject] += step.amount * (step.stage == "execute" and step.reason is not None)
    return Plan(
        name=name,
        runs=runs,
        least=None if sequential is None else sequential.min,
        past=past,
        configurations=instantiation.configurations,
        coverage=found.instantiation.coverage,
        robots=robots_json(campaign.families, campaign.nodes),
        sampled_from=instantiation.sampled_from,
        steps=steps,
        estimate=estimate_of(instantiation.configurations, executed, campaign.timeout_s, cores()),
        faults=chosen.faults,
        unexecutable=campaign.unexecutable,
        keys=keys,
    )


@dataclass
class HereEvaluator:
    """Evaluate missing producers in this process; see `vastflow.tasks.engine.instantiation.Evaluator`.

    Attributes:
        store: Opened to be read only: what is evaluated here stays in it.
        environments: Folder for the files that producers make.
        steps: Key of each evaluation to its step.
    """

    store: Store
    reasons: Reasons
    environments: Path
    steps: dict[str, Step] = field(default_factory=dict)

    def __call__(self, requests: Sequence[EvaluationRequest]) -> Mapping[str, str]:
        """Evaluate; key of each evaluation at which the producer raised to the error."""
        errors = {}
        for request in requests:
            name = type(request.producer).__name__
            for each in request.evaluations:
                if self.store.find(each.key) is not None:  # made here before, perhaps
                    self.steps.setdefault(each.key, Step("instantiate", request.family, name, 1, None))
                    continue
                reason = self.reasons.evaluation(request.family, request.producer, each)
                self.steps[each.key] = Step("instantiate", request.family, name, 1, reason)
                try:
                    with environments_in(self.environments):
                        found = evaluate(request.producer, each.inputs)
                except Exception as error:  # noqa: BLE001 - a plug-in may raise anything: a fault of the run, too
                    errors[each.key] = f"{type(error).__name__}: {' '.join(str(error).split())}"
                    continue
                self.store.put(each.key, {FRAGMENTS: write_evaluation(found)})
        return errors


if TYPE_CHECKING:
    from vastflow.oracles.figures.case_figure import Case


def plan_view_of(configuration: Configuration) -> "Case":
    """Return a configuration on its map, for a plan view.

    Raises:
        ValueError: it has no map, or a mission or an obstacle that can't be read.
    """
    from vastflow.oracles.figures.case_figure import Case
    from vastflow.oracles.query.scene import zones_of

    world = world_of(configuration.scenario.environment)
    if world is None:
        raise ValueError("it has no map")
    path, length_m = (configuration.provenance.get(key) for key in (PATH_KEY, PATH_LENGTH_KEY))
    title = configuration.name + (f" · path of {length_m:.2f} m" if isinstance(length_m, int | float) else "")
    path_xy_m = np.array(path if isinstance(path, list) else [], dtype=np.float64).reshape(-1, 2)
    situation, zones = situation_of(configuration.scenario), zones_of([configuration.scenario])
    return Case(title, world, situation, situation.obstacles, (), zones=zones, route_xy_m=path_xy_m)


def draw(configurations: Iterable[Configuration], folder: Path) -> list[Path]:
    """Write the pictures of configurations; name those that can't be drawn on standard error."""
    from vastflow.oracles.figures.case_figure import plan_view_figure
    from vastflow.oracles.figures.style import png

    written = []
    for configuration in configurations:
        try:
            view = plan_view_of(configuration)
        except ValueError as error:
            print(f"not drawn: {configuration.name}: {error}", file=sys.stderr)
            continue
        folder.mkdir(parents=True, exist_ok=True)
        picture = folder / f"{configuration.name}.png"
        picture.write_bytes(png(plan_view_figure(view)))
        written.append(picture)
    return written
