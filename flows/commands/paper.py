"""The command `paper`: results of the paper's campaigns beside the paper's own."""

import sys
from pathlib import Path
from typing import Annotated

import typer

from vastflow.flows.commands.run import BAD_INPUT
from vastflow.flows.commands.show import wrong_directory
from vastflow.flows.terminal.interruptible import Interruptible
from vastflow.flows.terminal.reading import reading


def paper(
    results: Annotated[
        list[Path], typer.Argument(metavar="RESULTS...", help="Campaign directories of campaigns in campaigns/paper.")
    ],
) -> None:
    """Print a page that puts results beside the paper's.

    Markdown on standard output; the same results give the same text.
    """
    with Interruptible("interrupted"):
        from vastflow.oracles.paper.page import paper_page
        from vastflow.oracles.paper.results import NotThePapers, paper_results

        found = []
        for directory in results:
            if wrong := wrong_directory(directory):
                _end(wrong)
            with reading(directory):
                try:
                    found.append(paper_results(directory))
                except NotThePapers as error:
                    _end(str(error))
        print(paper_page(found), end="")


def _end(message: str) -> None:
    print(message, file=sys.stderr)
    raise typer.Exit(BAD_INPUT)
