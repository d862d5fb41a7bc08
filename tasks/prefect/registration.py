"""Work pools and deployments at Prefect's API. Importing this module imports Prefect."""

from collections.abc import Mapping
from typing import Any

from prefect import Flow
from prefect.client.orchestration import SyncPrefectClient
from prefect.client.schemas.actions import DeploymentScheduleCreate, WorkPoolCreate, WorkPoolUpdate
from prefect.client.schemas.objects import ConcurrencyOptions
from prefect.client.schemas.schedules import CronSchedule
from prefect.exceptions import ObjectNotFound

from vastflow.sim.model.faults import UserError
from vastflow.tasks.prefect.adapter import flow_schema, process_pool_template
from vastflow.tasks.prefect.deployment import PoolType
from vastflow.tasks.prefect.manifests import template


def pool_template(kind: PoolType) -> dict[str, Any]:
    """Return the base job template of a pool: variables, which a deployment may set, and the job they go into."""
    return process_pool_template() if kind is PoolType.process else dict(template(f"pools/{kind.value}.json"))


def register_pool(client: SyncPrefectClient, name: str, kind: PoolType) -> bool:
    """Create the pool, or update its template; an existing process pool is not changed.

    Returns:
        True if it is new.

    Raises:
        UserError: the pool is of another type.
    """
    try:
        pool = client.read_work_pool(name)
    except ObjectNotFound:
        client.create_work_pool(WorkPoolCreate(name=name, type=kind.value, base_job_template=pool_template(kind)))
        return True
    if pool.type != kind.value:
        raise UserError(
            f"--pool: Expected a work pool of type {kind.value!r}, got {name!r} of type {pool.type!r}. Give --type {pool.type}."
        )
    if kind is not PoolType.process:
        client.update_work_pool(name, WorkPoolUpdate(base_job_template=pool_template(kind)))
    return False


def register_flow(client: SyncPrefectClient, entry: Mapping[str, Any], flow: Flow[..., Any]) -> str:
    """Create or update a deployment of a flow, and return its id.

    Args:
        entry: The deployment in the form of `prefect.yaml`.
    """
    alike = ("name", "version", "description", "tags", "entrypoint", "parameters", "enforce_parameter_schema")
    limit, pool = entry["concurrency_limit"], entry["work_pool"]
    return str(
        client.create_deployment(
            flow_id=client.create_flow_from_name(flow.name),
            **{name: entry[name] for name in alike},
            parameter_openapi_schema=flow_schema(flow),
            concurrency_limit=limit["limit"],
            concurrency_options=ConcurrencyOptions(collision_strategy=limit["collision_strategy"]),
            schedules=[DeploymentScheduleCreate(schedule=CronSchedule(**each)) for each in entry["schedules"]],
            pull_steps=entry["pull"],
            work_pool_name=pool["name"],
            job_variables=pool["job_variables"],
        )
    )


def is_cron(text: str) -> bool:
    """True if `text` is five fields of cron that Prefect can read."""
    try:
        CronSchedule(cron=text)
    except ValueError:
        return False
    return len(text.split()) == 5
