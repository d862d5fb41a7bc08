"""The Python API, stage by stage: `instantiate`, `execute`, `observe` and `judge`, each a call that blocks."""

import os
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import replace
from typing import TYPE_CHECKING, Any, TypeAlias

from vastflow.flows.flow_runs import mapped
from vastflow.flows.flow_runs.flow_call import FlowCall
from vastflow.flows.request.campaign_file import OpenCampaign, open_campaign
from vastflow.flows.request.campaign_keys import campaign_keys
from vastflow.flows.request.configurations import Selection, distinct_configurations, narrowed
from vastflow.flows.stages.call import stage_run
from vastflow.flows.stages.configurations import Configurations
from vastflow.flows.stages.recordings import Recordings
from vastflow.flows.stages.traces import ObservedBlock, Traces
from vastflow.flows.stages.verdicts import Verdicts
from vastflow.oracles.judgement.oracle import Oracle, OracleError, oracle_of, oracles_of
from vastflow.sim.model.faults import Fault, FileError, Place
from vastflow.tasks.engine.engine import RunFault, judgements
from vastflow.tasks.engine.index import ConfigurationRuns, FoundRuns, Index, missing
from vastflow.tasks.engine.instantiation import Instantiated, Instantiator
from vastflow.tasks.engine.progress import Observer, Tally
from vastflow.tasks.engine.shards import Shard
from vastflow.tasks.keys.source import installed_tree
from vastflow.tasks.store.artifact import Block
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
    with stage_run(opened, "instantiate", keys, opened.oracles, workers) as run:
        made: list[Instantiated] = []

        def body(task_runs: "TaskRuns") -> None:
            made.append(mapped.instantiate(task_runs, instantiator))

        for _ in run.engine.attempts():
            if (stored := instantiator.stored()) is not None:
                made.append(stored)
            else:
                with suppress(Lost):
                    run.flow(FlowCall(run.engine, run.tally, run.log), body)
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
    with stage_run(opened, "execute", keys, opened.oracles, workers, observer) as run:
        index = run.engine.index
        run.tally.expect({configuration.name: configuration.runs for configuration in executed})

        def whole(configuration: ConfigurationRuns) -> bool:
            blocks = index.blocks(configuration)
            _reuse(run.tally, configuration, blocks)
            return not missing(blocks, configuration.runs)

        faults = run.completed(
            executed,
            whole,
            lambda shards, task_runs: task_runs.wait(shards, mapped.execute(task_runs, shards)),
            lambda absent: run.engine.begin(
                (FoundRuns(each, tuple(index.stored(each))) for each in absent), run.workers
            ),
        )
        blocks = {configuration.name: tuple(index.blocks(configuration)) for configuration in executed}
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
    configurations = distinct_configurations(recordings.configurations.instantiation, recordings.runs)
    fresh = campaign_keys(installed_tree(), opened.campaign.seed, opened.oracles)
    keys = replace(recordings.keys, observe_source=fresh.observe_source, sources=fresh.sources)
    with stage_run(opened, "observe", keys, opened.oracles, workers, observer) as run:
        index = run.engine.index
        run.tally.expect({configuration.name: configuration.runs for configuration in configurations})

        def whole(configuration: ConfigurationRuns) -> bool:
            _reuse(run.tally, configuration, recordings.blocks[configuration.name])
            absent = [
                block
                for block in recordings.blocks[configuration.name]
                if not index.store.find(index.trace_key(configuration, block))
            ]
            _check(opened, [block.key for block in absent], f"recordings of {configuration.name}", "execute")
            return not absent

        def observed(shards: Sequence[Shard], task_runs: "TaskRuns") -> None:
            rows = [
                [
                    [[block.start, block.stop, block.content] for block in recordings.blocks[m.name]]
                    for m in shard.configurations
                ]
                for shard in shards
            ]
            task_runs.wait(shards, mapped.observe(task_runs, shards, rows))

        faults = run.completed(configurations, whole, observed)
        blocks = {configuration.name: _observed(index, configuration, recordings) for configuration in configurations}
    return Traces(recordings, keys, blocks, (*recordings.faults, *faults))


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
    configurations = distinct_configurations(traces.configurations.instantiation, traces.recordings.runs)
    fresh = campaign_keys(installed_tree(), opened.campaign.seed, asked)
    keys = replace(traces.keys, judge_source=fresh.judge_source, oracles=fresh.oracles, sources=fresh.sources)
    with stage_run(opened, "judge", keys, asked, workers, observer) as run:
        index = run.engine.index
        run.tally.expect({configuration.name: configuration.runs for configuration in configurations})

        def whole(configuration: ConfigurationRuns) -> bool:
            _reuse(run.tally, configuration, [each.block for each in traces.blocks[configuration.name]])
            absent = []
            for each in traces.blocks[configuration.name]:
                found = index.store.find(index.verdicts_key(configuration, each.block, each.content))
                if found is None:
                    absent += [each.block.key, each.key]
                else:
                    run.tally.judge(configuration.name, judgements(found))
            _check(opened, absent, f"recordings or traces of {configuration.name}", "execute and observe")
            return not absent

        def judged(shards: Sequence[Shard], task_runs: "TaskRuns") -> None:
            rows = [
                [_rows(traces.blocks[configuration.name]) for configuration in shard.configurations] for shard in shards
            ]
            task_runs.wait(shards, mapped.judge(task_runs, shards, rows))

        faults = run.completed(configurations, whole, judged)
        blocks = {configuration.name: _judged(index, configuration, traces) for configuration in configurations}
    return Verdicts(traces, tuple(oracle.name for oracle in asked), keys, blocks, (*traces.faults, *faults))


def _reuse(tally: Tally, configuration: ConfigurationRuns, blocks: Sequence[Block]) -> None:
    for block in blocks:
        tally.reuse(configuration.name, range(block.start, block.stop))


def _check(opened: OpenCampaign, keys: Sequence[str], what: str, stages: str) -> None:
    """Raise `Lost` where one of `keys` is not in the store."""
    if any(opened.store.find(key) is None for key in keys):
        raise Lost(f"{what} are not in the store {opened.store.place!r} any more; {stages} again")


def _rows(blocks: Sequence[ObservedBlock]) -> list[list[Any]]:
    return [[each.block.start, each.block.stop, each.block.content, each.content] for each in blocks]


def _observed(index: Index, configuration: ConfigurationRuns, recordings: Recordings) -> tuple[ObservedBlock, ...]:
    found = [
        (block, index.store.find(index.trace_key(configuration, block)))
        for block in recordings.blocks[configuration.name]
    ]
    return tuple(ObservedBlock(block, trace.key, trace.content) for block, trace in found if trace is not None)


def _judged(index: Index, configuration: ConfigurationRuns, traces: Traces) -> tuple[str, ...]:
    keys = [index.verdicts_key(configuration, each.block, each.content) for each in traces.blocks[configuration.name]]
    return tuple(key for key in keys if index.store.find(key) is not None)


def _asked(opened: OpenCampaign, oracles: Sequence[OracleChoice]) -> tuple[Oracle[Any], ...]:
    """The oracles that are asked for, `success` first."""
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
