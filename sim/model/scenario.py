"""The scenario: all inputs of an execution."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any, Literal, TypeAlias

from vastflow.sim.model.digest import FileContent, Texts, Value, canonical, digest, text_digest
from vastflow.sim.model.nodes import Nodes, nodes_of
from vastflow.sim.model.pose import Pose

MissionKind: TypeAlias = Literal["navigate_to_pose", "navigate_through_poses", "follow_waypoints"]


@dataclass(frozen=True, slots=True)
class Mission:
    """A Nav2 action and its arguments.

    Attributes:
        goals: Goals in order; one for `navigate_to_pose`.
        loops: Repetitions of `follow_waypoints` after the first round (Nav2's `number_of_loops`).
    """

    kind: MissionKind
    goals: tuple[Pose, ...]
    loops: int = 0


RunFiles: TypeAlias = tuple[tuple[str, FileContent], ...]
"""Path below the run's folder, with `/`, and content, in the order of the paths."""


@dataclass(frozen=True, slots=True)
class ProcessSetup:
    """Setup of the programs of a campaign's runs.

    Attributes:
        files: Files copied into the run's folders, as `/config` to programs.
        environment: Variables beside those of this process, `execution.env`.
        pre_command: Script with arguments that is sourced before, or empty. Relative paths start at the programs' working folder.
        post_command: Program with arguments that is started after, with `/out` as its last one.
        scenario_folder: Folder of the scenario file below `/config`; empty for `/config` itself.
        containers: Name to description, see `vastflow.sim.model.container.container_of`.
        container_runtime: Name of what runs them; empty for the first that works.
        nodes: Nodes that drive the robot; None where the built-in stack does.
        config_files: Name to path below `/config` of each file with parameters `sut.NAME.PATH`.
        parameters: Path of a file below `/config` to a configuration's values by their paths in it.
    """

    files: RunFiles = ()
    environment: Mapping[str, str] = field(default_factory=dict)
    pre_command: str = ""
    post_command: str = ""
    scenario_folder: str = ""
    containers: Mapping[str, Mapping[str, Any]] = field(default_factory=dict)
    container_runtime: str = ""
    nodes: Nodes | None = None
    config_files: Mapping[str, str] = field(default_factory=dict)
    parameters: Mapping[str, Mapping[str, Value]] = field(default_factory=dict)

    @property
    def content(self) -> Value:
        """The setup as a value; campaign directories of earlier versions lack the later fields."""
        names = ("scenario_folder", "containers", "container_runtime", "config_files", "parameters")
        later = {name: getattr(self, name) for name in names}
        return {
            **{name: value for name, value in later.items() if value},
            **({} if self.nodes is None else {"nodes": self.nodes.content}),
            "files": [list(file) for file in self.files],
            "environment": self.environment,
            "pre_command": self.pre_command,
            "post_command": self.post_command,
        }


def setup_of(content: Mapping[str, Any]) -> ProcessSetup:
    """Return the setup with this `content`."""
    nodes = content.get("nodes")
    return ProcessSetup(
        **{
            **content,
            "files": tuple((path, file) for path, file in content["files"]),
            "nodes": None if nodes is None else nodes_of(nodes),
        }
    )


Dimension: TypeAlias = Literal["environment", "task", "system"]

DIMENSION_OF_KEY: Mapping[str, Dimension] = {
    "map_file": "environment",
    "mesh_file": "environment",
    "world": "environment",
    "movers": "environment",
    "spawn_trigger_point": "environment",
    "spawn_trigger_threshold": "environment",
    "start_pose": "task",
    "goal_pose": "task",
    "goal_poses": "task",
    "number_of_loops": "task",
    "reference_length": "task",
}
"""Dimension of a key without a tag; all other keys are the system's."""


@dataclass(frozen=True)
class Scenario:
    """A concrete scenario c: a point of the test space, in its three dimensions.

    Attributes:
        abstract: The abstract scenario a: `builtin:` and a name of `vastflow.sim.reading.abstract.SHIPPED`, or an OpenSCENARIO file.
        timeout_s: Simulated time after which a run ends as timed out.
        environment: d_E: the map (`map_file`, a `FileContent`) and lists of obstacles, whatever their key.
        task: d_T: start, goals, loops.
        system: d_S: robot and navigation parameters, scan noise and dropout, everything else.
        programs: Setup of programs; None where the scenario starts none.
    """

    abstract: str | FileContent
    timeout_s: float
    environment: Mapping[str, Value]
    task: Mapping[str, Value]
    system: Mapping[str, Value]
    programs: ProcessSetup | None = None

    @cached_property
    def digest(self) -> str:
        """Digest of the whole content, without names and provenance of a configuration."""
        return digest(self.abstract, self.timeout_s, self.environment, self.task, self.system, *self._programs())

    def digested(self, texts: Texts) -> str:
        """Return `digest` from texts that scenarios of the same values share."""
        if "digest" not in self.__dict__:
            situation = ",".join(texts.of_map(part) for part in (self.environment, self.task))
            programs = "".join(f",{canonical(value)}" for value in self._programs())
            text = f"[{canonical(self.abstract)},{canonical(self.timeout_s)},{situation},{texts.of_map(self.system)}{programs}]"
            # Where the cached properties look first.
            self.__dict__.update(digest=text_digest(text), situation_digest=text_digest(f"[{situation}]"))
        return self.digest

    def _programs(self) -> list[Value]:
        return [] if self.programs is None else [self.programs.content]

    @cached_property
    def situation_digest(self) -> str:
        """Digest of environment and task, which seeds a run: two systems meet the same noise."""
        return digest(self.environment, self.task)


def scenario_of(
    values: Mapping[str, Value],
    dimensions: Mapping[str, Dimension],
    *,
    abstract: str | FileContent,
    timeout_s: float,
    programs: ProcessSetup | None = None,
) -> Scenario:
    """Sort flat configuration values into the three dimensions.

    Args:
        values: Key to value; keys with a leading `_` are provenance and are left out.
        dimensions: Tags given by producers or the file; `DIMENSION_OF_KEY` and then `system` otherwise.
    """
    parts: dict[Dimension, dict[str, Value]] = {"environment": {}, "task": {}, "system": {}}
    for key, value in values.items():
        if not key.startswith("_"):
            parts[dimensions.get(key) or DIMENSION_OF_KEY.get(key, "system")][key] = value
    return Scenario(abstract, timeout_s, parts["environment"], parts["task"], parts["system"], programs)
