"""What programs of a run are given, as a value."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, TypeAlias

from vastflow.sim.digest import FileContent, Value

RunFiles: TypeAlias = tuple[tuple[str, FileContent], ...]
"""Path below the run's folder, with `/`, and what lies there; in the order of the paths."""


@dataclass(frozen=True, slots=True)
class ProcessSetup:
    """What a campaign gives the programs of each of its runs.

    Attributes:
        base: The campaign file's folder.
        files: Copied into the run's folder.
        environment: Variables beside those of this process, `execution.env`.
        pre_command: Script that is sourced before, or empty. A relative path is seen from the run's folder or, where
            there is no such file, from `base`; so is that of `post_command`.
        post_command: Program, perhaps with arguments, that is started after with the run's folder as its last one.
    """

    base: Path
    files: RunFiles = ()
    environment: Mapping[str, str] = field(default_factory=dict)
    pre_command: str = ""
    post_command: str = ""

    @property
    def content(self) -> Value:
        """What counts of it: all but where it lies."""
        return {
            "files": [list(file) for file in self.files],
            "environment": self.environment,
            "pre_command": self.pre_command,
            "post_command": self.post_command,
        }


def setup_of(content: Mapping[str, Any], base: Path) -> ProcessSetup:
    """The setup that has this `content`."""
    files = tuple((path, file) for path, file in content["files"])
    return ProcessSetup(base, files, content["environment"], content["pre_command"], content["post_command"])
