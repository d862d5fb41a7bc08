"""The files of this folder that a program can make: every one is what its builder gives, with our own defaults."""

import json
from collections.abc import Mapping
from typing import Any, Final

from vastflow.tasks.execution.charts import namespace_manifests, server_values, worker_values
from vastflow.tasks.execution.deployment import Deployment, ShardDeployment, description_of
from vastflow.tasks.execution.job import CPU, DATA, IMAGE, NAME, PoolType, base_job_template
from vastflow.tasks.execution.kueue import queue_manifests
from vastflow.tasks.execution.manifest import yaml_text

CAMPAIGN: Final = "quickstart"
FILE: Final = "campaigns/quickstart/quickstart.vast"
RUNS: Final = 5
NIGHTLY: Final = "0 2 * * *"
IMAGE_FOLDER: Final = "/vastflow"

QUOTA_CPU: Final = 16
QUOTA_MEMORY_BYTES: Final = 64 * 2**30
STORAGE_BYTES: Final = 100 * 2**30


def checked_in() -> Mapping[str, str]:
    """Path below this folder to content."""
    return {
        "prefect.yaml": yaml_text(
            {"name": NAME, "deployments": [each.as_yaml() for each in [*_deployments(), *_shards()]]}
        ),
        "pools/docker.json": _json(base_job_template(PoolType.docker)),
        "pools/kubernetes.json": _json(base_job_template(PoolType.kubernetes)),
        "kubernetes/namespace.yaml": _documents(namespace_manifests(STORAGE_BYTES)),
        "kueue/queues.yaml": _documents(queue_manifests(NAME, NAME, QUOTA_CPU, QUOTA_MEMORY_BYTES)),
        "values/server.yaml": yaml_text(server_values()),
        "values/worker.yaml": yaml_text(worker_values("cluster")),
    }


def _deployments() -> list[Deployment]:
    """The quickstart on each kind of pool, every night."""
    image = {"image": IMAGE}
    in_image = {"campaign": FILE, "results": f"{DATA}/results"}
    return [
        _nightly("lab", {"campaign": FILE, "results": "results"}, "{{ $PWD }}", {}),
        _nightly("docker", in_image, IMAGE_FOLDER, image),
        _nightly("cluster", {**in_image, "workers": CPU}, IMAGE_FOLDER, {**image, "queue": NAME}),
    ]


def _shards() -> list[ShardDeployment]:
    """By which the same pools compute shards of whatever campaign names them."""
    image = {"image": IMAGE}
    return [
        ShardDeployment("lab"),
        ShardDeployment("docker", image),
        ShardDeployment("cluster", {**image, "queue": NAME}),
    ]


def _nightly(pool: str, parameters: Mapping[str, Any], folder: str, job_variables: Mapping[str, Any]) -> Deployment:
    return Deployment(
        name=f"{CAMPAIGN}-{pool}",
        campaign=CAMPAIGN,
        parameters=parameters,
        pool=pool,
        folder=folder,
        description=description_of(CAMPAIGN, FILE, RUNS),
        job_variables=job_variables,
        cron=NIGHTLY,
    )


def _documents(manifests: list[dict[str, Any]]) -> str:
    return "---\n".join(yaml_text(manifest) for manifest in manifests)


def _json(content: Mapping[str, Any]) -> str:
    return json.dumps(content, indent=2, ensure_ascii=False) + "\n"
