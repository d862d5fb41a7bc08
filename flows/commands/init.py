"""The command `init`: a campaign to begin with."""

import shlex
import sys
from importlib.resources import files
from pathlib import Path
from typing import Annotated, Final

import typer

from vastflow.flows.commands.run import BAD_INPUT, unwritable

_SHIPPED: Final = "vastflow.campaigns.quickstart"
_CAMPAIGN: Final = "quickstart.vast"
_FILES: Final = (_CAMPAIGN, "maps/office.yaml", "maps/office.pgm")


def init(
    folder: Annotated[Path, typer.Argument(metavar="FOLDER", help="Folder to write it in; made where there is none.")],
) -> None:
    """Write a campaign to begin with, and its map.

    It is the quickstart: 24 configurations of a delivery robot in a small office, ready to run and to be changed. A file that is
    there already is never written over.
    """
    if wrong := unwritable(folder) or _there(folder):
        print(wrong, file=sys.stderr)
        raise typer.Exit(BAD_INPUT)
    try:
        for name in _FILES:
            (folder / name).parent.mkdir(parents=True, exist_ok=True)
            (folder / name).write_bytes(files(_SHIPPED).joinpath(name).read_bytes())
    except OSError as error:
        print(f"{error.filename or folder}: {error.strerror}; name a folder that can be written", file=sys.stderr)
        raise typer.Exit(BAD_INPUT) from None
    print(f"wrote {folder / _CAMPAIGN} and its map; run it:")
    print(f"vastflow run {shlex.quote(str(folder / _CAMPAIGN))}")


def _there(folder: Path) -> str | None:
    """Why nothing is written into a folder that has one of the files; None where it has none."""
    taken = [str(folder / name) for name in _FILES if (folder / name).exists() or (folder / name).is_symlink()]
    return f"{', '.join(taken)}: there already; name another folder" if taken else None
