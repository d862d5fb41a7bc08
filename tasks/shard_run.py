"""A parcel's members through all stages, on this machine alone; what broke is reported through the store."""

import json
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import ExitStack
from dataclasses import asdict
from typing import Any, Final

from vastflow.tasks.engine import Engine, MemberFault, block_size
from vastflow.tasks.index import Member, missing
from vastflow.tasks.parcel import STAGE
from vastflow.tasks.pool import Pool
from vastflow.tasks.store import Lost, Store

_THREADS: Final = 64
_REPORT: Final = "report.json"


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


def write_report(store: Store, flow_run: str, faults: Sequence[MemberFault]) -> None:
    """Keep what broke in one flow run of a shard."""
    store.put(_key(flow_run), {_REPORT: json.dumps([asdict(fault) for fault in faults]).encode()})


def read_report(store: Store, flow_run: str) -> tuple[MemberFault, ...]:
    """What broke in a flow run; nothing where the report is lost, for then what is missing will be tried again."""
    store.changed(_key(flow_run))
    try:
        rows: list[dict[str, Any]] = json.loads(store.read(_key(flow_run), _REPORT))
    except Lost:
        return ()
    return tuple(MemberFault(**row) for row in rows)


def _key(flow_run: str) -> str:
    return f"{STAGE}/reports/{flow_run}"
