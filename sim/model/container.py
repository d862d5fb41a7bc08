"""Containers of a campaign's runs, as they are described."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, Literal


@dataclass(frozen=True, slots=True)
class Mount:
    """A folder or file of this machine, as a container sees it."""

    source: str
    target: str
    writable: bool = False


@dataclass(frozen=True, slots=True)
class Container:
    """A container of a campaign's runs, see `execution.containers`.

    Attributes:
        image: Image of Docker or Podman; empty where there is a `rootfs`.
        rootfs: Root folder on this machine, which it may only read.
        command: Program and arguments; empty for the image's own.
        cpu: Cores that it may use, at most; None for all.
        memory: Its greatest memory (bytes); None for all.
        processes: Greatest number of its processes and threads; None for any.
        network: `none`, or `run` for a loopback that containers of the run share.
        after: Containers that have to be healthy before.
        health: `log` (a text that it prints), `port` (TCP, listened on), or `command` (exits with 0), and its value; may be empty.
        within_s: Host time until it has to be healthy.
    """

    image: str = ""
    rootfs: str = ""
    command: tuple[str, ...] = ()
    environment: Mapping[str, str] = field(default_factory=dict)
    mounts: tuple[Mount, ...] = ()
    cpu: float | None = None
    memory: int | None = None
    processes: int | None = None
    network: Literal["none", "run"] = "run"
    after: tuple[str, ...] = ()
    health: Mapping[str, Any] = field(default_factory=dict)
    within_s: float = 30.0


def container_of(content: Mapping[str, Any]) -> Container:
    """Return the container that a `ProcessSetup` describes by `content`."""
    lists = {name: tuple(content[name]) for name in ("command", "after") if name in content}
    return Container(**{**content, **lists, "mounts": tuple(Mount(**each) for each in content.get("mounts", ()))})
