"""A run description as a file of Docker Compose."""

from typing import Any, Final

from vastflow.tasks.execution.description import (
    CONFIG,
    OUT,
    SHARED_MEMORY_BYTES,
    SOCKETS,
    Container,
    Needs,
    RunDescription,
)
from vastflow.tasks.execution.memory import compose_memory

OUT_FOLDER: Final = "./out"


def compose_file(description: RunDescription) -> dict[str, Any]:
    """The file as plain data. Its paths are relative to the campaign file's folder.

    As in a pod, the containers share network, `/dev/shm` and two folders, and the main one starts last. The first to
    start has the network and the memory that the others join. There is no key for the deadline.
    """
    containers = (*description.sidecars, description.main)
    file: dict[str, Any] = {
        "name": description.name,
        "services": {container.name: _service(description, container, containers[0]) for container in containers},
        # A new volume is root's; in memory it can have another owner, and sockets need no disk.
        "volumes": {
            "sockets": {
                "driver": "local",
                "driver_opts": {"type": "tmpfs", "device": "tmpfs", "o": f"uid={description.user},mode=0770"},
            }
        },
    }
    literal: dict[str, Any] = _literal(file)
    return literal


def _service(description: RunDescription, container: Container, first: Container) -> dict[str, Any]:
    service: dict[str, Any] = {"image": description.image}
    if command := description.command_of(container):
        service["entrypoint"] = list(command)
    service |= {"user": str(description.user), "init": True, "restart": "no"}
    if description.user != 0:
        service |= {"cap_drop": ["ALL"], "security_opt": ["no-new-privileges:true"]}
    if container is first:
        service |= {"ipc": "shareable", "shm_size": compose_memory(SHARED_MEMORY_BYTES)}
    else:
        service |= {"ipc": f"service:{first.name}", "network_mode": f"service:{first.name}"}
    if container is description.main and description.sidecars:
        service["depends_on"] = [sidecar.name for sidecar in description.sidecars]
    service["environment"] = description.environment_of(container)
    service["volumes"] = [
        _bound(OUT_FOLDER, OUT),
        {"type": "volume", "source": "sockets", "target": SOCKETS},
        *({**_bound(f"./{file}", f"{CONFIG}/{file}"), "read_only": True} for file in description.files),
    ]
    if resources := _resources(container.needs):
        service["deploy"] = {"resources": resources}
    return service


def _bound(source: str, target: str) -> dict[str, Any]:
    """A mount of the host's; a source that is not there is an error and not a new folder of root's."""
    return {"type": "bind", "source": source, "target": target, "bind": {"create_host_path": False}}


def _resources(needs: Needs) -> dict[str, Any]:
    reserved: dict[str, Any] = {}
    limits: dict[str, Any] = {}
    if needs.cpu is not None:
        reserved["cpus"] = str(needs.cpu)
    if needs.memory_bytes is not None:
        reserved["memory"] = limits["memory"] = compose_memory(needs.memory_bytes)
    if needs.gpu:
        reserved["devices"] = [{"driver": "nvidia", "count": needs.gpu, "capabilities": ["gpu"]}]
    return {name: found for name, found in (("reservations", reserved), ("limits", limits)) if found}


def _literal(value: Any) -> Any:
    """`value` with its dollars doubled: Compose takes a single one for a variable of its own."""
    if isinstance(value, dict):
        return {key: _literal(inner) for key, inner in value.items()}
    if isinstance(value, list):
        return [_literal(inner) for inner in value]
    return value.replace("$", "$$") if isinstance(value, str) else value
