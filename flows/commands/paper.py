"""The command `paper`: results of the paper's campaigns beside the paper's own."""

from pathlib import Path
from typing import Annotated

import typer

from vastflow.flows.commands.checkout import run_script


def paper(
    results: Annotated[
        list[Path], typer.Argument(metavar="RESULTS...", help="Campaign directories of campaigns in campaigns/paper.")
    ],
) -> None:
    """Print a page that puts results beside the paper's.

    Markdown on standard output; the same results give the same text. Needs a clone of the repository.
    """
    run_script("paper", "paper_page", "--", *results)
