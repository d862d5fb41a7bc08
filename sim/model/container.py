"""Containers of a campaign's runs, as they are described."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, Final, Literal

MAIN: Final = "main"
"""The container in which the scenario's programs are started, each in one of its own."""
CHECKS: Final = ("log", "port", "command")
"""Kinds of health: a text that it prints, a TCP port on which it listens, a command that exits with 0 in it."""


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
        health: One of `CHECKS` and its value, and `timeout` (s, host time) where it is not 30; may be empty.
    """

    image: str = ""
    rootfs: str = ""
    command: tuple[str, ...] = ()
    env: Mapping[str, str] = field(default_factory=dict)
    mounts: tuple[Mount, ...] = ()
    cpu: float | None = None
    memory: int | None = None
    processes: int | None = None
    network: Literal["none", "run"] = "run"
    after: tuple[str, ...] = ()
    health: Mapping[str, Any] = field(default_factory=dict)


def container_of(content: Mapping[str, Any]) -> Container:
    """Return the container that a `ProcessSetup` describes by `content`."""
    lists = {name: tuple(content[name]) for name in ("command", "after") if name in content}
    return Container(**{**content, **lists, "mounts": tuple(Mount(**each) for each in content.get("mounts", ()))})
