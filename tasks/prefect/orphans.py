"""Orphans: flow runs of killed processes, which Prefect would show as `Running` forever.

Tags name the host and the process of each flow run, so that the next flow run on that host finds those whose process is
gone. Importing this module imports Prefect.
"""

import os
import platform
import re
from collections.abc import Collection
from contextlib import AbstractContextManager
from typing import Any, Final

import psutil
from prefect import tags
from prefect.client.orchestration import get_client
from prefect.client.schemas.filters import (
    FlowRunFilter,
    FlowRunFilterState,
    FlowRunFilterStateType,
    FlowRunFilterTags,
)
from prefect.client.schemas.objects import StateType
from prefect.states import Crashed

from vastflow.tasks.prefect.adapter import current_tags, exact_tags

MESSAGE: Final = "Its process was killed or ran out of memory. What was finished is in the store."

_SAME_S: Final = 2.0
"""Tolerance between two readings of when a process began."""


def process_tags() -> tuple[str, str]:
    """Return the tags that name this host and this process."""
    process = psutil.Process()
    return _host_tag(), f"process:{process.pid}@{process.create_time():.0f}"


def tagged() -> AbstractContextManager[Any]:
    """Give flow runs that begin in this context the tags of this process."""
    return tags(*process_tags())


def untagged() -> AbstractContextManager[Any]:
    """Remove the tags of this process from task runs: Prefect asks its API about each tag."""
    return exact_tags(current_tags() - {*process_tags()})


def is_orphan(names: Collection[str]) -> bool:
    """True if a flow run's tags name a process of this host that is gone."""
    if _host_tag() not in names:
        return False
    found = filter(None, (re.fullmatch(r"process:(\d+)@(\d+)", name) for name in names))
    return any(_is_gone(int(process[1]), float(process[2])) for process in found)


def mark_orphans() -> None:
    """Mark orphans of this host as crashed.

    Raises:
        httpx.TransportError, PrefectHTTPStatusError: the API is away, or refused a request.
    """
    unfinished = [StateType.PENDING, StateType.RUNNING, StateType.CANCELLING]
    of_host = FlowRunFilter(
        tags=FlowRunFilterTags(all_=[_host_tag()]),
        state=FlowRunFilterState(type=FlowRunFilterStateType(any_=unfinished)),
    )
    with get_client(sync_client=True) as client:
        for flow_run in client.read_flow_runs(flow_run_filter=of_host):
            if is_orphan(flow_run.tags):
                client.set_flow_run_state(flow_run.id, Crashed(message=MESSAGE), force=True)


def _is_gone(pid: int, began_s: float) -> bool:
    try:
        process = psutil.Process(pid)
        return process.status() == psutil.STATUS_ZOMBIE or abs(process.create_time() - began_s) > _SAME_S
    except psutil.NoSuchProcess:
        return True
    except psutil.Error:
        return False


def _host_tag() -> str:
    """Return the host's name with its process namespace on Linux, as containers may share a name."""
    try:
        return f"host:{platform.node()}/{os.readlink('/proc/self/ns/pid').strip('pid:[]')}"
    except OSError:
        return f"host:{platform.node()}"
