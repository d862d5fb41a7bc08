"""The Python API, stage by stage: `instantiate`, `execute`, `observe` and `judge`, each a call that blocks."""

import os
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import replace
from functools import partial
from typing import TYPE_CHECKING, Any, Final, TypeAlias

from vastflow.flows.request.campaign_file import OpenCampaign, campaign_keys, open_campaign
from vastflow.flows.request.configurations import distinct_configurations, narrowed
from vastflow.flows.request.stopping import Stopping, stopping_of
from vastflow.flows.run.computing import open_computing, show_progress
from vastflow.flows.run.judged import Judged, compute_missing
from vastflow.flows.run.stage_values import Configurations, Recordings, StageResult, Traces, Verdicts
from vastflow.flows.run.task_runs import compute_round
from vastflow.flows.run.task_runs import instantiate as instantiated
from vastflow.oracles.judgment.oracle import Oracle
from vastflow.oracles.judgment.registry import OracleError, oracle_of, oracles_of
from vastflow.sim.model.faults import Fault, FileError, Place
from vastflow.tasks.engine.engine import RunFault
from vastflow.tasks.engine.index import FoundRuns
from vastflow.tasks.engine.instantiation import Instantiated, Instantiator
from vastflow.tasks.engine.progress import Observer
from vastflow.tasks.engine.shards import Shard, missing_shards
from vastflow.tasks.keys.keys import Keys
from vastflow.tasks.keys.source import installed_tree
from vastflow.tasks.store.artifact import Stored
from vastflow.tasks.store.store import Lost

if TYPE_CHECKING:
    from vastflow.flows.run.task_runs import TaskRuns

OracleChoice: TypeAlias = str | Mapping[str, Mapping[str, Any]]
"""An oracle as a campaign file asks for it: its name, or `{name: parameters}`."""


def instantiate(
    path: str | os.PathLike[str],
    *,
    store: str | os.PathLike[str] | None = None,
    workers: int | None = None,
) -> Configurations:
    """Make the configurations of a campaign; nothing is executed.

    As with `run_campaign`, what is in the store is not computed again, and Prefect starts only if something is missing:
    then there is a flow run of this stage with a task run for each shard.

    Args:
        path: The campaign file.
        store: The store, as for `run_campaign`; the stages after this one use the same.
        workers: Worker processes, else one a core.

    Raises:
        FileError: faults of the file.
        StoreError: the store can't be used.
        PrefectUnavailable: Prefect's API can't be started.
    """
    opened = open_campaign(path, store)
    tree = installed_tree()
    keys = campaign_keys(tree, opened.campaign.seed, opened.oracles)
    instantiator = Instantiator(opened.campaign, opened.store, keys, tree)
    with (
        show_progress(None) as tally,
        open_computing(opened, keys, (), tally, stage="instantiate", workers=workers) as run,
    ):
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
    """Execute runs of configurations that have no recordings in the store.

    A run that can't be executed is in `faults` of the result, and raises nothing. Where the file's runs end by a rule, as many are executed as
    in a campaign: the rule asks for verdicts, so the runs are observed and judged as well, by the file's oracles.

    Args:
        runs: Number of runs of each configuration, instead of the file's; no rule ends them.
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
    names = (only,) if isinstance(only, str) else tuple(only or ())
    narrow = narrowed(Instantiated(configurations.instantiation), opened.file, names)
    chosen = replace(configurations, instantiation=narrow.instantiation)
    keys = campaign_keys(installed_tree(), opened.campaign.seed, opened.oracles)
    before = StageResult(chosen, opened.campaign.runs_asked(runs), keys, {}, configurations.faults)
    if runs is None and opened.campaign.sequential is not None:
        return _by_rule(before, stopping_of(opened.campaign.sequential), workers, observer)
    return Recordings(*_compute_stage("execute", before, opened.oracles, workers, observer))


def _by_rule(before: StageResult, stopping: Stopping, workers: int | None, observer: Observer | None) -> Recordings:
    """Execute, observe, and judge in rounds until the stopping rule is satisfied."""
    configurations, opened = before.configurations, before.configurations.opened
    first = distinct_configurations(configurations.instantiation, stopping.wanted({}))
    options: Any = {"stage": "execute", "workers": workers, "stopping": stopping}
    with show_progress(observer) as tally, open_computing(opened, before.keys, opened.oracles, tally, **options) as run:
        tally.expect({each.name: stopping.most for each in first})

        def scanned() -> Judged:
            tally.begin("scanning")
            return Judged(Instantiated(configurations.instantiation), run.engine.scan(first))

        def rounds(judged: Judged, task_runs: "TaskRuns") -> None:
            compute_missing(judged, run, partial(compute_round, task_runs))

        for _ in run.engine.attempts():
            judged = scanned()
            if missing := judged.incomplete(run.engine):
                run.engine.begin(missing)
                with suppress(Lost):
                    run.run_alone(partial(rounds, judged))
                judged = scanned()
            if not judged.incomplete(run.engine):
                break
        blocks = {name: each.stored for name, each in judged.found.items()}
        faults = (*before.faults, *run.engine.faults)
        return Recordings(configurations, stopping.most, before.keys, blocks, faults, judged.runs)


def observe(recordings: Recordings, *, workers: int | None = None, observer: Observer | None = None) -> Traces:
    """Observe recordings that have no traces in the store.

    Args:
        workers, observer: See `execute`.

    Raises:
        Lost: a recording is no longer in the store or damaged; `execute` computes it again.
        StoreError: the store can't be used.
        PrefectUnavailable: Prefect's API can't be started.
    """
    return Traces(*_compute_stage("observe", recordings, recordings.configurations.opened.oracles, workers, observer))


def judge(
    traces: Traces,
    *,
    oracles: Sequence[OracleChoice] | None = None,
    workers: int | None = None,
    observer: Observer | None = None,
) -> Verdicts:
    """Judge traces that have no verdicts in the store.

    Args:
        oracles: Other oracles than the campaign file's, or others' parameters: names, `file.py:Class` relative to the campaign
            file, or `{name: parameters}`. `success` is always judged, first.
        workers, observer: See `execute`.

    Raises:
        FileError: there is no such oracle, or its parameters are wrong.
        Lost: a recording or trace is no longer in the store or damaged; `execute` and `observe` compute it again.
        StoreError: the store can't be used.
        PrefectUnavailable: Prefect's API can't be started.
    """
    opened = traces.configurations.opened
    asked = opened.oracles if oracles is None else _read_oracles(opened, oracles)
    return Verdicts(*_compute_stage("judge", traces, asked, workers, observer), tuple(oracle.name for oracle in asked))


def _compute_stage(
    stage: str, before: StageResult, oracles: Sequence[Oracle[Any]], workers: int | None, observer: Observer | None
) -> tuple[Configurations, int, Keys, dict[str, tuple[Stored, ...]], tuple[RunFault, ...], Mapping[str, int]]:
    """Compute missing results of the stage after `before`; return the fields of its result."""
    configurations, opened = before.configurations, before.configurations.opened
    executed = [
        replace(each, runs=before.runs_of(each.name))
        for each in distinct_configurations(configurations.instantiation, before.runs)
    ]
    fresh = campaign_keys(installed_tree(), opened.campaign.seed, oracles)
    keys = replace(before.keys, **{name: getattr(fresh, name) for name in _KEYS[stage]})

    def complete(found: FoundRuns) -> bool:
        """Whether the store has everything of a configuration."""
        if stage == "execute":
            return not found.missing_runs
        name, traced = found.configuration.name, stage == "judge"
        known = [each for each in before.blocks[name] if each.trace or not traced]
        if not _keys(found.stored, traced=True).issuperset(_keys(known, traced)):
            what, stages = ("recordings or traces", "execute and observe") if traced else ("recordings", "execute")
            raise Lost(f"{what} of {name} are not in the store {opened.store.place!r} any more. Call {stages} again")
        return all(each.verdicts if traced else each.trace for each in found.stored if each.trace or not traced)

    with (
        show_progress(observer) as tally,
        open_computing(opened, keys, oracles, tally, stage=stage, workers=workers) as run,
    ):
        tally.expect({each.name: each.runs for each in executed})

        def scanned() -> tuple[dict[str, FoundRuns], list[FoundRuns]]:
            tally.begin("scanning")
            found, broken = run.engine.scan(executed), run.engine.broken
            return found, [each for name, each in found.items() if not complete(each) and name not in broken]

        def mapped(shards: Sequence[Shard], found: Mapping[str, FoundRuns], task_runs: "TaskRuns") -> None:
            rows = [[_rows(found[each.name], stage) for each in shard.configurations] for shard in shards]
            task_runs.wait(shards, task_runs.map(stage, shards, *([] if stage == "execute" else [rows])))

        for _ in run.engine.attempts():
            found, missing = scanned()
            if missing:
                if stage == "execute":
                    run.engine.begin(missing)
                shards = missing_shards(executed, {each.configuration.name: each.missing_runs for each in missing})
                with suppress(Lost):
                    run.run_alone(partial(mapped, shards, found))
                found, missing = scanned()
            if not missing:
                break
        blocks = {name: each.stored for name, each in found.items()}
        return configurations, before.runs, keys, blocks, (*before.faults, *run.engine.faults), before.ended


_KEYS: Final[Mapping[str, Sequence[str]]] = {
    "execute": ("sources",),
    "observe": ("observe_source", "sources"),
    "judge": ("judge_source", "oracles", "sources"),
}
"""Stage to the fields of keys that it takes from the code of today, those of earlier stages being as they were."""


def _keys(blocks: Sequence[Stored], traced: bool) -> set[str]:
    return {each.recordings.key for each in blocks} | {each.trace.key for each in blocks if each.trace and traced}


def _rows(found: FoundRuns, stage: str) -> list[list[Any]]:
    """Start, stop, and content digests of blocks, for `Engine.observe` or, if observed, `Engine.judge`."""
    return [
        [each.block.start, each.block.stop, each.block.content, *([each.trace.content] if each.trace else [])]
        for each in found.stored
        if each.trace or stage == "observe"
    ]


def _read_oracles(opened: OpenCampaign, oracles: Sequence[OracleChoice]) -> tuple[Oracle[Any], ...]:
    base, faults, requests = opened.path.parent, [], []
    for place, choice in enumerate([oracles] if isinstance(oracles, str | Mapping) else oracles):
        for name, parameters in ({choice: {}} if isinstance(choice, str) else choice).items():
            requests.append((name, parameters))
            try:
                oracle_of(name, parameters, base)
            except OracleError as error:
                for fault in error.faults:
                    where = ".".join(map(str, (f"oracles[{place}]", *fault.location)))
                    faults.append(Fault(Place(opened.file, 1, 1, where), fault.problem, fault.expected))
    if faults:
        raise FileError(faults)
    return oracles_of(requests, base)
