"""What a campaign file asks of the job that computes it, or a shard of it."""

from collections.abc import Mapping
from dataclasses import replace
from typing import TYPE_CHECKING, Any

from vastflow.flows.request.campaign_file import campaign_name
from vastflow.producers.campaign import Campaign
from vastflow.tasks.execution.job import CPU, IMAGE, PoolType, job_variables
from vastflow.tasks.execution.reading import describe

if TYPE_CHECKING:
    from vastflow.tasks.execution.description import RunDescription


def described(campaign: Campaign, context: str | None) -> "RunDescription":
    """The run description of a campaign. Its image is that of the containers beside the campaign's own, if there are any.

    Args:
        context: Cluster whose resources count; the first that the file names if None.

    Raises:
        CampaignError: what the file asks can't be described.
    """
    execution = campaign.spec.execution
    if execution.image is None and not execution.secondary_containers:
        execution = execution.model_copy(update={"image": IMAGE})
    spec = campaign.spec.model_copy(update={"execution": execution})
    return describe(replace(campaign, spec=spec), campaign_name(campaign), context)


def requested_cores(kind: PoolType, description: "RunDescription") -> int | None:
    """As many as a Job requests, which is shown all cores of its node that others use too; None for another kind of pool."""
    return description.main.needs.cpu or CPU if kind is PoolType.kubernetes else None


def asked_of_containers(
    kind: PoolType, campaign: Campaign, workers: int | None
) -> tuple[Mapping[str, Any], int | None]:
    """What a campaign asks of the containers that compute its shards, as job variables, and the worker processes of each.

    Args:
        workers: Worker processes of a shard, if the caller says so; else as many as a Job requests.
    """
    if kind is PoolType.process:
        return {}, workers
    description = described(campaign, None)
    return job_variables(kind, description), workers or requested_cores(kind, description)
