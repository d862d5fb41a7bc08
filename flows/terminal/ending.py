"""Ends of commands: exit codes, Ctrl-C and SIGTERM, and folders that can't be written."""

import errno
import os
import signal
import sys
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from functools import partial
from pathlib import Path
from types import FrameType, TracebackType
from typing import Any, Final, Self

import typer

from vastflow.sim.model.faults import FileError, Place, UserError

BAD_INPUT: Final = 2
"""Exit code of a user's mistake, wrong options included."""
FAULT: Final = 3
"""Exit code of a broken run, worker, Prefect, or plug-in."""
INTERRUPTED: Final = 130
_EXCERPT: Final = 150
"""Characters of a line that are shown."""


class Interruptible:
    """Ends its body with `last_words` on stderr and exit code 130 after Ctrl-C or SIGTERM.

    The words come first, since the process may end before it returns here. Another thread writes them, since the main
    thread may hold the locks of the display or of its stream.
    """

    def __init__(self, last_words: str) -> None:
        self._last_words = last_words
        self._say: Callable[[str], object] = partial(print, file=sys.stderr, flush=True)
        self._lock = threading.Lock()
        self._interrupted = False
        self._said = False
        self._before: dict[signal.Signals, Any] = {}

    def last_words_by(self, say: Callable[[str], object]) -> None:
        """Let `say` write the last words from now on."""
        self._say = say

    def __enter__(self) -> Self:
        self._before = {number: signal.signal(number, self._interrupt) for number in (signal.SIGINT, signal.SIGTERM)}
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, traceback: TracebackType | None
    ) -> None:
        for number, handler in self._before.items():
            signal.signal(number, handler)
        if self._interrupted and error is not None:  # an interrupted import raises all sorts of things
            self._speak()
            raise typer.Exit(INTERRUPTED) from None

    def _interrupt(self, number: int, frame: FrameType | None) -> None:
        self._interrupted = True
        threading.Thread(target=self._speak, daemon=True).start()
        signal.default_int_handler(number, frame)

    def _speak(self) -> None:
        with self._lock:
            if not self._said:
                self._said = True
                self._say(self._last_words)


def print_error(error: UserError) -> None:
    """Print a user's mistakes to stderr, each with its line of the file and a caret below its column."""
    for fault in error.faults if isinstance(error, FileError) else ():
        print(fault, *_excerpt(fault.place), sep="\n", file=sys.stderr)
    if not isinstance(error, FileError):
        print(error, file=sys.stderr)


def _excerpt(place: Place) -> Iterator[str]:
    if place.line < 1 or (place.line, place.column) == (1, 1):  # of the file as a whole
        return
    with suppress(OSError, ValueError, IndexError):
        from rich.cells import cell_len

        from vastflow.sim.model.files import read_text

        line = read_text(place.file).split("\n")[place.line - 1]
        start = max(0, place.column - _EXCERPT // 2)
        shown = "".join(each if each.isprintable() else " " for each in line[start : start + _EXCERPT])
        yield f"  {place.line} | {shown}"
        yield f"  {' ' * len(str(place.line))} | {' ' * cell_len(shown[: place.column - 1 - start])}^"


@contextmanager
def writing(place: Path, option: str = "") -> Iterator[None]:
    """Report an `OSError` of the body, which writes to the `place` of an `option`, as a `UserError`."""
    try:
        yield
    except UserError:  # some are OSErrors too
        raise
    except OSError as error:
        wrong = f"{place}: It can't be written ({error.strerror}). Name another folder."
        raise UserError(f"{option} {wrong}".lstrip()) from None


def check_writable(folder: Path, option: str = "") -> None:
    """Check that a folder can be created or written to, before a run takes hours.

    Raises:
        UserError: it can't.
    """
    if wrong := _wrong(folder.absolute(), folder.parts):
        raise UserError(f"{option} {folder}: {wrong}".lstrip())


def _wrong(place: Path, parts: tuple[str, ...]) -> str | None:
    right = "Expected a folder that exists or can be created."
    try:
        while not place.exists():
            if place.is_symlink():
                return f"{place} is a broken link. {right}"
            if place.name == "..":
                return f"{place.parent} does not exist. {right}"
            place = place.parent
        if any(len(os.fsencode(part)) > os.pathconf(place, "PC_NAME_MAX") for part in parts):
            raise OSError(errno.ENAMETOOLONG, os.strerror(errno.ENAMETOOLONG))
    except OSError as error:
        return f"{error.strerror}. {right}"
    if not place.is_dir():
        return f"{place} is not a folder. {right}"
    if not os.access(place, os.W_OK | os.X_OK):
        return f"no write permission in {place}. {right}"
    return None
