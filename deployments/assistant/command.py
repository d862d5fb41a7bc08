"""The command `mcp`: tools for assistants, served to this user."""

from pathlib import Path
from typing import Annotated

import typer


def mcp(
    results: Annotated[
        list[Path] | None,
        typer.Argument(metavar="RESULTS", help="Folders of campaign directories. Default: results"),
    ] = None,
    http: Annotated[
        int | None,
        typer.Option(
            min=0, max=65535, metavar="PORT", help="Serve HTTP on 127.0.0.1 at this port, or 0 for a free one."
        ),
    ] = None,
    allow_run: Annotated[
        bool, typer.Option("--allow-run", help="Let the assistant run campaigns, and execute code that they name.")
    ] = False,
    workspace: Annotated[
        Path | None, typer.Option(metavar="FOLDER", help="Folder of files that campaigns of the assistant may name.")
    ] = None,
) -> None:
    """Answer an assistant's questions on campaigns (MCP).

    Serves standard input and output to the program that starts it, or HTTP to programs that send the token which is printed on
    standard error. Nothing is changed or executed, unless --allow-run is given.
    """
    from vastflow.deployments.assistant.serving import serve

    serve(tuple(results or [Path("results")]), http, allow_run=allow_run, workspace=workspace)
