"""The command `compare`: the differences between two campaigns, and a gate on the loss of passed runs."""

import json
import sys
from collections.abc import Mapping
from contextlib import ExitStack
from contextvars import copy_context
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Final, Literal

import typer

from vastflow.flows.cli.consent import Trust
from vastflow.flows.cli.run import computing, requested
from vastflow.flows.request.run_request import RunRequest
from vastflow.flows.results.address import check_directory
from vastflow.flows.terminal.ending import Interruptible, writing
from vastflow.flows.terminal.options import AsJson, Markdown, OracleName, Out, asking
from vastflow.oracles.results.unusable import reading
from vastflow.sim.model.faults import UserError

if TYPE_CHECKING:
    from vastflow.flows.analysis.comparison import Compared
    from vastflow.flows.analysis.until_decided import Decision
    from vastflow.flows.results.summary import Results

Target = Literal["these", "others"]
_ENDED: Final = (
    "Runs ended by what they showed: intervals of rates hold nevertheless, p-values and intervals of metrics need not."
)
_RUNNING: Final = ("runs", "results", "store", "workers", "cluster", "map_dir")


@asking(*_RUNNING)
def compare(
    before: Annotated[
        Path,
        typer.Argument(metavar="A", help="Baseline campaign directory; with --until-decided also a campaign file."),
    ],
    after: Annotated[Path, typer.Argument(metavar="B", help="Candidate, likewise.")],
    asked: Mapping[str, Any],
    until_decided: Annotated[
        bool,
        typer.Option(
            "--until-decided",
            help="Run both campaigns, one run of each configuration a round, until a loss of the margin is ruled out or a loss is shown.",
        ),
    ] = False,
    trust: Trust = False,
    oracle: OracleName = None,
    gate: Annotated[
        bool,
        typer.Option(
            "--gate",
            help="Exit with 1 unless a loss of the margin is ruled out, with 4 if there are too few paths (or maps), or runs, to tell.",
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
    decided: tuple[Compared, Decision] | None = None
    if until_decided:
        if target != "these":
            raise UserError(
                "--until-decided: expected --target these, got others. More runs of a path make no other paths."
            )
        decided = _run_until_decided(before, after, asked, trust, oracle, margin)
        before, after = (each.directory for each in (decided[0].before, decided[0].after))
    elif given := [name for name in _RUNNING if asked[name] != RunRequest.model_fields[name].get_default()]:
        raise UserError(f"--{given[0].replace('_', '-')}: requires --until-decided, which runs campaigns")
    for directory in (before, after):
        check_directory(directory)
    with Interruptible("interrupted"):
        from vastflow.flows.analysis.comparison import compared
        from vastflow.flows.analysis.comparison_pictures import draw
        from vastflow.flows.analysis.comparison_text import compared_json, compared_report, compared_text
        from vastflow.flows.terminal.display import print_rows
        from vastflow.flows.terminal.markdown import write_markdown
        from vastflow.oracles.results.tables import read_tables

        if decided is None:
            with reading(before):
                then = read_tables(before)
            with reading(after):
                found = compared(then, read_tables(after), oracle, margin, target)
        else:
            found = decided[0]
        folder = out or after / "comparisons" / before.resolve().name
        with writing(folder, "--out"):
            drawn, undrawn = draw(found, pictures, folder)
        if junit is not None:
            with writing(junit, "--junit"):
                junit.write_bytes(compared_report(found))
        shown, values = list(compared_text(found, drawn)), compared_json(found, drawn)
        if decided is not None:
            shown.insert(-1, f"{decided[1].text}\n{_ENDED}")
            values["until_decided"] = asdict(decided[1])
        if markdown:
            write_markdown([shown[-1], *shown[:-1]], markdown)  # the gate first
        if as_json:
            print(json.dumps(values))
        else:
            print_rows(shown)
        for why, names in undrawn.items():
            print(f"not drawn: {', '.join(names)}: {why}", file=sys.stderr)
    if gate:
        raise typer.Exit(found.gate.exit_code)


def _run_until_decided(
    before: Path, after: Path, asked: Mapping[str, Any], trust: bool, oracle: str | None, margin: float
) -> "tuple[Compared, Decision]":
    from vastflow.flows.analysis.until_decided import Side, compared_until_decided

    def run(request: RunRequest) -> "Results":
        with computing() as display:
            from vastflow.flows import run_campaign

            return run_campaign(request, observer=display)

    def notify(text: str) -> None:
        print(text, file=sys.stderr)

    with ExitStack() as stack:

        def side(source: Path) -> Side:
            context, opened = copy_context(), requested(source, asked, trust)  # each permits its own code alone
            request = context.run(opened.__enter__)
            stack.callback(context.run, opened.__exit__, None, None, None)
            return Side(request, context)

        return compared_until_decided(side(before), side(after), run, oracle=oracle, margin=margin, notify=notify)
