"""The command `ui`: the explorer, served on this machine."""

from pathlib import Path
from typing import Annotated

import typer


def ui(
    results: Annotated[
        list[Path] | None,
        typer.Argument(metavar="RESULTS", help="Folders of campaign directories. Default: results"),
    ] = None,
    port: Annotated[int, typer.Option(min=0, max=65535, help="Port on 127.0.0.1, or 0 for a free one.")] = 0,
    browser: Annotated[bool, typer.Option("--browser/--no-browser", help="Open the browser.")] = True,
) -> None:
    """Explore campaigns in the browser.

    Serves the campaigns below the given folders, finished and running, on this machine only. The printed address carries a
    token; without it nothing is shown. Ctrl-C ends it.
    """
    from vastflow.deployments.explorer.serving import serve

    serve(tuple(results or [Path("results")]), port, browser=browser)
