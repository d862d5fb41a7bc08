"""Deployments of Prefect: entries of `prefect.yaml`, and a campaign's values for the templates of work pools.

A flow run that a worker starts runs the whole campaign in one container of vastflow's own image.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field
from enum import StrEnum
from typing import TYPE_CHECKING, Any, Final

from vastflow.sim.model.names import label_of

if TYPE_CHECKING:
    from vastflow.tasks.prefect.containers import Containers

FLOW: Final = "campaign"
ENTRYPOINT: Final = "vastflow.flows.campaign.campaign"
"""A module's function, found wherever vastflow is installed."""
TAG: Final = "vastflow"
SHORT_DIGEST: Final = 12
"""Characters of a version."""

STEP: Final = "prefect.deployments.steps.set_working_directory"


@dataclass(frozen=True, slots=True)
class Deployment:
    """A campaign that Prefect runs on request or by a schedule.

    Attributes:
        request: Fields of `RunRequest`; others have their defaults.
        pool: Name of the work pool.
        version: Shown for the deployment and its flow runs: the campaign file's digest when it was deployed.
        folder: Working directory on the worker's machine or in the image; relative parameters are below it.
        description: Markdown.
        job_variables: Values for the pool's template.
        cron: Five fields; None runs on request only.
        timezone: IANA name for `cron`.
    """

    name: str
    campaign: str
    request: Mapping[str, Any]
    pool: str
    version: str
    folder: str
    description: str = ""
    job_variables: Mapping[str, Any] = field(default_factory=dict)
    cron: str | None = None
    timezone: str = "UTC"

    def as_yaml(self) -> dict[str, Any]:
        """An entry of `deployments` in a `prefect.yaml`; its flow runs run one at a time."""
        schedules = [] if self.cron is None else [{"cron": self.cron, "timezone": self.timezone}]
        return {
            "name": self.name,
            "version": self.version,
            "description": self.description,
            "tags": [TAG, label_of(self.campaign) or "campaign"],
            "entrypoint": ENTRYPOINT,
            "parameters": {"request": dict(self.request)},
            "enforce_parameter_schema": True,
            "concurrency_limit": {"limit": 1, "collision_strategy": "ENQUEUE"},
            "schedules": schedules,
            "pull": [{STEP: {"directory": self.folder}}],
            "work_pool": {"name": self.pool, "job_variables": dict(self.job_variables)},
        }


def description_of(
    campaign: str,
    file: str,
    runs: int,
    about: str = "",
    cluster: str | None = None,
    least: int | None = None,
) -> str:
    """Return a deployment's page in Markdown.

    Args:
        file: The campaign file, as the worker finds it.
        runs: Runs of each configuration, the maximum if `least` is given.
        about: The campaign file's own description.
        cluster: Address of a Dask cluster that computes the runs.
        least: Runs after which a configuration may end by a rule.
    """
    each = f"{runs} run{'s'[: runs != 1]} of each configuration"
    if least is not None:
        each = f"{least} to {runs} runs of each configuration, which ends when its class is decided"
    does = (
        f"Runs the campaign **{campaign}** (`{file}`), {each}, and writes its report. What the store has already is not "
        "computed again."
    )
    machine = "The whole campaign runs on the machine of the worker that takes it."
    if cluster is not None:
        machine = f"Workers of the Dask cluster at `{cluster}` compute the runs."
    where = (
        f"{machine} A flow run that Prefect shows as *Failed* has a fault, in its campaign file or in its runs. Runs that the robot "
        "failed are in the report."
    )
    return "\n\n".join(filter(None, (about.strip(), does, where))) + "\n"


class PoolType(StrEnum):
    """Kinds of work pools, under Prefect's own names."""

    process = "process"
    docker = "docker"
    kubernetes = "kubernetes"


NAME: Final = "vastflow"
"""Default name of namespace, queue, secret, and volume."""
IMAGE: Final = "vastflow:latest"
DATA: Final = "/data"
"""Folder of results and store in containers."""
CPU: Final = 2
"""Cores that are requested for a campaign whose file says nothing."""


def job_variables(kind: PoolType, containers: "Containers", image: str, queue: str) -> dict[str, Any]:
    """Return a campaign's values for its pool's template."""
    needs = containers.needs
    if kind is PoolType.process:
        return {}
    if kind is PoolType.docker:
        limit = {} if needs.memory_bytes is None else {"mem_limit": f"{needs.memory_bytes}b"}
        return {"image": image, **limit}
    found = {
        "image": image,
        "queue": queue,
        **needs.quantities,
        "node_selector": dict(containers.node_labels),
        "tolerations": list(containers.tolerations),
    }
    return {name: value for name, value in found.items() if value}
