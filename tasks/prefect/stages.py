"""The stages as Prefect tasks: one task run for each shard and stage.

Prefect's own caching is off, as the store decides. A task run ends as `Cached` where the store had all of its shard, and as
`Cancelled` after an interrupt.
"""

from collections.abc import Callable, Sequence
from typing import Any, Final

from prefect import task
from prefect.cache_policies import NO_CACHE
from prefect.client.schemas.objects import State
from prefect.states import Cancelled, Completed

from vastflow.tasks.engine.engine import Engine, Rows, StageOutcome
from vastflow.tasks.engine.executor import PoolClosed
from vastflow.tasks.engine.shards import ProducerShard, Shard

CACHED: Final = "Cached"
"""State of a task run that had nothing to compute."""


@task(name="instantiate", task_run_name="instantiate {shard}", cache_policy=NO_CACHE, persist_result=False)
def evaluate(shard: ProducerShard, engine: Engine) -> State[Any]:
    """Evaluate a producer, and return the errors by key."""
    return _ended(shard, engine, lambda: engine.evaluate(shard.packed, shard.evaluations))


@task(name="execute", task_run_name="execute {shard}", cache_policy=NO_CACHE, persist_result=False)
def execute(shard: Shard, engine: Engine) -> State[Any]:
    """Execute a shard's missing runs, and return the recorded `Rows`."""
    return _ended(shard, engine, lambda: engine.execute(shard.configurations))


@task(name="observe", task_run_name="observe {shard}", cache_policy=NO_CACHE, persist_result=False)
def observe(shard: Shard, recorded: Sequence[Rows], engine: Engine) -> State[Any]:
    """Observe a shard's recordings, and return the observed `Rows`."""
    return _ended(shard, engine, lambda: engine.observe(shard.configurations, *recorded))


@task(name="judge", task_run_name="judge {shard}", cache_policy=NO_CACHE, persist_result=False)
def judge(shard: Shard, observed: Sequence[Rows], engine: Engine) -> State[Any]:
    """Judge a shard's traces, and return the judged `Rows`."""
    return _ended(shard, engine, lambda: engine.judge(shard.configurations, *observed))


def _ended(shard: Shard | ProducerShard, engine: Engine, stage: Callable[[], StageOutcome[Any]]) -> State[Any]:
    """Run a stage, whose last state says what it was about.

    Prefect keeps no parameters of task runs, and each tag costs requests.
    """
    try:
        outcome = stage()
    except PoolClosed as error:
        return Cancelled(message=str(error))
    there = f"{outcome.there} of {outcome.wanted} in the store before; {shard.about(engine.index.keys)}"
    if outcome.there == outcome.wanted > 0:
        return Completed(name=CACHED, message=there, data=outcome.made)
    return Completed(message=there, data=outcome.made)
