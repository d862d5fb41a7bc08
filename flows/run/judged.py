"""From a prepared campaign to judged runs, found in the store or computed round by round."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

from vastflow.flows.request.configurations import distinct_configurations, narrowed
from vastflow.flows.run.computing import Computing
from vastflow.flows.run.prepared import PreparedCampaign
from vastflow.tasks.engine.engine import Engine, RunFault
from vastflow.tasks.engine.index import FoundRuns
from vastflow.tasks.engine.instantiation import Instantiated
from vastflow.tasks.engine.shards import Shard, missing_shards
from vastflow.tasks.store.store import Lost


@dataclass(frozen=True)
class Judged:
    """The configurations of a campaign or of a search's batch, with stored runs by name."""

    instantiated: Instantiated
    found: Mapping[str, FoundRuns]

    @property
    def runs(self) -> Mapping[str, int]:
        """Number of runs by configuration."""
        return {name: each.configuration.runs for name, each in self.found.items()}

    @property
    def faults(self) -> list[RunFault]:
        """Faults that concern no single configuration."""
        return [RunFault("", None, "instantiate", str(fault)) for fault in self.instantiated.faults]

    def incomplete(self, engine: Engine) -> list[FoundRuns]:
        """Configurations with missing results that no fault explains."""
        broken = engine.broken
        return [each for name, each in self.found.items() if not each.complete and name not in broken]


Completes = Callable[[Judged | None], Judged | None]
"""Completes what is known of a batch, or gives what it can."""


def scan_store(run: PreparedCampaign, computing: Computing, instantiated: Instantiated) -> Judged:
    """Select the requested configurations, and scan the store for their results."""
    if run.search is None:
        asked = run.asked
        instantiated = narrowed(instantiated, run.opened.file, asked.only, asked.sample, run.campaign.seed)
    else:
        instantiated = run.search.named(instantiated)
    configurations = distinct_configurations(instantiated.instantiation, run.asked.runs)
    if run.stopping is not None:
        first = run.stopping.wanted({})
        configurations = [
            replace(configuration, runs=min(configuration.runs, first)) for configuration in configurations
        ]
    wanted = {configuration.name: configuration.runs for configuration in configurations}
    families = {configuration.name: configuration.family for configuration in configurations}
    computing.tally.expect(wanted if run.search is None else run.search.expected(wanted), families)
    computing.tally.begin("scanning")
    most = run.asked.runs if run.stopping is None else run.stopping.most
    run.forced.remove_results(computing.engine.index, [replace(each, runs=most) for each in configurations])
    found = computing.engine.scan(configurations)
    run.due.reuse(found)
    return Judged(instantiated, found)


def read_store(run: PreparedCampaign, computing: Computing) -> Judged | None:
    """Scan the store for the campaign or the current batch; None if an evaluation is missing."""
    stored = run.instantiator.stored()
    return None if stored is None else scan_store(run, computing, stored)


def run_batches(
    run: PreparedCampaign, computing: Computing, judged: Judged | None, completes: Completes = lambda judged: judged
) -> Judged | None:
    """Complete the campaign, a search batch by batch; stop at an incomplete batch.

    Args:
        judged: Known runs of the campaign, or of the batch under way.

    Raises:
        Lost: verdicts are damaged.
    """
    engine = computing.engine
    while True:
        judged = completes(judged)
        if judged is None or judged.incomplete(engine) or run.search is None:
            return judged
        if not run.search.take(judged.instantiated, judged.found, engine.index, engine.broken):
            return judged
        engine.forget(judged.found)
        judged = read_store(run, computing)


def begin(run: PreparedCampaign, computing: Computing, judged: Judged | None) -> None:
    """Let workers begin with missing runs, or compile kernels until the runs are known.

    Of controllers those that the families name: one that a producer chooses is compiled when a robot first drives by it.
    """
    if judged is None:
        driving = (family for family in run.campaign.families if family.drives)
        computing.engine.warm_up({**family.values, **family.overrides} for family in driving)
    else:
        computing.engine.begin(judged.incomplete(computing.engine))


def compute_missing(
    judged: Judged,
    computing: Computing,
    compute: Callable[[Sequence[FoundRuns], Sequence[Shard]], None],
) -> Judged:
    """Compute missing runs, round by round where a stopping rule asks for more.

    Args:
        compute: Brings into the store what configurations lack; they are in these shards.

    Raises:
        Lost: something is missing all the same, and no fault explains it.
    """
    engine = computing.engine
    due, cut = judged.incomplete(engine), [each.configuration for each in judged.found.values()]
    while due:
        computing.tally.begin("running")
        before = {each.configuration.name: each.configuration.runs for each in due}
        compute(due, missing_shards(cut, {each.configuration.name: each.missing_runs for each in due}))
        engine.check()
        judged = replace(judged, found={**judged.found, **engine.scan([each.configuration for each in due])})
        # Incomplete configurations are not scheduled again.
        again = [each for each in judged.incomplete(engine) if each.configuration.name in before]
        due = [each for each in again if each.configuration.runs > before[each.configuration.name]]
        cut = [each.configuration for each in due]
    if lost := judged.incomplete(engine):
        raise Lost(f"results of {lost[0].configuration.name}")
    return judged
