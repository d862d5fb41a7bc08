"""The command `init`: a campaign to begin with."""

import os
import shlex
from importlib.resources import files
from pathlib import Path
from typing import Annotated, Final

import typer

from vastflow.flows.terminal.writing import check_writable, writing
from vastflow.sim.user_error import UserError

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
    check_writable(folder)
    if taken := [str(folder / name) for name in _FILES if os.path.lexists(folder / name)]:
        raise UserError(f"{', '.join(taken)}: there already; name another folder")
    for name in _FILES:
        place = folder / name
        with writing(place):
            place.parent.mkdir(parents=True, exist_ok=True)
            place.write_bytes(files(_SHIPPED).joinpath(name).read_bytes())
    print(f"wrote {folder / _CAMPAIGN} and its map; run it:")
    print(f"vastflow run {shlex.quote(str(folder / _CAMPAIGN))}")
