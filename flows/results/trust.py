"""Code of others: what executing a campaign directory executes, and whether this user made or permitted it.

Nothing in a directory counts as proof. Records lie in the user's state folder, under the digest of all that would be executed.
"""

import hashlib
import json
import os
import stat
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager, nullcontext, suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Final

import platformdirs

from vastflow.oracles.results.schema import table_rows
from vastflow.oracles.results.unusable import reading
from vastflow.producers.campaign_file.postprocessing import RECORDED, UNTOUCHED
from vastflow.sim.model.digest import digest, file_digest
from vastflow.sim.model.faults import UserError
from vastflow.sim.model.files import (
    MOST_TEXT_BYTES,
    Unreadable,
    json_value,
    read_bytes,
    read_json,
    read_text,
    replace_file,
    yaml_value,
)
from vastflow.sim.plug_ins.loading import code_from, is_limited
from vastflow.sim.scenario.programs.actions import PROCESSES

_CAMPAIGN: Final = "campaign.vast"
_ROWS: Final = "configurations.parquet"
_INPUTS: Final = "inputs"
_EXECUTED: Final = (_CAMPAIGN, "metadata.json", _ROWS, _INPUTS, "environments")
"""Files and folders of a campaign directory that an execution reads beside recordings."""
_DATA: Final = frozenset(
    {
        *(".yaml", ".yml", ".pgm", ".png", ".bmp", ".json", ".csv", ".osc", ".vast"),
        *(".fpm", ".fpm2", ".variation", ".stl", ".npy"),
    }
)
_PERMITTED: Final = "permitted"
_RUNNING: Final = "running"
_SHOWN: Final = 8


@dataclass(frozen=True, slots=True)
class ForeignCode:
    """Code that an execution of a campaign directory may execute.

    Attributes:
        named: Plug-ins, notebooks, scripts, and programs; empty where the directory has nothing but data.
        digest: Digest of everything that decides what is executed.
        contents: SHA-256 of the campaign file and each file in `inputs/`, and the digests that its scenarios have.
    """

    directory: str
    named: tuple[str, ...] = ()
    digest: str = ""
    contents: frozenset[str] = field(default=frozenset(), repr=False)

    def __str__(self) -> str:
        more = f", and {len(self.named) - _SHOWN} more" if len(self.named) > _SHOWN else ""
        listed = ", ".join(self.named[:_SHOWN]) + more
        return f"{self.directory} would execute code that you neither made nor permitted: {listed} (digest {self.digest[:12]})"


class NotPermitted(UserError):
    """Code of others that the user has not permitted."""

    def __init__(self, code: ForeignCode) -> None:
        super().__init__(f"{code}. Permit it by --trust.")
        self.code = code

    def __reduce__(self) -> tuple[Any, ...]:
        return NotPermitted, (self.code,)


def foreign_code(directory: Path) -> ForeignCode:
    """Return what executing a campaign directory may execute; raises `UnusableDirectory` for links, pipes, and damage."""
    with reading(directory):
        files = [each for name in _EXECUTED for each in _files(directory / name)]
        places = {path.relative_to(directory).as_posix(): path for path in files}
        inputs = {place: path for place, path in places.items() if place.startswith(f"{_INPUTS}/")}
        named = [place for place, path in inputs.items() if _is_code(path)]
        rows = table_rows(places[_ROWS], "scenario", "scenario_digest") if _ROWS in places else []
        named += _programs(directory, rows)
        known = {
            place: file_digest(path)
            for place, path in (places if named else {_CAMPAIGN: directory / _CAMPAIGN, **inputs}).items()
        }
        contents = {known[place] for place in (_CAMPAIGN, *inputs)} | {str(row["scenario_digest"]) for row in rows}
        return ForeignCode(str(directory), tuple(named), digest("executed", known), frozenset(contents))


def _files(place: Path) -> Iterator[Path]:
    try:
        mode = os.lstat(place).st_mode
    except FileNotFoundError:
        return
    if stat.S_ISDIR(mode):
        for name in sorted(os.listdir(place)):
            yield from _files(place / name)
    elif stat.S_ISREG(mode):
        yield place
    else:
        raise ValueError(f"{place.name}: expected a file or a folder, got a link, a pipe, or a device")


def _is_code(path: Path) -> bool:
    """Whether a file may be executed, or starts programs as a scenario."""
    if path.suffix not in _DATA:
        return True
    if path.stat().st_size > MOST_TEXT_BYTES:  # which nothing reads as a scenario
        return False
    content = read_bytes(path)
    return any(name.encode() in content for name in PROCESSES)


def _programs(directory: Path, rows: Iterable[Mapping[str, Any]]) -> Iterator[str]:
    """Name commands of the campaign file, and programs of its scenarios."""
    try:
        campaign = yaml_value(read_text(directory / _CAMPAIGN))
    except Unreadable as error:
        raise type(error)(f"{_CAMPAIGN}: {error.problem}", "a whole campaign directory", error.place) from None
    execution = campaign.get("execution") or {}
    for name in ("pre_command", "post_command"):
        if execution.get(name):
            yield f"{name} {str(execution[name])[:100]!r}"
    for name, given in (each for entry in execution.get("nodes") or () for each in entry.items()):
        yield f"node {name!r} by {str(given.get('command'))[:100]!r}"
    for name, given in (execution.get("containers") or {}).items():
        seen = filter(os.path.isabs, (str(each.get("source")) for each in given.get("mounts") or ()))
        sees = "".join(f", which sees {place!r}" for place in seen)
        yield f"container {name!r} of {given.get('image') or given.get('rootfs')!r}{sees}"
    for step in (campaign.get("results_processing") or {}).get("postprocessing") or ():
        yield from (f"postprocessing by {name}" for name in step if name not in {*RECORDED, *UNTOUCHED})
    if any(json_value(row["scenario"]).get("programs") for row in rows):
        yield "programs of its scenarios"


def permitted_contents(directory: Path, consent: str | None = None) -> frozenset[str]:
    """Return the digests of what may be executed for a directory, see `ForeignCode`.

    Args:
        consent: Digest of the code that the user permits now, and from now on; empty for whatever it is.

    Raises:
        NotPermitted: there is code that the user neither made nor permitted.
    """
    code = foreign_code(directory)
    if code.named and _recorded(_PERMITTED, code.digest) is None:
        if consent not in ("", code.digest):
            raise NotPermitted(code)
        _remember(_PERMITTED, code.digest, {"permitted": code.directory})
    return code.contents


@contextmanager
def executing(directory: Path, consent: str | None = None) -> Iterator[None]:
    """Let the body execute code that the user made or permits; raises as `permitted_contents`.

    Whatever executes a campaign directory again does so in such a body; inside another one, that one's permission counts.
    """
    with nullcontext() if is_limited() else code_from(permitted_contents(directory, consent)):
        yield


def remember_made(directory: Path) -> None:
    """Record that this user made a campaign directory, so that executing it again asks nothing."""
    with suppress(UserError):
        if (code := foreign_code(directory)).named:
            _remember(_PERMITTED, code.digest, {"made": code.directory})


def remember_running(directory: Path, began: Mapping[str, Any] | None) -> None:
    """Record how this user began the campaign of a directory; None when it has ended."""
    _remember(_RUNNING, _name_of(directory), began)


def running_as(directory: Path) -> Mapping[str, Any] | None:
    """Return how this user began the campaign of a directory; None if another did."""
    found = _recorded(_RUNNING, _name_of(directory))
    return found if isinstance(found, dict) else None


def _name_of(directory: Path) -> str:
    return hashlib.sha256(os.fsencode(directory.resolve())).hexdigest()


def _state() -> Path:
    return platformdirs.user_state_path("vastflow")


def _is_private(folder: Path) -> bool:
    """Whether a folder is this user's, and nobody else can write or read what is in it."""
    with suppress(OSError):
        status = os.lstat(folder)
        return stat.S_ISDIR(status.st_mode) and status.st_uid == os.getuid() and not status.st_mode & 0o077
    return False


def _recorded(kind: str, name: str) -> Any:
    """Return the content of a record; None without one that this user alone can have made."""
    folder = _state() / kind
    with suppress(Unreadable):
        return read_json(folder / name) if _is_private(folder) else None
    return None


def _remember(kind: str, name: str, content: Mapping[str, Any] | None) -> None:
    """Write or remove a record; without one the user is asked again."""
    folder = _state() / kind
    with suppress(OSError):
        folder.mkdir(mode=0o700, parents=True, exist_ok=True)
        if content is None:
            (folder / name).unlink(missing_ok=True)
        elif _is_private(folder):
            replace_file(folder / name, json.dumps(content).encode())
