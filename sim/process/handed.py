"""Files of a configuration that a scenario hands to its programs, such as the map: copies under names that follow from content."""

import shutil
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import yaml

from vastflow.sim.digest import FileContent
from vastflow.sim.files import Unreadable, read_text, yaml_value
from vastflow.sim.process.folder import RunFileError
from vastflow.sim.reading.map_file import load_map


def handed_name(key: str, content: FileContent) -> str:
    """What a scenario has for the file under `key`: its path below `/config`, and seen from where programs work."""
    suffix = Path(content.path).suffix.lower()
    return f"{key}/{content.digest[:12]}{'.yaml' if suffix == '.yml' else suffix}"


def hand_over(handed: Mapping[str, FileContent], folder: Path) -> None:
    """Copy the files by key below `folder`, a map with its picture.

    Raises:
        RunFileError: one is gone, or a map holds something else than when the campaign was read.
    """
    for key, content in handed.items():
        source, target = Path(content.path), folder / handed_name(key, content)
        target.parent.mkdir(parents=True, exist_ok=True)
        try:
            header = _map_header(source)
            if header is None:
                shutil.copyfile(source, target)
                continue
            picture = source.parent / header["image"]
            copied = target.with_suffix(picture.suffix)
            shutil.copyfile(picture, copied)
            target.write_text(yaml.safe_dump({**header, "image": copied.name}), encoding="utf-8")
            is_same = load_map(target).digest == content.digest
        except (OSError, ValueError) as error:
            raise RunFileError(f"{key}: {content.path!r} can't be copied: {error}") from None
        if not is_same:
            raise RunFileError(f"{key}: {content.path!r} changed since the campaign was read; run it again")


def _map_header(source: Path) -> dict[str, Any] | None:
    """What the YAML file of a map holds; None for another file."""
    if source.suffix.lower() not in (".yaml", ".yml"):
        return None
    try:
        header = yaml_value(read_text(source))
    except Unreadable as error:
        raise RunFileError(f"{str(source)!r}: {error}") from None
    return header if isinstance(header, dict) and isinstance(header.get("image"), str) else None
