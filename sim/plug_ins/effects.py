"""Guards round users' code: exits become errors, and reads are declared.

Python tells of opened files as audit events. Native code that calls the system itself passes by, and so do threads that the code
starts.
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
_OWN: Final = tuple(
    str(Path(__file__).parents[2] / name) for name in ("sim", "producers", "oracles", "tasks", "flows", "deployments")
)
_OPEN: Final = "open"

_watches: ContextVar["tuple[_Watch, ...]"] = ContextVar("watches", default=())


class PlugInExit(RuntimeError):
    """A plug-in tried to end the process, as `sys.exit` does."""


class Interrupted(BaseException):
    """Raised in the thread of a unit that was canceled, whatever code it runs."""


@contextmanager
def plug_in_code() -> Iterator[None]:
    """Run a plug-in's code in the body.

    `SystemExit` and its like pass by every `except Exception`, so that a plug-in's exit code would become vastflow's.

    Raises:
        PlugInExit: instead of what is raised and is no `Exception`; Ctrl-C and `Interrupted` stay what they are.
    """
    try:
        yield
    except (Exception, KeyboardInterrupt, Interrupted):
        raise
    except BaseException as error:
        code = f"({error.code!r})" if isinstance(error, SystemExit) else ""
        raise PlugInExit(f"its code raised {type(error).__name__}{code}, which would end vastflow") from error


@contextmanager
def watched(snapshot: Snapshot | None, allowed: Iterable[str] = ()) -> Iterator[None]:
    """Run a plug-in's code in the body, which reads no file of its folder or the campaign's unnoticed.

    What it reads and has not declared is in no key. Copies of what was declared are all that it finds beside itself.

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
    token = _watches.set((*_watches.get(), watch))
    try:
        yield
    except Exception as error:
        if isinstance(error, OSError):
            watch.missed(str(error))
        if watch.fault is not None:
            raise watch.fault from None
        raise
    finally:
        _watches.reset(token)
    if watch.fault is not None:
        raise watch.fault


@cache
def _install() -> None:
    """Let Python call the hook, once: it can't be taken away again."""
    sys.addaudithook(_audit)


def _audit(event: str, arguments: tuple[Any, ...]) -> None:
    if event != _OPEN or not (watches := _watches.get()):  # other threads read for other campaigns
        return
    first, _, flags = arguments
    if isinstance(first, str | bytes | os.PathLike) and not (isinstance(flags, int) and flags & os.O_WRONLY):
        for watch in watches:
            watch.look(os.fsdecode(first))


@cache
def _libraries() -> tuple[str, ...]:
    paths = sysconfig.get_paths()
    return tuple(paths[name] + os.sep for name in ("stdlib", "platstdlib", "purelib", "platlib"))


@cache
def _elsewhere() -> tuple[str, ...]:
    """Folders of Python, libraries, and vastflow that are below a campaign's folder."""
    folders = [sys.prefix, sys.base_prefix, sys.exec_prefix, *_libraries()]
    folders += [tempfile.gettempdir(), platformdirs.user_cache_dir("vastflow"), *_OWN]
    return tuple(dict.fromkeys(each for folder in folders for each in _spellings(folder)))


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
        root, passed = _around(path, self._watched), _around(path, self._passed)
        if len(root) <= len(passed) or path in self._allowed or path.endswith(_COMPILED):
            return None
        snapshot, origin = self._snapshot, self._origins[0]
        if copies := _around(path, self._copies):
            place = os.path.relpath(path, copies)
            if place in snapshot.files or not os.path.isfile(os.path.join(origin, place)):
                return None
        else:
            if os.path.relpath(path, root).startswith(".") or not os.path.isfile(path):
                return None
            place = os.path.relpath(path, _around(path, self._origins) or origin)
        file, name = Path(snapshot.entry).name, os.path.relpath(place, snapshot.home or ".")
        if place in snapshot.files:
            how = "where it lies" if is_absolute else "by a path relative to the working directory"
            return PlugInError(
                f"{file} reads {name!r} {how}, where it may be edited while the campaign runs",
                f"read the copy beside the plug-in: Path(__file__).parent / {name!r}",
            )
        where = "a code cell" if snapshot.entry.endswith(".ipynb") else "the plug-in's class"
        return PlugInError(
            f"{file} reads {name!r}, which it does not declare, so that an edit of it would go unnoticed",
            f'add the line {FILES} = ["{name}"] to {where}',
        )


def _spellings(path: str | os.PathLike[str]) -> tuple[str, ...]:
    """A path as it is named and as it is without links, if that is another."""
    return tuple(dict.fromkeys((os.path.abspath(path), os.path.realpath(path))))


def _around(path: str, folders: Iterable[str]) -> str:
    """The innermost of the folders that a path is in; empty without one."""
    around = (each for each in folders if path == each or path.startswith(each.rstrip(os.sep) + os.sep))
    return max(around, key=len, default="")
