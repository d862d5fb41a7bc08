"""The command `compare`: the differences between two campaigns, and a gate on the loss of passed runs."""

import json
import sys
from pathlib import Path
from typing import Annotated, Literal

import typer

from vastflow.flows.results.address import check_directory
from vastflow.flows.terminal.ending import Interruptible, writing
from vastflow.flows.terminal.options import AsJson, Markdown, OracleName, Out
from vastflow.oracles.results.unusable import reading

Target = Literal["these", "others"]


def compare(
    before: Annotated[Path, typer.Argument(metavar="A", help="Baseline campaign directory.")],
    after: Annotated[Path, typer.Argument(metavar="B", help="Candidate campaign directory.")],
    oracle: OracleName = None,
    gate: Annotated[
        bool,
        typer.Option(
            "--gate",
            help="Exit with 1 unless a loss of the margin is ruled out, with 4 if there are too few paths (or maps) to tell.",
        ),
    ] = False,
    target: Annotated[
        Target, typer.Option(help="Draw conclusions about these scenarios, or about others of their kind.")
    ] = "these",
    margin: Annotated[float, typer.Option(min=0.0, max=1.0, help="Accepted loss, as a share of the runs.")] = 0.02,
    junit: Annotated[
        Path | None, typer.Option(metavar="FILE", help="Write a JUnit file with the gate and each configuration.")
    ] = None,
    pictures: Annotated[
        int, typer.Option(min=0, metavar="N", help="Number of configurations to draw, most changed first.")
    ] = 8,
    out: Out = None,
    markdown: Markdown = None,
    as_json: AsJson = False,
) -> None:
    """Compare two campaigns, run by run.

    Runs are paired by scenario and seed. Shows the difference with its interval, configurations that newly fail or pass, and
    the difference at each level of each factor. Pictures go to B/comparisons/A.
    """
    for directory in (before, after):
        check_directory(directory)
    with Interruptible("interrupted"):
        from vastflow.flows.analysis.comparison import compared
        from vastflow.flows.analysis.comparison_pictures import draw
        from vastflow.flows.analysis.comparison_text import compared_json, compared_report, compared_text
        from vastflow.flows.terminal.display import print_rows
        from vastflow.flows.terminal.markdown import write_markdown
        from vastflow.oracles.results.tables import read_tables

        with reading(before):
            then = read_tables(before)
        with reading(after):
            found = compared(then, read_tables(after), oracle, margin, target)
        folder = out or after / "comparisons" / before.resolve().name
        with writing(folder, "--out"):
            drawn, undrawn = draw(found, pictures, folder)
        if junit is not None:
            with writing(junit, "--junit"):
                junit.write_bytes(compared_report(found))
        shown = list(compared_text(found, drawn))
        if markdown:
            write_markdown([shown[-1], *shown[:-1]], markdown)  # the gate first
        if as_json:
            print(json.dumps(compared_json(found, drawn)))
        else:
            print_rows(shown)
        for why, names in undrawn.items():
            print(f"not drawn: {', '.join(names)}: {why}", file=sys.stderr)
    if gate:
        raise typer.Exit(found.gate.exit_code)
