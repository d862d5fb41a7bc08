"""Base job templates of Prefect's work pools, and what of a campaign file goes into them.

A flow run that a worker starts runs the whole campaign in one container of vastflow's own image. Containers that the campaign
file asks for beside it are sidecars of that one.
"""

from enum import StrEnum
from typing import Any, Final

from vastflow.tasks.execution.description import RunDescription, compose_memory, kubernetes_memory
from vastflow.tasks.execution.manifests import config_map_keys, config_map_name, pod_spec, template


class PoolType(StrEnum):
    """Kinds of work pools, under Prefect's own names."""

    process = "process"
    docker = "docker"
    kubernetes = "kubernetes"


CONTAINER_POOLS: Final = (PoolType.docker, PoolType.kubernetes)
"""Those whose base job template is ours."""

NAME: Final = "vastflow"
"""Of namespace, queue, secret and volume, where nobody says otherwise."""
IMAGE: Final = "vastflow:latest"
DATA: Final = "/data"
"""Where containers keep results and store."""
CPU: Final = 2
"""Cores that are requested for a campaign whose file says nothing."""


def base_job_template(kind: PoolType) -> dict[str, Any]:
    """The template of a pool as plain data: variables, which a deployment may set, and the job they go into.

    Raises:
        ValueError: a process pool; Prefect's own template is right for it.
    """
    if kind not in CONTAINER_POOLS:
        raise ValueError(f"expected Prefect has the template of a process pool, got {kind.value!r}")
    shipped: dict[str, Any] = template(f"pools/{kind.value}.json")
    return shipped


def job_variables(kind: PoolType, description: RunDescription) -> dict[str, Any]:
    """What a deployment sets of its pool's template.

    Args:
        description: Of the campaign; its image is the sidecars', and its main container says only what the flow run needs.
    """
    needs = description.main.needs
    if kind is PoolType.docker:
        return {} if needs.memory_bytes is None else {"mem_limit": compose_memory(needs.memory_bytes)}
    if kind is PoolType.process:
        return {}
    items = [{"key": key, "path": file} for key, file in config_map_keys(description).items()]
    sidecars = pod_spec(description).get("initContainers", [])
    found = {
        "cpu": None if needs.cpu is None else str(needs.cpu),
        "memory": None if needs.memory_bytes is None else kubernetes_memory(needs.memory_bytes),
        "gpu": str(needs.gpu) if needs.gpu else None,
        "node_selector": dict(description.node_labels) or None,
        "files": config_map_name(description) if items else None,
        "file_items": items or None,
        "sidecars": [_sidecar(container, description.user) for container in sidecars] or None,
    }
    return {name: value for name, value in found.items() if value is not None}


def _sidecar(container: dict[str, Any], user: int) -> dict[str, Any]:
    own = {"runAsUser": user, "runAsNonRoot": user != 0}
    return {**container, "securityContext": {**container.get("securityContext", {}), **own}}
