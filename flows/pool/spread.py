"""A campaign spread over a work pool: what is seen to before anything is computed there, and what its containers are asked."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from vastflow.flows.request.work_pool import NO_API, WorkPoolError
from vastflow.producers.campaign import Campaign
from vastflow.tasks import campaign_log
from vastflow.tasks.execution.job import PoolType


def check_api(log: Path) -> None:
    """See to it before anything is computed that there is an API whose workers could take shards.

    Raises:
        WorkPoolError: none is configured.
    """
    from vastflow.tasks.server import configured_url

    with campaign_log.prefect_log(log):
        if configured_url() is None:
            raise WorkPoolError(NO_API)


def asked_of(campaign: Campaign, kind: PoolType, workers: int | None) -> tuple[Mapping[str, Any], int | None]:
    """What the campaign file asks of the containers that compute its shards, and the worker processes of each.

    A Job is shown all cores of its node, so it is told how many it requests.

    Args:
        workers: Those that were asked for; None for one a core.
    """
    from vastflow.flows.request.campaign_job import described, requested_cores
    from vastflow.tasks.execution.job import job_variables

    if kind is PoolType.process:
        return {}, workers
    description = described(campaign, None)
    return job_variables(kind, description), workers or requested_cores(kind, description)
