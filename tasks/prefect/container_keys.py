"""The keys of a campaign's `execution` about containers, read into a run description."""

import math
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any, Final, Literal, TypeVar

import yaml

from vastflow.producers.campaign import Campaign
from vastflow.producers.campaign_file.document import EXPONENT
from vastflow.producers.campaign_file.scenario import run_files
from vastflow.producers.campaign_file.spec import Resources
from vastflow.producers.model.faults import Location, shown
from vastflow.sim.model.faults import Fault, FileError, ScenarioError
from vastflow.sim.model.names import did_you_mean
from vastflow.tasks.prefect.containers import MAIN, Container, Needs, RunDescription, label_of, memory_bytes

T = TypeVar("T")

VARIABLE: Final = re.compile(r"[A-Za-z_][A-Za-z0-9_]*")
NODE_LABEL: Final = re.compile(r"([a-z0-9][a-z0-9.-]{0,252}/)?[A-Za-z0-9]([A-Za-z0-9_.-]{0,61}[A-Za-z0-9])?")
NODE_LABEL_VALUE: Final = re.compile(r"([A-Za-z0-9]([A-Za-z0-9_.-]{0,61}[A-Za-z0-9])?)?")
PLAIN_SCALAR: Final = re.compile(r"[^\s,\[\]{}#]+")


def describe(campaign: Campaign, name: str, context: str | None = None) -> RunDescription:
    """Return the run description of `campaign`, which is called `name`.

    Args:
        context: Cluster (kubeconfig context) whose resources count; by default the first one in the file.

    Raises:
        CampaignError: no image, or values that containers can't have.
    """
    execution = campaign.spec.execution
    reader = _Reader(campaign, context)
    found = RunDescription(
        name=label_of(name) or "campaign",
        image=reader.image(),
        main=Container(MAIN, reader.needs(execution.resources, ("execution", "resources"))),
        sidecars=tuple(reader.sidecars()),
        env=dict(reader.environment()),
        folder=campaign.path.parent,
        files=tuple(reader.files()),
        pre_command=execution.pre_command or None,
        post_command=execution.post_command or None,
        user=execution.run_as_user,
        # Version 1 has seconds of the host here, for one run; in our simulator they are simulated ones.
        deadline_s=math.ceil(execution.timeout * execution.runs_per_job) if execution.timeout else None,
        node_labels=dict(reader.node_labels()),
        tolerations=tuple(jobs.tolerations) if (jobs := execution.kubernetes and execution.kubernetes.jobs) else (),
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
        self._context = context or next(self._contexts(), "")

    def image(self) -> str:
        image = self._execution.image
        if image is None:
            right = "image: container image of the system under test, such as ghcr.io/me/robot:1.0"
            self.faults.append(self._campaign.fault(("execution",), "no 'image'", right, "key"))
        elif not image or re.search(r"\s", image):
            self._fault(("execution", "image"), f"got {image!r}", "the name of an image, such as ghcr.io/me/robot:1.0")
        return image or ""

    def needs(self, resources: Resources | None, location: Location) -> Needs:
        if resources is None:
            return Needs()
        memory = self._chosen(resources.memory, (*location, "memory"))
        size = None
        if memory is not None:
            text, where = memory
            try:
                size = memory_bytes(text)
            except ValueError as error:
                what, _, right = str(error).partition("; ")
                self._fault(where, what, right)
        cpu = self._chosen(resources.cpu, (*location, "cpu"))
        return Needs(cpu[0] if cpu else None, size, resources.gpu or 0)

    def sidecars(self) -> Iterator[Container]:
        names = {MAIN}
        for i, secondary in enumerate(self._execution.secondary_containers):
            location = ("execution", "secondary_containers", i)
            name = label_of(secondary.name)
            needs = self.needs(secondary.resources, (*location, "resources"))
            if not name:
                self._fault(location, f"got {secondary.name!r}", "a name of letters, digits and hyphens")
            elif name in names:
                what = f"{name!r} is the main container" if name == MAIN else f"a second container {name!r}"
                self._fault(location, what, "another name")
            else:
                names.add(name)
                yield Container(name, needs)

    def environment(self) -> Iterator[tuple[str, str]]:
        """Yield the variables in the order of the file; of two with one name the later counts."""
        for i, entry in enumerate(self._execution.env):
            for name, value in entry.items():
                location = ("execution", "env", i, name)
                if not VARIABLE.fullmatch(name):
                    self._fault(location, f"got {name!r}", "letters, digits and underscores", "key")
                elif name == "CONTAINER_NAME":
                    self._fault(location, f"{name} is set for every container", "another name", "key")
                elif isinstance(value, list | dict):
                    self._fault(location, "got a list or mapping", "text, a number, true or false")
                else:
                    yield name, self._as_written(location, value)

    def files(self) -> Iterator[str]:
        """Yield the files that the patterns match, each once; a pattern without a slash matches in every folder."""
        folder = self._campaign.path.parent
        seen: set[str] = set()
        for i, pattern in enumerate(self._execution.run_files):
            location = ("execution", "run_files", i)
            if ".." in Path(pattern).parts or Path(pattern).is_absolute():
                self._fault(location, f"got {pattern!r}", "a pattern of files below the campaign file's folder")
                continue
            try:
                found = [path for path, _ in run_files(folder, [pattern])]
            except ScenarioError:
                self._fault(location, f"got {pattern!r}", "a pattern such as scripts/*.sh or **/*.yaml")
                continue
            if not found:
                self._fault(location, f"got {pattern!r}, which no file matches", f"a pattern of files below {folder}")
            yield from (file for file in found if file not in seen)
            seen.update(found)

    def node_labels(self) -> Iterator[tuple[str, str]]:
        jobs = self._execution.kubernetes.jobs if self._execution.kubernetes else None
        for name, value in (jobs.node_labels if jobs else {}).items():
            location = ("execution", "kubernetes", "jobs", "node_labels", name)
            text = "" if isinstance(value, list | dict) else self._as_written(location, value)
            if not NODE_LABEL.fullmatch(name):
                self._fault(location, f"got {name!r}", "a label such as node-type or example.org/node-type", "key")
            elif isinstance(value, list | dict) or not NODE_LABEL_VALUE.fullmatch(text):
                self._fault(location, f"got {shown(value)}", "at most 63 letters, digits, '-', '_' and '.'")
            else:
                yield name, text

    def _contexts(self) -> Iterator[str]:
        needs = [self._execution.resources, *(each.resources for each in self._execution.secondary_containers)]
        for resources in needs:
            for amounts in (resources.cpu, resources.memory) if resources else ():
                for entry in amounts if isinstance(amounts, list) else ():
                    yield from entry

    def _chosen(self, amounts: T | list[dict[str, T]] | None, location: Location) -> tuple[T, Location] | None:
        """Return the chosen cluster's amount and its place, if any."""
        if amounts is None or not isinstance(amounts, list):
            return None if amounts is None else (amounts, location)
        places: dict[str, tuple[T, Location]] = {
            context: (amount, (*location, i, context))
            for i, entry in enumerate(amounts)
            for context, amount in entry.items()
        }
        if not places:
            self._fault(location, "got an empty list", "an amount, or one for each context, '- context: amount'")
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

    def _fault(self, location: Location, what: str, right: str, at: Literal["key", "value"] = "value") -> None:
        self.faults.append(self._campaign.fault(location, what, right, at))
