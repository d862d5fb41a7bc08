"""Arguments and options that several commands have."""

from pathlib import Path
from typing import Annotated, TypeAlias

import typer

from vastflow.sim.model.faults import UserError

CampaignFile: TypeAlias = Annotated[Path, typer.Argument(metavar="FILE", help="Campaign file.")]
ResultsFolder: TypeAlias = Annotated[
    Path, typer.Argument(metavar="RESULTS", help="A campaign directory, as `vastflow run` names it.")
]
AsJson: TypeAlias = Annotated[bool, typer.Option("--json", help="Print JSON and nothing else.")]
Context: TypeAlias = Annotated[
    str | None, typer.Option(metavar="NAME", help="Cluster whose resources count; else the first that the file names.")
]
AsV1: TypeAlias = Annotated[
    bool, typer.Option("--as-v1", help="Place every obstacle as version 1 of RoboVAST does, whatever the file says.")
]
"""Whether `placement: as_v1` holds for the whole file."""


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
