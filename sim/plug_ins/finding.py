"""Finding plug-ins: by their name in a group of entry points, or by file and class beside a campaign file."""

import functools
from importlib.metadata import EntryPoint, entry_points
from pathlib import Path
from typing import Any

from vastflow.sim.files import is_file
from vastflow.sim.plug_ins.loading import module_of
from vastflow.sim.plug_ins.snapshot import snapshot_of


@functools.cache
def _installed(group: str) -> tuple[EntryPoint, ...]:
    """Entry points of a group; to look through all distributions takes 10 ms, and a campaign may name many plug-ins."""
    return tuple(entry_points(group=group))


def known_plug_ins(group: str) -> tuple[str, ...]:
    """Names in a group of entry points, sorted."""
    return tuple(sorted({entry.name for entry in _installed(group)}))


def installed_plug_in(group: str, name: str) -> Any | None:
    """What an entry point of this name loads; None where there is none."""
    found = next((entry for entry in _installed(group) if entry.name == name), None)
    return None if found is None else found.load()


def plug_in_of_file(name: str, base: Path) -> Any | None:
    """What `file.py:Class`, relative to `base`, names; None where there is no such file or class.

    Raises:
        PlugInError: what the file uses can't be taken; and whatever its code raises.
    """
    file, _, class_name = name.rpartition(":")
    return getattr(module_of(snapshot_of(base / file, base)), class_name, None) if is_file(base / file) else None
