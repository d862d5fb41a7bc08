"""A kept answer: what a run came to, given again without reading its campaign as long as nothing that it follows from is another.

Reading a campaign to find that nothing is missing takes longer than anything else that is left to do then. So each run whose results
follow from files alone leaves the state of all of them: of vastflow, of the libraries, of what was read, and of the campaign
directory. Where this state is still the same, that directory is the answer; where it is not, and wherever it can't be told, the
campaign is read and its report comes from the store, see `vastflow.flows.results.cached_report`.
"""

import hashlib
import importlib.metadata
import json
import os
import stat
import sys
import time
import uuid
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Final

import psutil

from vastflow.flows.request.run_request import RunRequest
from vastflow.flows.results.summary import Results, Summary
from vastflow.oracles.evidence.rates import Counts
from vastflow.sim.plug_ins.neighbors import PlugInError, neighbors_of
from vastflow.tasks.keys.keys import numeric_class
from vastflow.tasks.store.artifact import inside
from vastflow.tasks.store.store import is_address, store_address, store_root

FOLDER: Final = "answers"
"""In the store, with which they are deleted."""
KEPT: Final = 50

SETTLED_S: Final = 2.0
"""A file that was changed so shortly before may be changed again without another time: file systems count up to two seconds."""

_FORM: Final = 1
_VARIABLES: Final = "VASTFLOW_"
_OWN: Final = "vastflow"


@dataclass(frozen=True, slots=True)
class Basis:
    """What of files a run follows from, beside vastflow and the libraries.

    Attributes:
        read: See `vastflow.flows.results.inputs.Inputs`.
        plug_ins: Files of plug-ins, whose imports lead to others among `read`.
        libraries: Distributions whose versions are in a key or in the campaign directory.
    """

    read: Mapping[str, str | None]
    plug_ins: Sequence[str]
    libraries: Sequence[str]


def keep_answer(request: RunRequest, basis: Basis, results: Results, began_s: float) -> bool:
    """Keep what a run came to, where its results lie on this machine and nothing has changed since it began.

    Args:
        began_s: When it began to read files (s since 1970).

    Returns:
        Whether it was kept; otherwise the next run reads its campaign.
    """
    file = _file(request)
    if file is None or results.faults:
        return False
    process_s = _process_s() - SETTLED_S
    try:
        state, now_s = _state(request, basis), time.time()
        used = {name for names, _ in state["plug_ins"].values() for name in names}
        if state["read"] != basis.read or not used <= basis.read.keys() or not _settled(state["path"], process_s):
            return False
        if not all(_changed_s(os.stat(each)) < process_s for each in _own_files()):
            return False
        there = [each for each, content in basis.read.items() if content is not None]
        if not all(_changed_s(os.stat(each)) < began_s - SETTLED_S for each in there):
            return False
        answer = {
            "form": _FORM,
            "state": state,
            "directory": results.directory.name,
            "files": _listed(results.directory, now_s),
            "counts": results.summary.as_json(),
            "notes": results.notes,
        }
        _write(file, json.dumps(answer, separators=(",", ":")).encode())
    except (OSError, ValueError, PlugInError):  # it costs the next run time, no more
        return False
    return True


def kept_answer(request: RunRequest) -> Results | None:
    """What the last run with this request came to, if everything that it follows from is as it was, and its directory too."""
    began_s, file = time.perf_counter(), _file(request)
    if file is None or (answer := _read(file)) is None:
        return None
    then = answer["state"]
    basis = Basis(then["read"], list(then["plug_ins"]), list(then["libraries"]))
    try:
        directory = inside(_results(request), answer["directory"])
        if _state(request, basis) != then or not _is_whole(directory, answer["files"]):
            return None
    except (OSError, ValueError, PlugInError):
        return None
    counts = answer["counts"]
    oracles = {name: Counts(**each) for name, each in counts["oracles"].items()}
    summary = replace(
        Summary(**{**counts, "oracles": oracles}),
        executed=0,
        reused=counts["executed"] + counts["reused"],
        simulated_s=0.0,
        cpu_s=sum(os.times()[:2]),
        wall_s=time.perf_counter() - began_s,
        results=str(directory),
    )
    return Results(directory, summary, (), tuple(answer["notes"]))


def _process_s() -> float:
    """When this process began, which has imported modules since (s since 1970)."""
    return float(psutil.Process().create_time())


def _file(request: RunRequest) -> Path | None:
    """Where the answer to a request is kept; None where results or store are elsewhere."""
    if is_address(request.results) or store_address(request.store) is not None or request.bundle is not None:
        return None
    asked = json.dumps(_asked(request), sort_keys=True).encode()
    return store_root(request.store) / FOLDER / f"{hashlib.sha256(asked).hexdigest()}.json"


def _asked(request: RunRequest) -> Mapping[str, Any]:
    """The request, whatever folder it is asked in."""
    places = {"campaign": request.campaign, "results": str(_results(request)), "map_dir": request.map_dir}
    whole = {name: place if place is None else os.path.abspath(place) for name, place in places.items()}
    return {**request.model_dump(mode="json"), **whole, "store": str(store_root(request.store))}


def _results(request: RunRequest) -> Path:
    return Path(request.results.removeprefix("file://"))


def _state(request: RunRequest, basis: Basis) -> dict[str, Any]:
    """All that a run's results follow from, as it is now, in JSON values."""
    return {
        "asked": _asked(request),
        "campaign": os.path.realpath(request.campaign),
        "vastflow": _own_content(),
        "python": [sys.version, sys.executable, list(sys.flags)],
        "machine": numeric_class(),
        "variables": {name: os.environ[name] for name in sorted(os.environ) if name.startswith(_VARIABLES)},
        "path": list(_import_path()),
        "libraries": {name: _version(name) for name in basis.libraries},
        "read": {path: _content(path) for path in basis.read},
        "plug_ins": {path: _neighbors(path) for path in basis.plug_ins},
    }


def _own_files() -> Iterator[str]:
    """All files of vastflow, code and data."""
    for root in sys.modules[_OWN].__path__:
        for folder, folders, names in os.walk(root, followlinks=True):
            folders[:] = sorted(name for name in folders if name != "__pycache__")
            yield from (os.path.join(folder, name) for name in sorted(names))


def _own_content() -> str:
    """Digest of all files of vastflow: reading them takes no longer than reading what was known of them."""
    content = hashlib.sha256()
    for path in _own_files():
        content.update(f"{path}\0{_content(path)}\n".encode())
    return content.hexdigest()


def _import_path() -> Iterator[list[Any]]:
    """The folders that modules are looked for in, which change with whatever is installed in them."""
    for entry in sys.path:
        with suppress(FileNotFoundError, NotADirectoryError):
            found = os.stat(entry or ".")
            yield [entry, found.st_mtime_ns, found.st_ctime_ns, found.st_ino]


def _settled(path: Iterable[Sequence[Any]], before_s: float) -> bool:
    return all(max(modified_ns, changed_ns) / 1e9 < before_s for _, modified_ns, changed_ns, _ in path)


def _version(distribution: str) -> str:
    try:
        return importlib.metadata.version(distribution)
    except importlib.metadata.PackageNotFoundError:
        return ""


def _content(path: str) -> str | None:
    """SHA-256 of a file; None where there is none."""
    try:
        with open(path, "rb") as file:
            return hashlib.file_digest(file, "sha256").hexdigest()
    except (FileNotFoundError, NotADirectoryError):
        return None


def _neighbors(plug_in: str) -> list[Any]:
    """Which files a plug-in uses by now, and what it takes from elsewhere."""
    found = neighbors_of(Path(plug_in))
    return [sorted(map(str, {*found.modules, *found.data})), sorted(found.outside)]


def _listed(directory: Path, now_s: float) -> dict[str, list[Any]]:
    """The files of a campaign directory as they are: what tells of a change, and of those not settled yet the content."""
    listed: dict[str, list[Any]] = {}
    for folder, _, names in os.walk(directory):  # pathlib takes three times as long, for ten thousands of files
        below = Path(folder).relative_to(directory).as_posix()
        for name in names:
            found = os.stat(f"{folder}/{name}")
            if stat.S_ISREG(found.st_mode):
                young = _changed_s(found) > now_s - SETTLED_S
                content = _content(f"{folder}/{name}") if young else None
                listed[name if below == "." else f"{below}/{name}"] = [*_stamp(found), content]
    return listed


def _is_whole(directory: Path, files: Mapping[str, Sequence[Any]]) -> bool:
    """Whether a campaign directory has all the files that it had, unchanged; others may have come."""
    for name, (*stamp, content) in files.items():
        path = f"{directory}/{name}"
        if _stamp(os.stat(path)) != stamp or (content is not None and _content(path) != content):
            return False
    return True


def _stamp(found: os.stat_result) -> list[int]:
    """Of these, the time of the last change of the file itself is out of an editor's reach."""
    return [found.st_size, found.st_mtime_ns, found.st_ctime_ns, found.st_ino]


def _changed_s(found: os.stat_result) -> float:
    return max(found.st_mtime_ns, found.st_ctime_ns) / 1e9


def _write(file: Path, body: bytes) -> None:
    file.parent.mkdir(parents=True, exist_ok=True)
    temporary = file.with_name(f".{uuid.uuid4().hex}")
    try:
        temporary.write_bytes(hashlib.sha256(body).hexdigest().encode() + b"\n" + body)
        os.replace(temporary, file)
    finally:
        temporary.unlink(missing_ok=True)
    for old in sorted(file.parent.glob("*.json"), key=lambda each: each.stat().st_mtime)[:-KEPT]:
        old.unlink(missing_ok=True)


def _read(file: Path) -> dict[str, Any] | None:
    """What `_write` wrote; None where it is missing, damaged, or of another version."""
    try:
        hashed, _, body = file.read_bytes().partition(b"\n")
    except OSError:
        return None
    if hashlib.sha256(body).hexdigest().encode() != hashed:
        return None
    answer: dict[str, Any] = json.loads(body)
    return answer if answer["form"] == _FORM else None
