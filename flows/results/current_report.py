"""The current report: one digest of a campaign directory's inputs, and whether it exists intact."""

import hashlib
import importlib.metadata
import inspect
import json
import os
from collections.abc import Mapping, Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any, Final

from vastflow.flows.results.directory import directory_name
from vastflow.flows.results.inputs import Inputs
from vastflow.oracles.judgment.oracle import Oracle
from vastflow.sim.model.digest import file_digest
from vastflow.sim.model.files import read_json
from vastflow.tasks.keys.keys import Keys
from vastflow.tasks.keys.source import folders_of

KEY: Final = "report"
"""Key of `metadata.json` with the digest, see `report_key`."""

_FILES: Final = ".files.json"
"""File of a campaign directory that lists its files as the run left them."""
_PACKAGES: Final = ("vastflow.flows", "vastflow.oracles", "vastflow.producers", "vastflow.sim", "vastflow.tasks")
_WRITTEN_BY: Final = frozenset({".css", ".j2", ".js", ".py"})
_OF_A_CALL: Final = frozenset({"created", "host"})
REPORT_LIBRARIES: Final = ("imageio-ffmpeg", "jinja2", "markupsafe", "matplotlib", "pillow")


def written_by() -> tuple[Path, ...]:
    """Folders with the code and the templates that make tables and reports."""
    return tuple(folders_of(_PACKAGES).values())


def report_key(
    keys: Keys, inputs: Inputs, metadata: Mapping[str, Any], oracles: Sequence[Oracle[Any]], place: str
) -> str:
    """Digest of all that the campaign directory of a campaign without faults follows from, known before anything is computed.

    Args:
        metadata: Content of `metadata.json` before the runs, ingredients included.
        oracles: Oracles that judge, in order. The report has their docstrings, which are in no digest of their code.
        place: The store's: another one is to be filled.
    """
    hashed = hashlib.sha256()
    same = {name: value for name, value in metadata.items() if name not in _OF_A_CALL}
    files = {name: hashlib.sha256(content).hexdigest() for name, content in inputs.files.items()}
    libraries = {name: importlib.metadata.version(name) for name in REPORT_LIBRARIES}
    said = [[oracle.name, inspect.getdoc(type(oracle))] for oracle in oracles]
    campaign = hashlib.sha256(inputs.campaign).hexdigest()
    for part in (keys.identity, same, libraries, campaign, files, said, place, source_digest()):
        hashed.update(json.dumps(part).encode() + b"\n")
    return hashed.hexdigest()


def source_digest() -> str:
    """Digest of the code and the templates that make tables and reports, as they are on disk."""
    hashed = hashlib.sha256()
    for folder in written_by():
        for file in sorted(file for file in folder.rglob("*") if file.suffix in _WRITTEN_BY):
            hashed.update(f"{file.relative_to(folder)} {file_digest(file)}\n".encode())
    return hashed.hexdigest()


def drawing_digest() -> str:
    """Digest of all that figures follow from beside their content."""
    libraries = [importlib.metadata.version(name) for name in (*REPORT_LIBRARIES, "numpy", "scipy", "shapely")]
    return hashlib.sha256(json.dumps([source_digest(), libraries]).encode()).hexdigest()


def seal(directory: Path) -> None:
    """Record sizes and times of a finished campaign directory's files; without them the next run writes its own."""
    with suppress(OSError):
        (directory / _FILES).write_text(json.dumps(_states(directory), separators=(",", ":")), encoding="utf-8")


def newest(root: Path, name: str) -> Path | None:
    """Return the newest directory of a campaign."""
    return max(root.glob(f"{directory_name(name)}-????-??-??-??????*"), default=None)


def newest_sealed(root: Path, name: str, key: str) -> Path | None:
    """Return the newest directory of a campaign if it has this report and none of its files changed."""
    directory = newest(root, name)
    try:
        if directory is None or read_json(directory / "metadata.json").get(KEY) != key:
            return None
        return directory if read_json(directory / _FILES).items() <= _states(directory).items() else None
    except (OSError, ValueError, AttributeError):
        return None


def _states(directory: Path) -> dict[str, list[int]]:
    states = {}
    for folder, _, names in os.walk(directory):  # pathlib takes three times as long, for ten thousands of files
        for name in names:
            found = os.stat(f"{folder}/{name}")
            states[f"{folder}/{name}"[len(f"{directory}/") :]] = [found.st_size, found.st_mtime_ns, found.st_ctime_ns]
    states.pop(_FILES, None)
    return states
