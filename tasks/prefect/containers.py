"""Containers of a run: their resources and their variables, whatever the container engine."""

import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from fractions import Fraction
from pathlib import Path
from typing import Final

from vastflow.sim.model.faults import complaint

SUFFIXES: Final[Mapping[str, int]] = {
    "": 1,
    "k": 10**3,
    "M": 10**6,
    "G": 10**9,
    "T": 10**12,
    "P": 10**15,
    "Ki": 2**10,
    "Mi": 2**20,
    "Gi": 2**30,
    "Ti": 2**40,
    "Pi": 2**50,
}
"""Units of Kubernetes' quantities, without those below a byte (`8m` is 0.008 bytes) and exponents."""
QUANTITY: Final = re.compile(r"(\d+(?:\.\d*)?|\.\d+)\s*([A-Za-z]*)", re.ASCII)


def memory_bytes(text: str) -> int:
    """Return the bytes of a quantity such as `8Gi` or `1.5G`, rounded up.

    Raises:
        ValueError: no such quantity.
    """
    match = QUANTITY.fullmatch(text.strip())
    if match and match[2] in SUFFIXES and text == match[1] + match[2]:
        size = math.ceil(Fraction(match[1]) * SUFFIXES[match[2]])
        if size > 0:
            return size
    near = f"{match[2][:1].upper()}i" if match else ""
    right = f"did you mean '{match[1]}{near}'?" if match and near in SUFFIXES else "a quantity such as 8Gi or 512Mi"
    raise ValueError(complaint(f"got {text!r}", right))


def kubernetes_memory(size: int) -> str:
    """Return bytes as a quantity of Kubernetes, in the largest unit that gives a whole number."""
    return _in_units(size, {"Gi": 2**30, "Mi": 2**20, "Ki": 2**10}, "")


def compose_memory(size: int) -> str:
    """Return bytes for Docker Compose, where k, m, and g are powers of 1024."""
    return _in_units(size, {"g": 2**30, "m": 2**20, "k": 2**10}, "b")


def _in_units(size: int, units: Mapping[str, int], byte: str) -> str:
    return next((f"{size // unit}{name}" for name, unit in units.items() if size % unit == 0), f"{size}{byte}")


MAIN: Final = "main"
"""Name of the container whose end is the run's."""
OUT: Final = "/vastflow/out"
"""Shared folder of output that is kept."""

MAX_LABEL: Final = 63


def label_of(text: str) -> str:
    """Return the nearest DNS label (RFC 1123), as containers need; empty without letters and digits."""
    return re.sub(r"[^a-z0-9]+", "-", text.lower()).strip("-")[:MAX_LABEL].rstrip("-")


@dataclass(frozen=True, slots=True)
class Needs:
    """Resources of a container.

    Attributes:
        cpu: Cores.
        memory_bytes: Maximum memory (bytes).
        gpu: NVIDIA GPUs.
    """

    cpu: int | None = None
    memory_bytes: int | None = None
    gpu: int = 0

    @property
    def quantities(self) -> dict[str, str]:
        """The needed `cpu`, `memory`, and `gpu` as quantities of Kubernetes."""
        memory = self.memory_bytes and kubernetes_memory(self.memory_bytes)
        amounts = {"cpu": self.cpu, "memory": memory, "gpu": self.gpu}
        return {name: str(amount) for name, amount in amounts.items() if amount}


@dataclass(frozen=True, slots=True)
class Container:
    """A container of the run, which runs its image's own command; its name is a DNS label."""

    name: str
    needs: Needs = Needs()


@dataclass(frozen=True, slots=True)
class RunDescription:
    """One run, or one job of several, in containers of one image that share files, sockets, memory, and network.

    Attributes:
        name: Campaign as a DNS label.
        main: The container whose end is the run's.
        sidecars: Containers that start before the main one and stop when it ends.
        env: Variables of all containers.
        folder: Base of the paths in `files`.
        files: Files that the containers find below `/config`.
        pre_command, post_command: Scripts in the main container, sourced before and run after its command by the image.
        user: User id in the containers.
        deadline_s: Seconds of the host after which everything is stopped; None for never.
        node_labels: Labels that a cluster's node must have.
        tolerations: Tolerations of tainted nodes, as a pod has them.
    """

    name: str
    image: str
    main: Container
    sidecars: tuple[Container, ...] = ()
    env: Mapping[str, str] = field(default_factory=dict)
    folder: Path = Path()
    files: tuple[str, ...] = ()
    pre_command: str | None = None
    post_command: str | None = None
    user: int = 1000
    deadline_s: int | None = None
    node_labels: Mapping[str, str] = field(default_factory=dict)
    tolerations: Sequence[Mapping[str, str | int]] = ()

    def environment_of(self, container: Container) -> dict[str, str]:
        """Return the container's variables, which name the scripts to the main one."""
        own = {
            "CAMPAIGN_ID": self.name,
            "CONTAINER_NAME": container.name,
            "ROS_LOG_DIR": f"{OUT}/logs/{container.name}",
        }
        scripts = {"PRE_COMMAND": self.pre_command, "POST_COMMAND": self.post_command}
        if container.name == self.main.name:
            own.update({name: path for name, path in scripts.items() if path is not None})
        return {**self.env, **own}
