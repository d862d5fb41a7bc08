"""Deployments and their work pools at Prefect's API: made, or changed to what they should be."""

from collections.abc import Mapping
from typing import Any

from prefect import Flow
from prefect.client.orchestration import SyncPrefectClient
from prefect.client.schemas.actions import DeploymentScheduleCreate, WorkPoolCreate, WorkPoolUpdate
from prefect.client.schemas.objects import ConcurrencyLimitStrategy, ConcurrencyOptions
from prefect.client.schemas.schedules import CronSchedule
from prefect.exceptions import ObjectNotFound

from vastflow.tasks.execution.job import PoolType, base_job_template
from vastflow.tasks.prefect_adapter import flow_schema, process_pool_template


class OtherPool(ValueError):
    """There is a work pool of that name, but of another type."""


def pool_template(kind: PoolType) -> dict[str, Any]:
    """The base job template of a pool."""
    if kind is PoolType.process:
        return process_pool_template()
    return base_job_template(kind)


def register_pool(client: SyncPrefectClient, name: str, kind: PoolType) -> bool:
    """Make the pool, or give it our template; a process pool that exists is left as it is.

    Returns:
        Whether it is new.

    Raises:
        OtherPool: the pool is of another type.
    """
    try:
        pool = client.read_work_pool(name)
    except ObjectNotFound:
        client.create_work_pool(WorkPoolCreate(name=name, type=kind.value, base_job_template=pool_template(kind)))
        return True
    if pool.type != kind.value:
        raise OtherPool(f"the work pool {name!r} is of type {pool.type!r}; name another, or give --type {pool.type}")
    if kind is not PoolType.process:
        client.update_work_pool(name, WorkPoolUpdate(base_job_template=pool_template(kind)))
    return False


def type_of_pool(client: SyncPrefectClient, name: str) -> PoolType | None:
    """The type of a pool; None where there is none of that name.

    Raises:
        OtherPool: vastflow has no use for its type.
    """
    try:
        found = client.read_work_pool(name).type
    except ObjectNotFound:
        return None
    if found not in list(PoolType):
        raise OtherPool(f"the work pool {name!r} is of type {found!r}; one of {', '.join(PoolType)}")
    return PoolType(found)


def register_flow(client: SyncPrefectClient, entry: Mapping[str, Any], flow: Flow[..., Any]) -> str:
    """Make a deployment of a flow, or change the one of its name; gives its id.

    Args:
        entry: As `prefect.yaml` has it.
    """
    limit = entry.get("concurrency_limit")
    options = limit and ConcurrencyOptions(collision_strategy=ConcurrencyLimitStrategy(limit["collision_strategy"]))
    return str(
        client.create_deployment(
            flow_id=client.create_flow_from_name(flow.name),
            name=entry["name"],
            description=entry["description"],
            tags=entry["tags"],
            entrypoint=entry["entrypoint"],
            parameters=entry["parameters"],
            parameter_openapi_schema=flow_schema(flow),
            enforce_parameter_schema=entry["enforce_parameter_schema"],
            concurrency_limit=limit and limit["limit"],
            concurrency_options=options,
            schedules=[schedule(each["cron"], each["timezone"]) for each in entry["schedules"]],
            pull_steps=entry["pull"],
            work_pool_name=entry["work_pool"]["name"],
            job_variables=entry["work_pool"]["job_variables"],
        )
    )


def schedule(cron: str, timezone: str) -> DeploymentScheduleCreate:
    """A schedule of Prefect's."""
    return DeploymentScheduleCreate(schedule=CronSchedule(cron=cron, timezone=timezone))


def is_cron(text: str) -> bool:
    """Whether `text` is five fields of cron that Prefect can read."""
    try:
        CronSchedule(cron=text)
    except ValueError:
        return False
    return len(text.split()) == 5
