"""The outcome of a campaign that must not depend on kills: files, artifacts, and flow runs."""

import contextlib
import hashlib
import json
import re
import sqlite3
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

from vastflow.tasks.prefect.orphans import is_orphan
from vastflow.tasks.store.store import Store

FINAL = ("COMPLETED", "FAILED", "CRASHED", "CANCELLED")


@dataclass(frozen=True)
class Whole:
    """The outcome of a campaign: digests of the directory's files by name, and of artifacts by key."""

    files: Mapping[str, str]
    artifacts: Mapping[str, str]


def digests(directory: Path) -> dict[str, str]:
    """Name to digest of a campaign directory's files, without what says when and how it was computed."""
    return {
        path.relative_to(directory).as_posix(): hashlib.sha256(_content(path)).hexdigest()
        for path in sorted(directory.rglob("*"))
        if path.is_file()
        and path.relative_to(directory).parts[0] not in ("events.jsonl", "logs", ".files.json")  # times
    }


def _content(path: Path) -> bytes:
    if path.name == "metadata.json":
        metadata = json.loads(path.read_text())
        counts = metadata["counts"]
        for name in ("executed", "reused", "simulated_s", "cpu_s", "wall_s", "results"):
            del counts[name]
        del metadata["created"]
        metadata.pop("why", None)  # of what this call computed
        metadata.pop("report", None)  # an address in the store, which depends on how runs were cut into blocks
        return json.dumps(metadata, sort_keys=True).encode()
    content = path.read_bytes()
    if path.name == "report.html":
        for pattern, mask in MASKS:
            content = re.sub(pattern, mask, content, flags=re.DOTALL)
    return content


MASKS = ((rb"<!-- work -->.*?<!-- /work -->", b""), (rb"20\d\d-\d\d-\d\d \d\d:\d\d:\d\d", b""))
"""Parts of the report about the call that made it, and their replacements."""


def stored(store: Store) -> dict[str, str]:
    """Key to digest of all of an artifact's files but its sidecars."""
    found = {}
    for holding in store.holdings():
        artifact = store.find(holding.key)
        if artifact is not None and holding.stage != "report":  # its files are those of the campaign directory
            found[holding.key] = artifact.content
    return found


def differing(wanted: Mapping[str, str], found: Mapping[str, str]) -> str:
    """Return what is missing, superfluous, or different."""
    names = sorted(name for name in {*wanted, *found} if wanted.get(name) != found.get(name))
    return f"{len(names)} files differ, {', '.join(names[:4])}" if names else ""


def open_flow_runs(database: Path, with_orphans: bool) -> list[str]:
    """Return name and state of flow runs that are in no final state.

    Args:
        with_orphans: Whether those that the next flow run will mark as crashed count too; a call with nothing left to do
            starts no embedded API, and leaves them.
    """
    if not database.exists():
        return []
    with contextlib.closing(sqlite3.connect(database)) as connection:
        rows = connection.execute("select name, state_type, tags from flow_run").fetchall()
    return [
        f"{name} {state}"
        for name, state, tags in rows
        if state not in FINAL and (with_orphans or not is_orphan(json.loads(tags or "[]")))
    ]
