"""The option `--map-dir` of commands that read a campaign file."""

from pathlib import Path
from typing import Annotated, TypeAlias

import typer

from vastflow.sim.user_error import UserError


def _checked(folder: Path | None) -> Path | None:
    if folder is not None and not folder.is_dir():
        raise UserError(f"--map-dir {folder}: no such folder; one with maps at the places that the file names")
    return folder


MapDir: TypeAlias = Annotated[
    Path | None,
    typer.Option(
        "--map-dir",
        metavar="FOLDER",
        callback=_checked,
        help="Where maps are looked for that are not beside the campaign file, by the same relative path.",
    ),
]
"""Folder of maps that are not beside the campaign file; one that exists."""
