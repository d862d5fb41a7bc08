"""The watch: no file of a plug-in's or the campaign's folder is read unnoticed while a plug-in's code runs.

What it reads and has not declared is in no key. Reads by native code that opens files itself pass by, and reads in threads that the
plug-in starts; copies of what was declared are all that it finds beside the plug-in. Other threads of the process are not watched: they
may be reading the same folder for another campaign.
"""

import os
import re
import sys
import sysconfig
import tempfile
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from functools import cache
from pathlib import Path
from typing import Any, Final

import platformdirs

from vastflow.sim.plug_ins.neighbors import FILES, PlugInError
from vastflow.sim.plug_ins.snapshot import Snapshot

_COMPILED: Final = (".pyc", ".nbi", ".nbc")

_OPEN: Final = ContextVar["tuple[_Watch, ...]"]("vastflow_watches", default=())
"""Those that are open in this thread."""


def _audit(event: str, arguments: tuple[Any, ...]) -> None:
    if event == "open" and (watches := _OPEN.get()):
        path, _, flags = arguments
        reads = not isinstance(flags, int) or flags & os.O_ACCMODE != os.O_WRONLY
        if reads and isinstance(path, str | bytes | os.PathLike):
            for watch in watches:
                watch.look(os.fsdecode(path))


@cache
def _install() -> None:
    """Let Python call the hook, once: it can't be taken away again."""
    sys.addaudithook(_audit)


class _Watch:
    """Looks at each file that is opened while one plug-in's code runs."""

    def __init__(self, snapshot: Snapshot, allowed: Iterable[str]) -> None:
        self._snapshot = snapshot
        self._allowed = frozenset(each for path in allowed for each in _spellings(path))
        self._copies, self._origins = _spellings(snapshot.folder), _spellings(snapshot.origin)
        self._watched = [*self._copies, *self._origins, *_spellings(snapshot.campaign)]
        self._passed = [folder for folder in _elsewhere() if folder not in self._watched]
        self.fault: PlugInError | None = None

    def look(self, path: str) -> None:
        """Raise the fault of opening a file, and remember it in case the plug-in handles the error."""
        for each in _spellings(path):
            self.fault = self.fault or self._fault(each, os.path.isabs(path))
        if self.fault is not None:
            raise self.fault

    def missed(self, words: str) -> None:
        """Look at a file that was not found, for some look for it first, and native code opens files unseen."""
        for folder in self._copies:
            for found in re.findall(re.escape(folder + os.sep) + r"[^\s'\",:;()]*", words):
                self.fault = self.fault or self._fault(found.rstrip("."), True)

    def _fault(self, path: str, is_absolute: bool) -> PlugInError | None:
        watched = max((len(folder) for folder in self._watched if _is_below(path, folder)), default=-1)
        passed = max((len(folder) for folder in self._passed if _is_below(path, folder)), default=-1)
        if watched <= passed or path in self._allowed or path.endswith(_COMPILED):
            return None
        snapshot, origin = self._snapshot, self._origins[0]
        if copies := [folder for folder in self._copies if _is_below(path, folder)]:
            place = os.path.relpath(path, copies[0])
            if place in snapshot.files or not os.path.isfile(os.path.join(origin, place)):
                return None
        else:
            root = max((root for root in self._watched if _is_below(path, root)), key=len)
            if os.path.relpath(path, root).startswith(".") or not os.path.isfile(path):
                return None
            inside = [folder for folder in self._origins if _is_below(path, folder)]
            place = os.path.relpath(path, inside[0] if inside else origin)
        file = Path(snapshot.entry).name
        name = os.path.relpath(place, snapshot.home or ".")
        if place in snapshot.files:
            how = "where it lies" if is_absolute else "by a path relative to the working directory"
            return PlugInError(
                f"{file} reads {name!r} {how}, where it may be edited while the campaign runs",
                f"read the copy beside the plug-in: Path(__file__).parent / {name!r}",
            )
        return PlugInError(
            f"{file} reads {name!r}, which it does not declare: an edit of that would go unnoticed",
            f'add the line {FILES} = ["{name}"] to {self._where()}',
        )

    def _where(self) -> str:
        return "a code cell" if self._snapshot.entry.endswith(".ipynb") else "the plug-in's class"


@contextmanager
def watched(snapshot: Snapshot | None, allowed: Iterable[str] = ()) -> Iterator[None]:
    """Run a plug-in's code in the body.

    Args:
        snapshot: The plug-in's; None for one that is installed, which may read what it likes.
        allowed: Files that the code is given, and what they name.

    Raises:
        PlugInError: it opened a file of its folder or the campaign's that is neither declared nor `allowed`, whatever it made of
            that.
    """
    if snapshot is None:
        yield
        return
    _install()
    watch = _Watch(snapshot, allowed)
    token = _OPEN.set((*_OPEN.get(), watch))
    try:
        yield
    except Exception as error:
        if isinstance(error, OSError):
            watch.missed(str(error))
        if watch.fault is not None:
            raise watch.fault from None
        raise
    finally:
        _OPEN.reset(token)
    if watch.fault is not None:
        raise watch.fault


@cache
def _elsewhere() -> tuple[str, ...]:
    """Folders in which Python, libraries and vastflow have their own files, if they lie below a campaign's."""
    paths = sysconfig.get_paths()
    folders = [sys.prefix, sys.base_prefix, sys.exec_prefix, paths["stdlib"], paths["purelib"], paths["platlib"]]
    folders += [tempfile.gettempdir(), platformdirs.user_cache_dir("vastflow")]
    own = Path(__file__).parents[2]
    folders += [str(own / name) for name in ("sim", "producers", "oracles", "tasks", "flows", "deployments")]
    return tuple(dict.fromkeys(each for folder in folders for each in _spellings(folder)))


def _spellings(path: str | os.PathLike[str]) -> tuple[str, ...]:
    """A path as it is named and as it is without links, if that is another."""
    return tuple(dict.fromkeys((os.path.abspath(path), os.path.realpath(path))))


def _is_below(path: str, folder: str) -> bool:
    return path == folder or path.startswith(folder.rstrip(os.sep) + os.sep)
