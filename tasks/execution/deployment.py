"""Deployments of the flows that run a campaign and a shard of one, in the form of Prefect's `prefect.yaml`."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, Final

from vastflow.tasks.execution.description import label_of

FLOW: Final = "campaign"
ENTRYPOINT: Final = "vastflow.flows.campaign.campaign"
"""A module's function, found wherever vastflow is installed."""
TAG: Final = "vastflow"

OTHER_CODE: Final = "OtherCode"
STORE_AWAY: Final = "StoreAway"
"""Names of the states in which a shard's flow run ends where the worker can't compute it and another one might."""
BAR: Final = "shard"
"""How the key of a shard's progress artifact ends; the artifact's age says whether the flow run lives."""

STEP: Final = "prefect.deployments.steps.set_working_directory"


@dataclass(frozen=True, slots=True)
class Deployment:
    """A campaign that Prefect runs on request or by a schedule.

    Attributes:
        name: Of the deployment.
        campaign: The campaign's own name.
        request: What is asked of the flow, as fields of `RunRequest`; what is left out has its defaults.
        pool: Name of the work pool.
        folder: Working directory on the worker's machine or in the image; relative parameters are below it.
        description: Markdown.
        job_variables: What it sets of the pool's template.
        cron: Five fields; None runs on request only.
        timezone: IANA name in which `cron` counts.
    """

    name: str
    campaign: str
    request: Mapping[str, Any]
    pool: str
    folder: str
    description: str = ""
    job_variables: Mapping[str, Any] = field(default_factory=dict)
    cron: str | None = None
    timezone: str = "UTC"

    def as_yaml(self) -> dict[str, Any]:
        """An entry of `deployments` in a `prefect.yaml`, as plain data.

        Of one deployment one flow run runs at a time and the others wait: two at once would compute the same.
        """
        schedules = [] if self.cron is None else [{"cron": self.cron, "timezone": self.timezone}]
        return {
            "name": self.name,
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


@dataclass(frozen=True, slots=True)
class ShardDeployment:
    """What makes the workers of a pool compute shards; a pool needs one, whatever the campaigns.

    Attributes:
        pool: Name of the work pool.
        job_variables: What it sets of the pool's template; a campaign adds its own for each shard.
    """

    pool: str
    job_variables: Mapping[str, Any] = field(default_factory=dict)

    @property
    def path(self) -> str:
        """Flow and deployment, as Prefect names them together."""
        return f"{FLOW}/{self.name}"

    @property
    def name(self) -> str:
        """Of the deployment."""
        return f"{self.pool}-shards"

    def as_yaml(self) -> dict[str, Any]:
        """An entry of `deployments` in a `prefect.yaml`, as plain data. Workers need no folder: all is in the store."""
        return {
            "name": self.name,
            "description": "Computes shards of the campaigns that are run with this work pool. Nobody else has to run it.\n",
            "tags": [TAG],
            "entrypoint": ENTRYPOINT,
            "parameters": {},
            "enforce_parameter_schema": False,
            "schedules": [],
            "pull": [],
            "work_pool": {"name": self.pool, "job_variables": dict(self.job_variables)},
        }


def description_of(
    campaign: str,
    file: str,
    runs: int,
    about: str = "",
    shards_in: str | None = None,
    least: int | None = None,
) -> str:
    """What a deployment's page says, in Markdown.

    Args:
        file: The campaign file, as the worker finds it.
        runs: Of each configuration.
        about: The campaign file's own description.
        shards_in: Work pool whose workers compute the runs.
        least: Runs after which a configuration may end, where they end by a rule; `runs` is the most then.
    """
    each = f"{runs} run{'s'[: runs != 1]} of each configuration"
    if least is not None:
        each = f"{least} to {runs} runs of each configuration, which ends when its class is decided"
    does = (
        f"Runs the campaign **{campaign}** (`{file}`), {each}, and writes its report. What the store has already is not "
        "computed again."
    )
    machine = "The whole campaign runs on the machine of the worker that takes it."
    if shards_in is not None:
        machine = f"Workers of the work pool **{shards_in}** compute the runs."
    where = (
        f"{machine} A flow run that Prefect shows as *Failed* has a fault, in its campaign file or in its runs; runs that the robot "
        "failed are in the report."
    )
    return "\n\n".join(filter(None, (about.strip(), does, where))) + "\n"
