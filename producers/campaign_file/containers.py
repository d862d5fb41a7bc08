"""Containers of a campaign's runs: `execution.containers`, or what `image` and `secondary_containers` of RoboVAST say."""

import re
import shlex
from collections.abc import Mapping, Sequence
from pathlib import PurePosixPath
from typing import Annotated, Any, Literal, Self, TypeAlias

from pydantic import AfterValidator, BeforeValidator, Field, model_validator

from vastflow.producers.campaign_file.sections import EmptyIsList, EmptyIsMap, Section
from vastflow.producers.model.numbers import Count, Positive, memory_bytes
from vastflow.sim.model.container import CHECKS, MAIN
from vastflow.sim.model.digest import Value
from vastflow.sim.model.faults import Got, Invalid
from vastflow.sim.model.names import did_you_mean
from vastflow.sim.scenario.programs.folders import below_config

Runtime: TypeAlias = Literal["any", "docker", "podman", "runc", "bubblewrap"]


def _words(command: Any) -> Any:
    try:
        return shlex.split(command) if isinstance(command, str) else command
    except ValueError as error:
        raise Invalid(Got(repr(command)), f"a command as a shell reads it ({error})") from None


def _text(value: Any) -> Any:
    """Return a number as text, and YAML's `true` as a shell would have it."""
    return str(value).lower() if isinstance(value, bool) else str(value) if isinstance(value, int | float) else value


def _absolute(path: str) -> str:
    if not path.startswith("/") or ".." in PurePosixPath(path).parts:
        raise Invalid(Got(repr(path)), "an absolute path")
    return path


def _source(path: str) -> str:
    if not path.startswith("/") and below_config(path) is None:
        raise Invalid(Got(repr(path)), "an absolute path, or one below the campaign file's folder")
    return path


Command: TypeAlias = Annotated[
    Annotated[list[str], Field(min_length=1)], BeforeValidator(_words, json_schema_input_type=str | list[str])
]
_Text: TypeAlias = Annotated[str, BeforeValidator(_text, json_schema_input_type=str | int | float | bool)]
Variables: TypeAlias = Annotated[dict[str, _Text], EmptyIsMap]


class LimitSpec(Section):
    """Limits of a container."""

    cpu: Positive | None = None
    """Cores, such as 0.5."""
    memory: Annotated[int, BeforeValidator(lambda text: memory_bytes(str(text)), json_schema_input_type=str)] | None = (
        None
    )
    """Memory in units of Kubernetes, such as `512Mi`. A run in which it is exceeded is a fault."""
    processes: Count | None = None
    """Processes and threads."""


class MountSpec(Section):
    """A file or folder of this machine that a container sees."""

    source: Annotated[str, AfterValidator(_source)]
    """A run file, or a folder of them, by its path below the campaign file's folder; or any absolute path of this machine."""
    target: Annotated[str, AfterValidator(_absolute)]
    """Its absolute path in the container."""
    writable: bool = False
    """Whether the container may write there."""


class HealthSpec(Section):
    """The check that a container is ready: one of these, within a time."""

    log: str | None = None
    """A text that it prints."""
    port: Annotated[int, Field(ge=1, le=65535)] | None = None
    """A TCP port on which it listens."""
    command: Command | None = None
    """A command that exits with 0 in it."""
    timeout: Positive = 30.0
    """Real seconds from its start."""

    @model_validator(mode="after")
    def _one(self) -> Self:
        if sum(getattr(self, name) is not None for name in CHECKS) != 1:
            raise Invalid("there is not one check", "give log, port, or command")
        return self


class ContainerSpec(Section):
    """A container of each run."""

    image: str | None = None
    """Image that Docker or Podman has on the machine; none is downloaded."""
    rootfs: Annotated[str, AfterValidator(_absolute)] | None = None
    """Root folder on the machine in place of an image, which is read-only, such as `/`."""
    command: Command | None = None
    """Program and arguments, a list or as a shell reads them; the image's own if not given."""
    env: Variables = Field(default_factory=dict)
    """Variables beside those of `execution.env`."""
    mounts: Annotated[list[MountSpec], EmptyIsList] = Field(default_factory=list)
    """Files and folders of the machine, beside `/config`, `/out`, and `/channel`."""
    resources: Annotated[LimitSpec, EmptyIsMap] = Field(default_factory=LimitSpec)
    """Limits of what it uses."""
    network: Literal["none", "run"] = "run"
    """`run`: one loopback with the other containers of the run, and nothing else; `none`: a loopback of its own."""
    after: list[str] = Field(default_factory=list)
    """Containers that have to be healthy before it starts."""
    health: HealthSpec | None = None
    """How it shows that it is ready; started is enough if not given."""

    @model_validator(mode="after")
    def _one_root(self) -> Self:
        if (self.image is None) == (self.rootfs is None):
            raise Invalid("there is not one root file system", "give image or rootfs")
        return self


def _set(specs: dict[str, ContainerSpec]) -> dict[str, ContainerSpec]:
    for name, spec in specs.items():
        if not re.fullmatch(r"[a-z0-9]([a-z0-9-]{0,60}[a-z0-9])?", name):
            raise Invalid(Got(repr(name)), "a name of lowercase letters, digits and hyphens")
        if spec.rootfs is not None and spec.command is None and name != MAIN:
            raise Invalid(f"container {name!r} has a rootfs and no command", "give it one")
        if unknown := next((each for each in spec.after if each not in specs), None):
            raise Invalid(f"unknown container {unknown!r} in after of {name!r}", did_you_mean(unknown, specs))
    if len({spec.image is None for spec in specs.values()}) > 1:
        raise Invalid("some containers have an image and some a rootfs", "no runtime has both")
    started: set[str] = set()
    while more := [name for name, spec in specs.items() if name not in started and started.issuperset(spec.after)]:
        started.update(more)
    if len(started) < len(specs):
        raise Invalid(f"{' and '.join(repr(name) for name in specs if name not in started)} wait for each other", "")
    return specs


Containers: TypeAlias = Annotated[dict[str, ContainerSpec], AfterValidator(_set), EmptyIsMap]


def containers_of(
    specs: Mapping[str, ContainerSpec], runtime: Runtime | None, image: str | None, secondary: Sequence[Any]
) -> dict[str, dict[str, Value]]:
    """Return the containers of a campaign's runs by name, see `vastflow.sim.model.container.container_of`.

    `image` and `secondary_containers` are containers only where the file names a runtime: else they describe what RoboVAST starts.
    """
    if specs:
        return {name: _content(spec) for name, spec in specs.items()}
    if runtime is None or image is None:
        return {}
    others = {name: own or image for name, own in map(_secondary, secondary)}
    return {name: {"image": each} for name, each in {MAIN: image, **others}.items()}


def _content(spec: ContainerSpec) -> dict[str, Value]:
    content = spec.model_dump(exclude_defaults=True)
    limits = content.pop("resources", {})
    return {**content, **limits}


def _secondary(entry: Any) -> tuple[str, str]:
    """Return name and image, which may be empty, of a container of RoboVAST's: `nav`, `{nav: {…}}`, or `{name: nav, …}`."""
    given: Mapping[str, Any] = entry if isinstance(entry, Mapping) else {str(entry): None}
    name = str(given.get("name") or next(iter(given)))
    inner = given.get(name)
    return name, str({**given, **(inner if isinstance(inner, Mapping) else {})}.get("image") or "")
