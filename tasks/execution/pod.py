"""A run description as a pod of Kubernetes."""

import re
from typing import Any

from vastflow.tasks.execution.description import Container, RunDescription
from vastflow.tasks.execution.memory import kubernetes_memory
from vastflow.tasks.execution.template import filled, template


def pod_template(description: RunDescription) -> dict[str, Any]:
    """A `PodTemplate`, whose `template` is what a Job takes, as plain data. Requests are what the file asks for."""
    values = {"name": description.name, "spec": pod_spec(description)}
    made: dict[str, Any] = filled(template("templates/pod.yaml")["pod_template"], values)
    return made


def pod_spec(description: RunDescription) -> dict[str, Any]:
    """The `PodSpec` of `pod_template`."""
    parts = template("templates/pod.yaml")
    items = [{"key": key, "path": file} for key, file in config_map_keys(description).items()]
    config = {"config_map": config_map_name(description), "items": items}
    values = {
        "user": description.user,
        "is_not_root": description.user != 0,
        "deadline_s": description.deadline_s,
        "node_labels": dict(description.node_labels) or None,
        "sidecars": [_container(parts, description, each, "Always") for each in description.sidecars] or None,
        "main": _container(parts, description, description.main),
        "config_volume": filled(parts["config_volume"], config) if items else None,
    }
    spec: dict[str, Any] = filled(parts["spec"], values)
    return spec


def config_map_name(description: RunDescription) -> str:
    """Name of the ConfigMap in which the pod looks for the run's files."""
    return f"{description.name}-files"


def config_map_keys(description: RunDescription) -> dict[str, str]:
    """Key in the ConfigMap to file, as the campaign names it. Keys can't hold every character of a path."""
    names = [re.sub(r"[^-.\w]", "_", file.rpartition("/")[2], flags=re.ASCII) for file in description.files]
    return {f"{k}-{name}": file for k, (name, file) in enumerate(zip(names, description.files, strict=True))}


def _container(
    parts: dict[str, Any], description: RunDescription, container: Container, restart_policy: str | None = None
) -> dict[str, Any]:
    needs, environment = container.needs, description.environment_of(container)
    values = {
        "name": container.name,
        "image": description.image,
        "command": [_literal(argument) for argument in description.command_of(container)] or None,
        "env": [{"name": name, "value": _literal(value)} for name, value in environment.items()],
        "cpu": None if needs.cpu is None else str(needs.cpu),
        "memory": None if needs.memory_bytes is None else kubernetes_memory(needs.memory_bytes),
        "gpu": str(needs.gpu) if needs.gpu else None,
        "security_context": parts["unprivileged"] if description.user != 0 else None,
        "config_mount": parts["config_mount"] if description.files else None,
        "restart_policy": restart_policy,
    }
    made: dict[str, Any] = filled(parts["container"], values)
    return made


def _literal(text: str) -> str:
    """`text` with its dollars doubled: Kubernetes replaces `$(NAME)` in commands and values, and `$$` by `$`."""
    return text.replace("$", "$$")
