"""Cleaning a store: which artifacts campaign directories were made of, and which go."""

import contextlib
import re
import shutil
import time
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

from vastflow.flows.request.campaign_file import read_campaign, recorded_keys
from vastflow.flows.request.run_request import asked_of
from vastflow.flows.results.inputs import replica
from vastflow.oracles.results.schema import table_rows
from vastflow.oracles.results.unusable import reading
from vastflow.producers.floorplan.environment import FOLDER
from vastflow.sim.model.files import read_json
from vastflow.tasks.engine.bundle import STAGE as BUNDLE
from vastflow.tasks.engine.evaluation import FRAGMENTS
from vastflow.tasks.engine.instantiation import EvaluationRequest, Instantiator
from vastflow.tasks.keys.keys import Keys
from vastflow.tasks.keys.source import SourceTree, installed_tree
from vastflow.tasks.store.store import WRITING_S, Holding, Lost, Store, StoreError


@dataclass(frozen=True, slots=True)
class References:
    """Keys of the artifacts behind campaign directories; those of evaluations may be unknown."""

    keys: frozenset[str]
    evaluations: bool


def references(store: Store, directories: Iterable[Path]) -> References:
    """Return the stored artifacts that `directories` were made of.

    Evaluations are told by instantiating again: of one whose code or files are others now there is nothing to keep.

    Raises:
        UnusableDirectory: one of the directories does not say.
    """
    keys: set[str] = set()
    known = True
    tree = installed_tree()
    for directory in directories:
        with reading(directory):
            metadata = read_json(directory / "metadata.json")
            recorded = recorded_keys(metadata)
            rows = table_rows(directory / "configurations.parquet", "checked_digest")
        for scenario in {str(row["checked_digest"]) for row in rows}:
            keys.update(_of_scenario(store, recorded, scenario))
        evaluations = _evaluations(store, recorded, tree, directory, metadata)
        known = known and evaluations is not None
        keys.update(evaluations or ())
    return References(frozenset(keys), known)


def _of_scenario(store: Store, keys: Keys, scenario: str) -> Iterable[str]:
    home = keys.recordings(scenario)
    for name in store.under(home):
        if (recordings := store.find(f"{home}/{name}")) is not None:
            yield recordings.key
            if (trace := store.find(keys.trace(scenario, recordings.content))) is not None:
                yield trace.key
                yield keys.verdicts(scenario, recordings.content, trace.content)


def _evaluations(
    store: Store, keys: Keys, tree: SourceTree, directory: Path, metadata: Mapping[str, Any]
) -> set[str] | None:
    """Return keys of the evaluations of a campaign's producers; None if the campaign can't be read here."""
    keys_asked: set[str] = set()

    def stored(requests: Sequence[EvaluationRequest]) -> Mapping[str, str]:
        keys_asked.update(each.key for request in requests for each in request.evaluations)
        if any(store.find(each.key) is None for request in requests for each in request.evaluations):
            raise Lost
        return {}

    try:
        asked = asked_of(metadata)
        with replica(directory, asked) as laid_out:
            campaign = read_campaign(laid_out.file, laid_out.map_dir, as_v1=asked.as_v1)[0]
            if campaign.search is not None:
                return None  # which points it proposed only its verdicts tell
            Instantiator(campaign, store, keys, tree).instantiated(stored)
    except StoreError:
        raise
    except Lost:
        pass  # what follows from it is not in the store either
    except Exception:  # noqa: BLE001 - inputs that are others now, or a plug-in that raises anything
        return None
    return keys_asked


DAY_S: Final = 24 * 3600.0
_LONGEST_S: Final = 30 * DAY_S
"""Longest campaign on a cluster, whose new workers read bundles until its end."""

_ENVIRONMENT: Final = re.compile(rb"[0-9a-f]{64}")


@dataclass(frozen=True, slots=True)
class Cleaning:
    """Artifacts to remove and to keep, and folders of environments that no artifact names any more, with their size."""

    removed: Sequence[Holding]
    kept: Sequence[Holding]
    environments: Sequence[Path]
    environments_bytes: int


def cleaning(store: Store, referred: References | None, older_than_s: float, now_s: float | None = None) -> Cleaning:
    """Choose the unreferenced artifacts and environments that are old enough to delete.

    Args:
        referred: What stays; None if age alone decides.
        older_than_s: Age from which something goes; below a day it counts as a day, for a campaign may be writing it.
        now_s: The time (s since 1970), the clock's if not given.
    """
    before_s = (time.time() if now_s is None else now_s) - max(older_than_s, WRITING_S)
    removed: list[Holding] = []
    kept: list[Holding] = []
    for holding in store.holdings():
        needed = holding.stage == BUNDLE and holding.written_s > before_s - _LONGEST_S
        stays = needed or (
            referred is not None
            and (
                (holding.stage in ("evaluate", "search") and not referred.evaluations)
                or (holding.whole and holding.key in referred.keys)
            )
        )
        (removed if holding.written_s < before_s and not stays else kept).append(holding)
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
