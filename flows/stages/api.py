"""The Python API, stage by stage: `instantiate`, `execute`, `observe` and `judge`, each a call that blocks."""

import os
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from dataclasses import replace
from functools import partial
from typing import TYPE_CHECKING, Any, TypeAlias

from vastflow.flows.flow_runs.mapped import instantiate as instantiated
from vastflow.flows.request.campaign_file import OpenCampaign, open_campaign
from vastflow.flows.request.campaign_keys import campaign_keys
from vastflow.flows.request.configurations import Selection, distinct_configurations, narrowed
from vastflow.flows.run.computing import computing, told
from vastflow.flows.stages.values import Configurations, Recordings, Traces, Verdicts
from vastflow.oracles.judgement.oracle import Oracle, OracleError, oracle_of, oracles_of
from vastflow.sim.model.faults import Fault, FileError, Place
from vastflow.tasks.engine.engine import Rows, RunFault
from vastflow.tasks.engine.index import ConfigurationRuns, FoundRuns
from vastflow.tasks.engine.instantiation import Instantiated, Instantiator
from vastflow.tasks.engine.progress import Observer
from vastflow.tasks.engine.shards import Shard, missing_shards
from vastflow.tasks.keys.keys import Keys
from vastflow.tasks.keys.source import installed_tree
from vastflow.tasks.store.artifact import Stored
from vastflow.tasks.store.store import Lost

if TYPE_CHECKING:
    from vastflow.flows.flow_runs.task_runs import TaskRuns

OracleChoice: TypeAlias = str | Mapping[str, Mapping[str, Any]]
"""An oracle as a campaign file asks for it: its name, or `{name: parameters}`."""


def instantiate(
    path: str | os.PathLike[str],
    *,
    store: str | os.PathLike[str] | None = None,
    workers: int | None = None,
    as_v1: bool = False,
) -> Configurations:
    """Make the configurations of a campaign; nothing is executed.

    As with `run_campaign`, what is in the store is not computed again, and Prefect starts only if something is missing:
    then there is a flow run of this stage with a task run for each shard.

    Args:
        path: The campaign file.
        store: As `run_campaign` has it; the stages after this one use the same.
        workers: Worker processes, else one a core.
        as_v1: As `run_campaign` has it.

    Raises:
        FileError: faults of the file.
        StoreError: the store can't be used.
        PrefectUnavailable: Prefect's API can't be started.
    """
    opened = open_campaign(path, store, as_v1=as_v1)
    tree = installed_tree()
    keys = campaign_keys(tree, opened.campaign.seed, opened.oracles)
    instantiator = Instantiator(opened.campaign, opened.store, keys, tree)
    with told(None) as tally, computing(opened, keys, (), tally, stage="instantiate", workers=workers) as run:
        made: list[Instantiated] = []
        for _ in run.engine.attempts():
            if (stored := instantiator.stored()) is not None:
                made.append(stored)
            else:
                with suppress(Lost):
                    run.run_alone(lambda task_runs: made.append(instantiated(task_runs, instantiator)))
            if made:
                break
    faults = (RunFault("", None, "instantiate", str(fault)) for fault in made[-1].faults)
    return Configurations(opened, made[-1].instantiation, tuple(faults))


def execute(
    configurations: Configurations,
    *,
    runs: int | None = None,
    only: str | Sequence[str] | None = None,
    workers: int | None = None,
    observer: Observer | None = None,
) -> Recordings:
    """Execute runs of configurations; those whose recordings are in the store are not executed again.

    A run that can't be executed is in `faults` of the result, and raises nothing.

    Args:
        runs: Of each configuration, instead of the file's. Where these end by a rule it is their most, for nothing is judged here.
        only: Names of families or configurations; nothing else is executed.
        workers: Worker processes, else one a core.
        observer: Is shown the progress, from one thread.

    Raises:
        FileError: a name in `only` that nothing has.
        StoreError: the store can't be used.
        PrefectUnavailable: Prefect's API can't be started.
    """
    if runs is not None and runs < 1:
        raise ValueError(f"runs is at least 1, got {runs}")
    opened = configurations.opened
    selection = Selection((only,) if isinstance(only, str) else tuple(only or ()))
    narrow = narrowed(Instantiated(configurations.instantiation), selection, opened.file)
    chosen = replace(configurations, instantiation=narrow.instantiation)
    wanted = opened.campaign.runs_asked(runs)
    executed = distinct_configurations(chosen.instantiation, wanted)
    keys = campaign_keys(installed_tree(), opened.campaign.seed, opened.oracles)

    def recorded(found: FoundRuns) -> bool:
        return not found.missing_runs

    blocks, faults = _computed("execute", opened, keys, opened.oracles, executed, recorded, workers, observer)
    return Recordings(chosen, wanted, keys, blocks, (*configurations.faults, *faults))


def observe(recordings: Recordings, *, workers: int | None = None, observer: Observer | None = None) -> Traces:
    """Observe recordings; those whose traces are in the store are not observed again.

    Args:
        workers, observer: As `execute` has them.

    Raises:
        Lost: a recording is no longer in the store or damaged; `execute` computes it again.
        StoreError: the store can't be used.
        PrefectUnavailable: Prefect's API can't be started.
    """
    opened = recordings.configurations.opened
    executed = distinct_configurations(recordings.configurations.instantiation, recordings.runs)
    fresh = campaign_keys(installed_tree(), opened.campaign.seed, opened.oracles)
    keys = replace(recordings.keys, observe_source=fresh.observe_source, sources=fresh.sources)

    def observed(found: FoundRuns) -> bool:
        _check(opened, found, [each.block.key for each in recordings.blocks[found.configuration.name]], "execute")
        return all(each.trace for each in found.stored)

    blocks, faults = _computed("observe", opened, keys, opened.oracles, executed, observed, workers, observer)
    return Traces(recordings.configurations, recordings.runs, keys, blocks, (*recordings.faults, *faults))


def judge(
    traces: Traces,
    *,
    oracles: Sequence[OracleChoice] | None = None,
    workers: int | None = None,
    observer: Observer | None = None,
) -> Verdicts:
    """Judge traces; those whose verdicts are in the store are not judged again.

    Args:
        oracles: Other oracles than the campaign file's, or others' parameters: names, `file.py:Class` relative to the campaign
            file, or `{name: parameters}`. `success` is always judged, first.
        workers, observer: As `execute` has them.

    Raises:
        FileError: there is no such oracle, or its parameters are wrong.
        Lost: a recording or trace is no longer in the store or damaged; `execute` and `observe` compute it again.
        StoreError: the store can't be used.
        PrefectUnavailable: Prefect's API can't be started.
    """
    opened = traces.configurations.opened
    asked = opened.oracles if oracles is None else _asked(opened, oracles)
    executed = distinct_configurations(traces.configurations.instantiation, traces.runs)
    fresh = campaign_keys(installed_tree(), opened.campaign.seed, asked)
    keys = replace(traces.keys, judge_source=fresh.judge_source, oracles=fresh.oracles, sources=fresh.sources)

    def judged(found: FoundRuns) -> bool:
        known = traces.blocks[found.configuration.name]
        keys = [key for each in known if each.trace for key in (each.block.key, each.trace.key)]
        _check(opened, found, keys, "execute and observe")
        return all(each.verdicts for each in found.stored if each.trace)

    blocks, faults = _computed("judge", opened, keys, asked, executed, judged, workers, observer)
    names = tuple(oracle.name for oracle in asked)
    return Verdicts(traces.configurations, traces.runs, keys, blocks, (*traces.faults, *faults), names)


def _computed(
    stage: str,
    opened: OpenCampaign,
    keys: Keys,
    oracles: Sequence[Oracle[Any]],
    configurations: Sequence[ConfigurationRuns],
    complete: Callable[[FoundRuns], bool],
    workers: int | None,
    observer: Observer | None,
) -> tuple[dict[str, tuple[Stored, ...]], tuple[RunFault, ...]]:
    """Compute missing results of a stage; return stored blocks by configuration, and faults.

    Args:
        complete: Whether the store has everything of a configuration.

    Raises:
        StoreError: the store can't be used.
        PrefectUnavailable: Prefect's API can't be had.
    """
    with told(observer) as tally, computing(opened, keys, oracles, tally, stage=stage, workers=workers) as run:
        tally.expect({each.name: each.runs for each in configurations})

        def scanned() -> tuple[dict[str, FoundRuns], list[FoundRuns]]:
            tally.begin("scanning")
            found, broken = run.engine.scan(configurations), run.engine.broken
            return found, [each for name, each in found.items() if not complete(each) and name not in broken]

        def mapped(shards: Sequence[Shard], found: Mapping[str, FoundRuns], task_runs: "TaskRuns") -> None:
            rows = [] if stage == "execute" else [_rows(shards, found, observed=stage == "judge")]
            task_runs.wait(shards, task_runs.map(stage, shards, *rows))

        for _ in run.engine.attempts():
            found, missing = scanned()
            if missing:
                if stage == "execute":
                    run.engine.begin(missing, run.workers)
                shards = missing_shards(configurations, {each.configuration.name for each in missing})
                with suppress(Lost):
                    run.run_alone(partial(mapped, shards, found))
                found, missing = scanned()
            if not missing:
                break
        return {name: each.stored for name, each in found.items()}, run.engine.faults


def _check(opened: OpenCampaign, found: FoundRuns, keys: Sequence[str], stages: str) -> None:
    """Raise `Lost` where one of `keys` is not in the store."""
    there = {artifact.key for each in found.stored for artifact in (each.recordings, each.trace) if artifact}
    if not there.issuperset(keys):
        what = "recordings" if stages == "execute" else "recordings or traces"
        name, place = found.configuration.name, opened.store.place
        raise Lost(f"{what} of {name} are not in the store {place!r} any more; {stages} again")


def _rows(shards: Sequence[Shard], found: Mapping[str, FoundRuns], *, observed: bool = False) -> list[Rows]:
    """Start, stop, and content digests of each shard's blocks, as `Engine.observe` takes them, or `Engine.judge` those observed."""
    return [
        [
            [
                [each.block.start, each.block.stop, each.block.content, *([each.trace.content] if each.trace else [])]
                for each in found[configuration.name].stored
                if each.trace or not observed
            ]
            for configuration in shard.configurations
        ]
        for shard in shards
    ]


def _asked(opened: OpenCampaign, oracles: Sequence[OracleChoice]) -> tuple[Oracle[Any], ...]:
    """Return the requested oracles, `success` first."""
    base, faults, requests = opened.path.parent, [], []
    for place, choice in enumerate([oracles] if isinstance(oracles, str | Mapping) else oracles):
        for name, parameters in ({choice: {}} if isinstance(choice, str) else choice).items():
            requests.append((name, parameters))
            try:
                oracle_of(name, parameters, base)
            except OracleError as error:
                for fault in error.faults:
                    where = ".".join(map(str, (f"oracles[{place}]", *fault.location)))
                    faults.append(Fault(Place(opened.file, 1, 1, where), fault.what, fault.right))
    if faults:
        raise FileError(faults)
    return oracles_of(requests, base)
