"""Campaign directories that are not whole yet: where they are, who writes them, and how they are stopped."""

import json
import os
import platform
import re
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Final

import psutil

from vastflow.oracles.results.unusable import DAMAGE
from vastflow.sim.model.faults import UserError
from vastflow.sim.model.files import read_json, replace_file

RUNNING: Final = ".{}.running"
"""Name of the folder while a campaign is computed; the directory takes it over."""
PARTIAL: Final = ".{}.partial"
"""Name of the folder while tables and report are written."""
WRITER: Final = ".writer.json"
"""File in an unfinished directory that names the writing process."""
STOP: Final = "stop.json"
"""File in an unfinished directory that asks its process to stop, with a reason."""
BEAT_S: Final = 10.0
"""Time between two signs of life of a writing process, which are the times of its folder."""

_QUIET_S: Final = 6 * BEAT_S
_OURS: Final = re.compile(r"\.(.+-\d{4}-\d\d-\d\d-\d{6}(?:-\d+)?)\.(?:partial|running)")
_MOST_REASON: Final = 500


def final_of(place: Path) -> Path:
    """Return the path that a campaign directory has once it is whole."""
    named = _OURS.fullmatch(place.name)
    return place if named is None else place.with_name(named[1])


def place_of(directory: Path) -> Path | None:
    """Return where a campaign directory is by now, whole or not; None without one."""
    final = final_of(directory)
    hidden = (final.with_name(each.format(final.name)) for each in (RUNNING, PARTIAL))
    # The whole one last: a folder that is renamed meanwhile is found under its next name.
    return next((place for place in (*hidden, final) if place.is_dir()), None)


def unfinished(root: Path) -> Iterator[Path]:
    """Yield the folders of campaign directories in `root` that are not whole, running or left behind."""
    for pattern in (RUNNING, PARTIAL):
        yield from (place for place in root.glob(pattern.format("*")) if _OURS.fullmatch(place.name) and place.is_dir())


def writer() -> dict[str, object]:
    """Return what names this process in `WRITER`."""
    return {"host": platform.node(), "pid": os.getpid(), "began_s": _began_s(os.getpid())}


def writer_of(place: Path) -> int | None:
    """Return the id of the live process on this host that is writing a directory.

    On a file system that hosts share, the process of another host counts as gone.
    """
    try:
        named = read_json(place / WRITER)
        alive = named["host"] == platform.node() and _began_s(named["pid"]) == named["began_s"]
        return int(named["pid"]) if alive else None
    except DAMAGE:
        return None


def is_running(place: Path) -> bool:
    """True if an unfinished directory is being written: by a process here, or on another host with signs of life."""
    try:
        if read_json(place / WRITER)["host"] == platform.node():
            return writer_of(place) is not None
        return time.time() - place.stat().st_mtime < _QUIET_S
    except DAMAGE:
        return False


def ask_to_stop(directory: str | Path, reason: str) -> None:
    """Ask the process of a running campaign to stop as after Ctrl-C; it hears within a second or two.

    Args:
        reason: Shown as why the campaign ended.

    Raises:
        UserError: it is not running, or its folder can't be written.
    """
    place = place_of(Path(directory))
    if place is None or not is_running(place):
        raise UserError(f"{directory}: expected a running campaign, got one that has ended")
    try:
        replace_file(place / STOP, json.dumps({"reason": " ".join(reason.split())[:_MOST_REASON]}).encode())
    except OSError as error:
        raise UserError(
            f"{place}: can't be written ({error.strerror}), so the campaign can't be stopped there"
        ) from None


def stop_reason(place: Path) -> str | None:
    """Return the reason why a campaign is asked to stop; None if it is not."""
    try:
        return str(read_json(place / STOP)["reason"]) or "no reason given"
    except FileNotFoundError:
        return None
    except DAMAGE:
        return "no reason given"


def _began_s(pid: int) -> float | None:
    """Return the start time of a process, which identifies it with its id; None without a process."""
    try:
        return psutil.Process(pid).create_time()
    except psutil.Error:
        return None
