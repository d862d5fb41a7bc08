"""What programs of a run are given, as a value."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import TypeAlias

from vastflow.sim.digest import FileContent

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
