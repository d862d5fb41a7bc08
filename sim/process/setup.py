"""What programs of a run are given, as a value."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, TypeAlias

from vastflow.sim.digest import FileContent, Value

RunFiles: TypeAlias = tuple[tuple[str, FileContent], ...]
"""Path below the run's folder, with `/`, and what lies there; in the order of the paths."""


@dataclass(frozen=True, slots=True)
class ProcessSetup:
    """What a campaign gives the programs of each of its runs.

    Attributes:
        files: Copied into the run's folders; programs know them below `/config`, and find them where they work.
        environment: Variables beside those of this process, `execution.env`.
        pre_command: Script, perhaps with arguments, that is sourced before, or empty. A relative path is seen from the
            folder that programs work in; so is that of `post_command`.
        post_command: Program, perhaps with arguments, that is started after with `/out` as its last one.
        scenario_folder: Path below `/config` of the folder that has the scenario file; empty for `/config` itself.
    """

    files: RunFiles = ()
    environment: Mapping[str, str] = field(default_factory=dict)
    pre_command: str = ""
    post_command: str = ""
    scenario_folder: str = ""

    @property
    def content(self) -> Value:
        """All of it, as a value; campaign directories of earlier versions have no `scenario_folder`."""
        folder = {"scenario_folder": self.scenario_folder} if self.scenario_folder else {}
        return {
            **folder,
            "files": [list(file) for file in self.files],
            "environment": self.environment,
            "pre_command": self.pre_command,
            "post_command": self.post_command,
        }


def setup_of(content: Mapping[str, Any]) -> ProcessSetup:
    """The setup that has this `content`."""
    return ProcessSetup(**{**content, "files": tuple((path, file) for path, file in content["files"])})
