"""A campaign directory that a command reads: what is damaged in it ends the command with a sentence."""

import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Final

import typer

BAD_INPUT: Final = 2


@contextmanager
def reading(directory: Path | str) -> Iterator[None]:
    """Read a campaign directory, and make of what it holds what is shown, in the body.

    Files that were damaged or written by hand hold any value at any place, and nobody checks all of them before.
    """
    try:
        yield
    except BrokenPipeError:  # of whom the output is for
        raise
    except (OSError, ValueError, LookupError, TypeError, AttributeError, ArithmeticError, NotImplementedError) as error:
        words = " ".join(str(error).split()) or type(error).__name__
        print(f"{directory}: damaged campaign directory: {words[:500]}", file=sys.stderr)
        raise typer.Exit(BAD_INPUT) from None
