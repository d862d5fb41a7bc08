"""The option `--as-v1` of commands that read a campaign file."""

from typing import Annotated, TypeAlias

import typer

AsV1: TypeAlias = Annotated[
    bool,
    typer.Option("--as-v1", help="Place every obstacle as version 1 of RoboVAST does, whatever the file says."),
]
"""Whether `placement: as_v1` holds for the whole file."""
