"""Which files have to go along with one that a scenario names."""

import os
from pathlib import Path
from typing import Final

from vastflow.sim.model.files import Unreadable, read_text, yaml_value
from vastflow.sim.scenario.language.reading import files_of

_SCENARIO: Final = ".osc"
_HEADERS: Final = (".yaml", ".yml")


def needed_files(path: Path) -> tuple[Path, ...]:
    """A file and those it names: a map's picture, what a scenario file imports.

    One that is named from the root of the file system is not among them: it means the worker's own file.
    """
    if path.suffix == _SCENARIO:
        return tuple(_normal(file) for file in files_of(path))
    if path.suffix in _HEADERS and (picture := _picture(path)) is not None:
        return path, picture
    return (path,)


def _picture(path: Path) -> Path | None:
    """The picture of a map's header; None if the file is something else."""
    try:
        content = yaml_value(read_text(path))
    except Unreadable:
        return None
    if not isinstance(content, dict) or not {"image", "resolution", "origin"} <= content.keys():
        return None
    image = Path(str(content["image"]))
    return None if image.is_absolute() else _normal(path.parent / image)


def _normal(path: Path) -> Path:
    return Path(os.path.abspath(path))
