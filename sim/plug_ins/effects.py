"""Effects: foreign code, whose exits become errors, and which may not change anything during validation.

Python tells of opened files, programs and connections as audit events. Native code that calls the system itself passes by.
"""

import os
import sys
import sysconfig
from collections.abc import Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from functools import cache
from pathlib import Path
from types import FrameType
from typing import Any, Final

_WRITES: Final = os.O_WRONLY | os.O_RDWR | os.O_CREAT | os.O_TRUNC | os.O_APPEND
_COMPILED: Final = (".pyc", ".nbi", ".nbc")
_OWN: Final = ("sim", "producers", "oracles", "tasks", "flows", "deployments")
_IMPORTING: Final = "<frozen importlib"
_REFUSED: Final = {
    "os.system": "start a program",
    "os.exec": "start a program",
    "os.posix_spawn": "start a program",
    "os.spawn": "start a program",
    "os.startfile": "start a program",
    "subprocess.Popen": "start a program",
    "pty.spawn": "start a program",
    "os.fork": "start a process",
    "os.forkpty": "start a process",
    "os.kill": "send a signal",
    "os.killpg": "send a signal",
    "socket.connect": "open a connection",
    "socket.bind": "open a connection",
    "socket.sendto": "open a connection",
    "socket.getaddrinfo": "open a connection",
    "sqlite3.connect": "open a database",
    "os.mkdir": "make a folder",
    "os.remove": "remove a file",
    "os.rmdir": "remove a folder",
    "os.rename": "rename a file",
    "os.link": "make a link",
    "os.symlink": "make a link",
    "os.truncate": "write to a file",
    "os.chmod": "change a file",
    "os.chown": "change a file",
    "os.utime": "change a file",
}
"""Audit event to what is done."""

_is_looking: ContextVar[bool] = ContextVar("is_looking", default=False)
_is_foreign: ContextVar[bool] = ContextVar("is_foreign", default=False)


class EffectRefused(PermissionError):
    """Code of others would change something, while a campaign is only looked at."""


@contextmanager
def looking_only() -> Iterator[None]:
    """Within the body, code of others that runs within `foreign_code` has no effects."""
    token = _is_looking.set(True)
    try:
        yield
    finally:
        _is_looking.reset(token)


@contextmanager
def foreign_code() -> Iterator[None]:
    """Run code of others in the body.

    Raises:
        EffectRefused: it would have an effect, and is only looked at. What libraries do as they are imported, and files that
            Python and numba compile, are none.
    """
    if not _is_looking.get():
        yield
        return
    _install()
    token = _is_foreign.set(True)
    try:
        yield
    finally:
        _is_foreign.reset(token)


@cache
def _install() -> None:
    """Let Python call the hook, once: it can't be taken away again."""
    sys.addaudithook(_audit)


def _audit(event: str, arguments: tuple[Any, ...]) -> None:
    done = _REFUSED.get(event)
    if (done is None and event != "open") or not _is_foreign.get():
        return
    path = arguments[0] if arguments else None
    if event == "open":
        flags = arguments[2]
        if not isinstance(flags, int) or not flags & _WRITES or path == os.devnull:
            return
        if isinstance(path, str) and path.endswith(_COMPILED):
            return
        done = "write to a file"
    if _is_its_own(sys._getframe(1)):
        named = f" ({os.fsdecode(path)!r})" if isinstance(path, str | bytes | os.PathLike) else ""
        raise EffectRefused(f"it would {done}{named}, and is only looked at")


def _is_its_own(frame: FrameType | None) -> bool:
    """Whether foreign code itself does what goes on in `frame`, and not a library as it is imported, nor vastflow."""
    is_library = is_imported = False
    while frame is not None:
        file = frame.f_code.co_filename
        if file.startswith(_IMPORTING):
            is_imported = is_imported or is_library
        elif file.startswith(_vastflow()):
            return False
        elif file.startswith(_libraries()):
            is_library = True
        else:
            return not is_imported
        frame = frame.f_back
    return True


@cache
def _libraries() -> tuple[str, ...]:
    """Folders of Python's own modules and of installed packages."""
    paths = sysconfig.get_paths()
    return (*(paths[name] + os.sep for name in ("stdlib", "platstdlib", "purelib", "platlib")), "<frozen ")


@cache
def _vastflow() -> tuple[str, ...]:
    root = Path(__file__).parents[2]
    return tuple(f"{root / name}{os.sep}" for name in _OWN)


class PlugInExit(RuntimeError):
    """A plug-in tried to end the process, as `sys.exit` does."""


@contextmanager
def plug_in_code() -> Iterator[None]:
    """Run a plug-in's code in the body.

    `SystemExit` and its like pass by every `except Exception`, so that a plug-in's exit code would become vastflow's.

    Raises:
        PlugInExit: instead of what is raised and is no `Exception`; Ctrl-C stays what it is.
        EffectRefused: see `vastflow.sim.plug_ins.effects.foreign_code`.
    """
    try:
        with foreign_code():
            yield
    except (Exception, KeyboardInterrupt):
        raise
    except BaseException as error:
        code = f"({error.code!r})" if isinstance(error, SystemExit) else ""
        raise PlugInExit(f"its code raised {type(error).__name__}{code}, which would end vastflow") from error
