"""Needs of a campaign's containers, read from the keys of its `execution`: resources, variables, and nodes."""

import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, Final, Literal, TypeVar

import yaml

from vastflow.producers.campaign import Campaign
from vastflow.producers.campaign_file.document import EXPONENT
from vastflow.producers.campaign_file.spec import Resources
from vastflow.producers.model.faults import Location, shown
from vastflow.producers.model.numbers import memory_bytes
from vastflow.sim.model.faults import Fault, FileError, Got, Invalid, Problem
from vastflow.sim.model.names import did_you_mean, label_of

T = TypeVar("T")

VARIABLE: Final = re.compile(r"[A-Za-z_][A-Za-z0-9_]*")
NODE_LABEL: Final = re.compile(r"([a-z0-9][a-z0-9.-]{0,252}/)?[A-Za-z0-9]([A-Za-z0-9_.-]{0,61}[A-Za-z0-9])?")
NODE_LABEL_VALUE: Final = re.compile(r"([A-Za-z0-9]([A-Za-z0-9_.-]{0,61}[A-Za-z0-9])?)?")
PLAIN_SCALAR: Final = re.compile(r"[^\s,\[\]{}#]+")


def kubernetes_memory(size: int) -> str:
    """Return bytes as a quantity of Kubernetes, in the largest unit that gives a whole number."""
    units = {"Gi": 2**30, "Mi": 2**20, "Ki": 2**10}
    return next((f"{size // unit}{name}" for name, unit in units.items() if size % unit == 0), str(size))


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
class Containers:
    """Needs of a campaign's containers, or of those of its workers.

    Attributes:
        name: Campaign as a DNS label.
        env: Variables.
        node_labels: Labels that a cluster's node must have.
        tolerations: Tolerations of tainted nodes, as a pod has them.
    """

    name: str
    needs: Needs = Needs()
    env: Mapping[str, str] = field(default_factory=dict)
    node_labels: Mapping[str, str] = field(default_factory=dict)
    tolerations: Sequence[Mapping[str, str | int]] = ()


def containers_of(campaign: Campaign, name: str, context: str | None = None) -> Containers:
    """Return what the containers of `campaign`, which is called `name`, need.

    Args:
        context: Cluster (kubeconfig context) whose resources count; by default the first one in the file.

    Raises:
        FileError: values that containers can't have.
    """
    reader = _Reader(campaign, context)
    found = Containers(
        name=label_of(name) or "campaign",
        needs=reader.needs(),
        env=dict(reader.environment()),
        node_labels=dict(reader.node_labels()),
        tolerations=tuple(reader.jobs.tolerations) if reader.jobs else (),
    )
    if reader.faults:
        raise FileError(reader.faults)
    return found


class _Reader:
    """One reading of a campaign's `execution`, with its faults."""

    def __init__(self, campaign: Campaign, context: str | None) -> None:
        self.faults: list[Fault] = []
        self._campaign = campaign
        self._execution = campaign.spec.execution
        self.jobs = self._execution.kubernetes and self._execution.kubernetes.jobs
        self._context = context or next(_contexts(self._execution.resources), "")

    def needs(self) -> Needs:
        resources = self._execution.resources
        if resources is None:
            return Needs()
        memory = self._chosen(resources.memory, "memory")
        size = None
        if memory is not None:
            text, where = memory
            try:
                size = memory_bytes(text)
            except Invalid as error:
                self._fault(where, error.problem, error.expected)
        cpu = self._chosen(resources.cpu, "cpu")
        return Needs(cpu[0] if cpu else None, size, resources.gpu or 0)

    def environment(self) -> Iterator[tuple[str, str]]:
        """Yield the variables in the order of the file; of two with one name the later counts."""
        for i, entry in enumerate(self._execution.env):
            for name, value in entry.items():
                location = ("execution", "env", i, name)
                if not VARIABLE.fullmatch(name):
                    self._fault(location, Got(repr(name)), "letters, digits and underscores", "key")
                elif isinstance(value, list | dict):
                    self._fault(location, Got("a list or mapping"), "text, a number, true or false")
                else:
                    yield name, self._as_written(location, value)

    def node_labels(self) -> Iterator[tuple[str, str]]:
        for name, value in (self.jobs.node_labels if self.jobs else {}).items():
            location = ("execution", "kubernetes", "jobs", "node_labels", name)
            text = "" if isinstance(value, list | dict) else self._as_written(location, value)
            if not NODE_LABEL.fullmatch(name):
                self._fault(location, Got(repr(name)), "a label such as node-type or example.org/node-type", "key")
            elif isinstance(value, list | dict) or not NODE_LABEL_VALUE.fullmatch(text):
                self._fault(location, Got(shown(value)), "at most 63 letters, digits, '-', '_' and '.'")
            else:
                yield name, text

    def _chosen(self, amounts: T | list[dict[str, T]] | None, key: str) -> tuple[T, Location] | None:
        """Return the chosen cluster's amount and its place, if any."""
        location = ("execution", "resources", key)
        if amounts is None or not isinstance(amounts, list):
            return None if amounts is None else (amounts, location)
        places: dict[str, tuple[T, Location]] = {
            context: (amount, (*location, i, context))
            for i, entry in enumerate(amounts)
            for context, amount in entry.items()
        }
        if not places:
            self._fault(location, Got("an empty list"), "an amount, or one for each context, '- context: amount'")
        elif self._context not in places:
            self._fault(location, f"nothing for the context {self._context!r}", did_you_mean(self._context, places))
        return places.get(self._context)

    def _as_written(self, location: Location, value: Any) -> str:
        """Return a value of YAML as text: `1.10` and `yes` are 1.1 and true to YAML."""
        if value is None or isinstance(value, str):
            return value or ""
        line, column = self._campaign.document.place(location)
        match = PLAIN_SCALAR.match(self._campaign.document.text.split("\n")[line - 1], column - 1)
        if match and (yaml.safe_load(match[0]) == value or EXPONENT.fullmatch(match[0])):
            return match[0]
        return str(value).lower() if isinstance(value, bool) else str(value)

    def _fault(self, location: Location, what: Problem, right: str, at: Literal["key", "value"] = "value") -> None:
        self.faults.append(self._campaign.fault(location, what, right, at))


def _contexts(resources: Resources | None) -> Iterator[str]:
    for amounts in (resources.cpu, resources.memory) if resources else ():
        for entry in amounts if isinstance(amounts, list) else ():
            yield from entry
