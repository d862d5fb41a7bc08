"""Cleaning a store: what of it goes, and what goes with it."""

import contextlib
import re
import shutil
import time
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from vastflow.flows.results.references import References
from vastflow.producers.floorplan.environment import FOLDER
from vastflow.tasks.evaluation import FRAGMENTS
from vastflow.tasks.store import WRITING_S, Holding, Lost, Store

DAY_S: Final = 24 * 3600.0

_ENVIRONMENT: Final = re.compile(rb"[0-9a-f]{64}")


@dataclass(frozen=True, slots=True)
class Cleaning:
    """What goes and what stays.

    Attributes:
        removed, kept: Artifacts, and what was left unfinished.
        environments: Folders of environments that no artifact names any more.
        environments_bytes: Their size.
    """

    removed: tuple[Holding, ...]
    kept: tuple[Holding, ...]
    environments: tuple[Path, ...]
    environments_bytes: int


def cleaning(store: Store, referred: References | None, older_than_s: float, now_s: float | None = None) -> Cleaning:
    """Choose what goes: what nobody refers to and is old enough.

    Args:
        referred: What stays; None if age alone decides.
        older_than_s: Age from which something goes; below a day it counts as a day, for a campaign may be writing it.
        now_s: The time (s since 1970), the clock's if not given.
    """
    before_s = (time.time() if now_s is None else now_s) - max(older_than_s, WRITING_S)
    removed: list[Holding] = []
    kept: list[Holding] = []
    for holding in store.holdings():
        goes = holding.written_s < before_s and not (referred and _is_referred(holding, referred))
        (removed if goes else kept).append(holding)
    environments = _unnamed_environments(store, kept, before_s)
    size = sum(folder_bytes(folder) for folder in environments)
    return Cleaning(tuple(removed), tuple(kept), tuple(environments), size)


def clean(store: Store, chosen: Cleaning) -> None:
    """Remove what was chosen, and the folder in which flow runs of earlier versions kept files while they ran."""
    store.remove(holding.key for holding in chosen.removed)
    for folder in (*chosen.environments, store.local / "parcels"):
        shutil.rmtree(folder, ignore_errors=True)


def folder_bytes(folder: Path) -> int:
    """Size of all files below a folder."""
    size = 0
    for file in folder.rglob("*"):
        with contextlib.suppress(OSError):  # deleted meanwhile
            size += file.stat().st_size if file.is_file() else 0
    return size


def _is_referred(holding: Holding, referred: References) -> bool:
    if holding.stage in ("evaluate", "search") and not referred.evaluations:
        return True
    return holding.whole and holding.key in referred.keys


def _unnamed_environments(store: Store, kept: Iterable[Holding], before_s: float) -> list[Path]:
    try:
        folders = [entry for entry in (store.local / FOLDER).iterdir() if entry.stat().st_mtime < before_s]
    except OSError:
        return []
    named: set[bytes] = set()
    for holding in kept if folders else ():
        if holding.stage == "evaluate" and holding.whole:
            with contextlib.suppress(Lost):
                named.update(_ENVIRONMENT.findall(store.read(holding.key, FRAGMENTS)))
    return [folder for folder in folders if folder.name.encode() not in named]
