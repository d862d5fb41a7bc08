"""A run description as a pod of Kubernetes."""

import re
from typing import Any, Final

from vastflow.tasks.execution.description import (
    CONFIG,
    OUT,
    SHARED_MEMORY,
    SHARED_MEMORY_BYTES,
    SOCKETS,
    Container,
    Needs,
    RunDescription,
)
from vastflow.tasks.execution.memory import kubernetes_memory

GPU: Final = "nvidia.com/gpu"
READ_AND_EXECUTE: Final = 0o555
"""Mode of the run's files, for scripts are among them."""


def pod_template(description: RunDescription) -> dict[str, Any]:
    """A `PodTemplate`, whose `template` is what a Job takes, as plain data.

    Sidecars are init containers that restart always (Kubernetes 1.29 and later), so they start before the main container
    and the pod ends with it. Requests are what the file asks for. Memory is limited to the same, for a run that grows beyond
    is better ended than one of its neighbours; cores are not limited, for a throttled controller would miss its cycles.
    """
    name = description.name
    labels = {"app.kubernetes.io/name": "vastflow", "app.kubernetes.io/instance": name}
    return {
        "apiVersion": "v1",
        "kind": "PodTemplate",
        "metadata": {"name": name, "labels": labels},
        "template": {"metadata": {"labels": labels.copy()}, "spec": pod_spec(description)},
    }


def pod_spec(description: RunDescription) -> dict[str, Any]:
    """The `PodSpec` of `pod_template`."""
    spec: dict[str, Any] = {
        "restartPolicy": "Never",
        "automountServiceAccountToken": False,
        "enableServiceLinks": False,
        "securityContext": {
            "runAsUser": description.user,
            "runAsNonRoot": description.user != 0,
            "seccompProfile": {"type": "RuntimeDefault"},
        },
    }
    if description.deadline_s is not None:
        spec["activeDeadlineSeconds"] = description.deadline_s
    if description.node_labels:
        spec["nodeSelector"] = dict(description.node_labels)
    if description.sidecars:
        spec["initContainers"] = [
            {**_container(description, sidecar), "restartPolicy": "Always"} for sidecar in description.sidecars
        ]
    spec["containers"] = [_container(description, description.main)]
    spec["volumes"] = _volumes(description)
    return spec


def config_map_name(description: RunDescription) -> str:
    """Name of the ConfigMap in which the pod looks for the run's files."""
    return f"{description.name}-files"


def config_map_keys(description: RunDescription) -> dict[str, str]:
    """Key in the ConfigMap to file, as the campaign names it. Keys can't hold every character of a path."""
    names = [re.sub(r"[^-.\w]", "_", file.rpartition("/")[2], flags=re.ASCII) for file in description.files]
    return {f"{k}-{name}": file for k, (name, file) in enumerate(zip(names, description.files, strict=True))}


def _container(description: RunDescription, container: Container) -> dict[str, Any]:
    found: dict[str, Any] = {"name": container.name, "image": description.image}
    if command := description.command_of(container):
        found["command"] = [_literal(argument) for argument in command]
    environment = description.environment_of(container)
    found["env"] = [{"name": name, "value": _literal(value)} for name, value in environment.items()]
    if resources := _resources(container.needs):
        found["resources"] = resources
    if description.user != 0:
        found["securityContext"] = {"allowPrivilegeEscalation": False, "capabilities": {"drop": ["ALL"]}}
    found["volumeMounts"] = [
        {"name": "out", "mountPath": OUT},
        {"name": "sockets", "mountPath": SOCKETS},
        {"name": "shared-memory", "mountPath": SHARED_MEMORY},
    ]
    if description.files:
        found["volumeMounts"].append({"name": "config", "mountPath": CONFIG, "readOnly": True})
    return found


def _resources(needs: Needs) -> dict[str, Any]:
    requests: dict[str, str] = {}
    limits: dict[str, str] = {}
    if needs.cpu is not None:
        requests["cpu"] = str(needs.cpu)
    if needs.memory_bytes is not None:
        requests["memory"] = limits["memory"] = kubernetes_memory(needs.memory_bytes)
    if needs.gpu:
        limits[GPU] = str(needs.gpu)
    return {name: found for name, found in (("requests", requests), ("limits", limits)) if found}


def _volumes(description: RunDescription) -> list[dict[str, Any]]:
    in_memory = {"medium": "Memory", "sizeLimit": kubernetes_memory(SHARED_MEMORY_BYTES)}
    volumes: list[dict[str, Any]] = [
        {"name": "out", "emptyDir": {}},
        {"name": "sockets", "emptyDir": {}},
        {"name": "shared-memory", "emptyDir": in_memory},
    ]
    if description.files:
        items = [{"key": key, "path": file} for key, file in config_map_keys(description).items()]
        source = {"name": config_map_name(description), "defaultMode": READ_AND_EXECUTE, "items": items}
        volumes.append({"name": "config", "configMap": source})
    return volumes


def _literal(text: str) -> str:
    """`text` with its dollars doubled: Kubernetes replaces `$(NAME)` in commands and values, and `$$` by `$`."""
    return text.replace("$", "$$")
