"""Cleaning a store: which artifacts campaign directories were made of, and which go."""

import contextlib
import re
import shutil
import time
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from vastflow.flows.request.campaign_file import recorded_keys
from vastflow.oracles.results.schema import table_rows
from vastflow.oracles.results.unusable import reading
from vastflow.producers.floorplan.environment import FOLDER
from vastflow.sim.model.files import read_json
from vastflow.tasks.engine.bundle import STAGE as BUNDLE
from vastflow.tasks.engine.evaluation import FRAGMENTS
from vastflow.tasks.keys.keys import Keys
from vastflow.tasks.store.store import WRITING_S, Holding, Lost, Store


def references(store: Store, directories: Iterable[Path]) -> frozenset[str]:
    """Return the keys of the stored recordings, traces, and verdicts that `directories` were made of.

    Raises:
        UnusableDirectory: one of the directories does not say.
    """
    keys: set[str] = set()
    for directory in directories:
        with reading(directory):
            recorded = recorded_keys(read_json(directory / "metadata.json"))
            rows = table_rows(directory / "configurations.parquet", "checked_digest")
        for scenario in {str(row["checked_digest"]) for row in rows}:
            keys.update(_of_scenario(store, recorded, scenario))
    return frozenset(keys)


def _of_scenario(store: Store, keys: Keys, scenario: str) -> Iterable[str]:
    home = keys.recordings(scenario)
    for name in store.under(home):
        if (recordings := store.find(f"{home}/{name}")) is not None:
            yield recordings.key
            if (trace := store.find(keys.trace(scenario, recordings.content))) is not None:
                yield trace.key
                yield keys.verdicts(scenario, recordings.content, trace.content)


DAY_S: Final = 24 * 3600.0
_LONGEST_S: Final = 30 * DAY_S
"""Longest campaign on a cluster, whose new workers read bundles until its end."""

_SMALL: Final = ("evaluate", "search", "report")
"""Stages whose artifacts only age removes: which of them a campaign used is not worth another instantiation."""
_ENVIRONMENT: Final = re.compile(rb"[0-9a-f]{64}")


@dataclass(frozen=True, slots=True)
class Cleaning:
    """Artifacts to remove and to keep, and folders of environments that no artifact names any more, with their size."""

    removed: Sequence[Holding]
    kept: Sequence[Holding]
    environments: Sequence[Path]
    environments_bytes: int


def cleaning(
    store: Store, referred: frozenset[str] | None, older_than_s: float, now_s: float | None = None
) -> Cleaning:
    """Choose the unreferenced artifacts and environments that are old enough to delete.

    Args:
        referred: Keys of the artifacts to keep; None if age alone decides.
        older_than_s: Age from which something goes; below a day it counts as a day, for a campaign may be writing it.
        now_s: The time (s since 1970), the clock's if not given.
    """
    before_s = (time.time() if now_s is None else now_s) - max(older_than_s, WRITING_S)
    removed: list[Holding] = []
    kept: list[Holding] = []
    for holding in store.holdings():
        needed = holding.stage == BUNDLE and holding.written_s > before_s - _LONGEST_S
        stays = referred is not None and (holding.stage in _SMALL or (holding.whole and holding.key in referred))
        (removed if holding.written_s < before_s and not (needed or stays) else kept).append(holding)
    environments = _unnamed_environments(store, kept, before_s)
    return Cleaning(removed, kept, environments, sum(map(folder_bytes, environments)))


def clean(store: Store, chosen: Cleaning) -> None:
    """Remove the chosen artifacts and environments."""
    store.remove(holding.key for holding in chosen.removed)
    for folder in chosen.environments:
        shutil.rmtree(folder, ignore_errors=True)


def folder_bytes(folder: Path) -> int:
    """Size of all files below a folder."""
    size = 0
    for file in folder.rglob("*"):
        with contextlib.suppress(OSError):  # deleted meanwhile
            size += file.stat().st_size if file.is_file() else 0
    return size


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
