"""Errors of unusable campaign directories: missing, damaged, or incomplete."""

import zipfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Final

from vastflow.sim.model.faults import UserError

_MOST_CHARACTERS: Final = 500
_FOUND_WRONG: Final = (ValueError, LookupError, TypeError, AttributeError, ArithmeticError, NotImplementedError)
_TOO_MUCH: Final = (RecursionError, MemoryError)
DAMAGE: Final = (OSError, zipfile.BadZipFile, *_FOUND_WRONG, *_TOO_MUCH)
"""Errors that damaged content raises in a program that expects intact content."""


class UnusableDirectory(UserError, ValueError):
    """A directory can't be used for the request; the message gives the directory, problem, and expected content."""


@contextmanager
def reading(directory: Path | str) -> Iterator[None]:
    """Report damage of a campaign directory that the body reads as `UnusableDirectory`.

    Files that were damaged or written by hand hold any value at any place, and nobody checks all of them before.

    Raises:
        UnusableDirectory: the body raised what damaged content raises.
    """
    try:
        yield
    except (UserError, BrokenPipeError):  # of whom the output is for
        raise
    except DAMAGE as error:
        # The words of a KeyError are the key alone.
        words = (
            f"has no {error}" if isinstance(error, KeyError) else " ".join(str(error).split()) or type(error).__name__
        )
        raise UnusableDirectory(f"{directory}: damaged campaign directory: {words[:_MOST_CHARACTERS]}") from None
