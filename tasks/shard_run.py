"""A bundle's members through all stages, on this machine alone."""

from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import ExitStack
from typing import Final

from vastflow.tasks.engine import Engine, MemberFault, block_size
from vastflow.tasks.index import Member, missing
from vastflow.tasks.pool import Pool

_THREADS: Final = 64


def missing_runs(engine: Engine, members: Sequence[Member]) -> int:
    """How many of the wanted runs are not recorded."""
    return sum(len(missing(engine.index.blocks(member), member.runs)) for member in members)


def compute(engine: Engine, pool: Pool, members: Sequence[Member], workers: int) -> tuple[MemberFault, ...]:
    """Execute, observe and judge what is missing, member by member and without a barrier between the stages.

    Args:
        pool: The engine's own; it is closed afterwards, whatever happens.

    Returns:
        What broke; each fault is one member's.

    Raises:
        StoreError: the store can't be used any more.
    """
    with ExitStack() as stack:
        threads = stack.enter_context(ThreadPoolExecutor(min(_THREADS, len(members))))
        stack.callback(pool.close)  # before the threads are waited for: they wait for it
        if absent := missing_runs(engine, members):
            engine.block_runs = block_size(absent, workers)
            if any(member.drives for member in members):
                engine.warm_up()
        for done in [threads.submit(_through, engine, member) for member in members]:
            done.result()
    return engine.faults


def _through(engine: Engine, member: Member) -> None:
    recorded = engine.execute([member])
    observed = engine.observe([member], recorded.made)
    engine.judge([member], observed.made)
