"""A campaign spread over a work pool: what the flow that drives it knows beside the members."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from vastflow.flows.pool.work_pool import NO_API, WorkPool, WorkPoolError
from vastflow.oracles.oracle import Oracle
from vastflow.producers.campaign import Campaign
from vastflow.tasks import chatter
from vastflow.tasks.execution.job import PoolType
from vastflow.tasks.keys import Keys


@dataclass(frozen=True)
class Spread:
    """How a campaign's shards reach the workers of a pool.

    Attributes:
        name: The campaign's.
        keys: Of the artifacts that workers are to make.
        workers: Worker processes of each shard; None for one a core of the worker's machine.
        say: Writes a line for the user.
    """

    pool: WorkPool
    campaign: Campaign = field(repr=False)
    name: str
    oracles: Sequence[Oracle[Any]] = field(repr=False)
    keys: Keys = field(repr=False)
    workers: int | None
    say: Callable[[str], None]

    def check(self, log: Path) -> None:
        """See to it before anything is computed that there is an API whose workers could take shards.

        Raises:
            WorkPoolError: none is configured.
        """
        from vastflow.tasks.server import configured_url

        with chatter.prefect_log(log):
            if configured_url() is None:
                raise WorkPoolError(NO_API)

    def asked_of(self, kind: PoolType) -> tuple[Mapping[str, Any], int | None]:
        """What the campaign file asks of the containers that compute its shards, and the worker processes of each.

        A Job is shown all cores of its node, so it is told how many it requests.
        """
        from vastflow.flows.request.campaign_job import described, requested_cores
        from vastflow.tasks.execution.job import job_variables

        if kind is PoolType.process:
            return {}, self.workers
        description = described(self.campaign, None)
        return job_variables(kind, description), self.workers or requested_cores(kind, description)
