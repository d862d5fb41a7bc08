"""A run description as a file of Docker Compose."""

from typing import Any, Final

from vastflow.tasks.execution.description import Container, RunDescription
from vastflow.tasks.execution.memory import compose_memory
from vastflow.tasks.execution.template import filled, template

OUT_FOLDER: Final = "./out"


def compose_file(description: RunDescription) -> dict[str, Any]:
    """The file as plain data. Its paths are relative to the campaign file's folder.

    As in a pod, the containers share network, `/dev/shm` and two folders, and the main one starts last.
    """
    parts = template("templates/compose.yaml")
    containers = (*description.sidecars, description.main)
    services = {each.name: _service(parts, description, each, containers[0]) for each in containers}
    values = {"name": description.name, "user": description.user, "services": services}
    literal: dict[str, Any] = _literal(filled(parts["file"], values))
    return literal


def _service(
    parts: dict[str, Any], description: RunDescription, container: Container, first: Container
) -> dict[str, Any]:
    needs = container.needs
    waits_for = [sidecar.name for sidecar in description.sidecars] if container is description.main else []
    values = {
        **dict.fromkeys(("cap_drop", "security_opt", "shm_size", "network_mode")),
        **(parts["unprivileged"] if description.user != 0 else {}),
        **(parts["first"] if container is first else filled(parts["joined"], {"first": first.name})),
        "image": description.image,
        "command": list(description.command_of(container)) or None,
        "user": str(description.user),
        "depends_on": waits_for or None,
        "environment": description.environment_of(container),
        "cpu": None if needs.cpu is None else str(needs.cpu),
        "memory": None if needs.memory_bytes is None else compose_memory(needs.memory_bytes),
        "devices": filled(parts["devices"], {"gpu": needs.gpu}) if needs.gpu else None,
    }
    service: dict[str, Any] = filled(parts["service"], values)
    service["volumes"] += [filled(parts["mount"], {"file": file}) for file in description.files]
    return service


def _literal(value: Any) -> Any:
    """`value` with its dollars doubled: Compose takes a single one for a variable of its own."""
    if isinstance(value, dict):
        return {key: _literal(inner) for key, inner in value.items()}
    if isinstance(value, list):
        return [_literal(inner) for inner in value]
    return value.replace("$", "$$") if isinstance(value, str) else value
