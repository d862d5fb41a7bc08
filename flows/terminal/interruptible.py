"""Ctrl-C and SIGTERM at the command line: last words at once, and one exit code."""

import signal
import sys
import threading
from collections.abc import Callable
from types import FrameType, TracebackType
from typing import Any, Final, Self

import typer

INTERRUPTED: Final = 130


class Interruptible:
    """A body that Ctrl-C and SIGTERM end with `last_words` on standard error and exit code 130.

    The words are said before all else, for the process may end without coming back here. Another thread says
    them: the main thread may hold the locks of the display or of its stream.
    """

    def __init__(self, last_words: str) -> None:
        self._last_words = last_words
        self._say: Callable[[str], object] = _print
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


def _print(words: str) -> None:
    print(words, file=sys.stderr, flush=True)
