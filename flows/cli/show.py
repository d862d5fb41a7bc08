"""The command `show`: a campaign in the terminal, finished or running."""

import json
from contextlib import suppress
from pathlib import Path
from typing import Annotated, Final

import typer

from vastflow.flows.cli.store import StoreOption
from vastflow.flows.terminal.ending import INTERRUPTED, Interruptible
from vastflow.flows.terminal.options import AsJson, Markdown, PlaceOfResults, configuration_and_run, run_names
from vastflow.oracles.results.unusable import UnusableDirectory, reading
from vastflow.sim.model.faults import UserError

_RESULTS: Final = "results"
"""Folder in which a campaign to follow is looked for, unless one is named."""


def show(
    results: PlaceOfResults = "",
    run: Annotated[
        str,
        typer.Argument(
            metavar="CONFIGURATION/RUN",
            help="With --lineage, a run by its configuration and index.",
            autocompletion=run_names,
        ),
    ] = "",
    coverage: Annotated[
        bool, typer.Option("--coverage", help="Show how much of the requested test space was realized instead.")
    ] = False,
    follow: Annotated[
        bool, typer.Option("--follow", help="Show a running campaign until it ends (default: the newest in results).")
    ] = False,
    lineage: Annotated[
        bool,
        typer.Option("--lineage", help="Show what the verdicts on one run follow from, back to the campaign file."),
    ] = False,
    store: StoreOption = None,
    markdown: Markdown = None,
    as_json: AsJson = False,
) -> None:
    """Show a campaign.

    Its headline, rates, rejections with their reasons, and the path of the report; with --json, the coverage. With --follow, the progress
    of a running campaign and its failures as they come; with --json, its events, one a line. With --markdown, only failing
    configurations are written, those with most failed runs first. With --lineage, the steps behind the
    verdicts on one run with their keys, and whether the store has them still.
    """
    if not lineage and (run or store):
        raise UserError(f"{'CONFIGURATION/RUN' if run else '--store'}: requires --lineage, got {run or store!r} alone")
    if lineage and not run:
        raise UserError("--lineage: expected RESULTS and CONFIGURATION/RUN, such as room-1/0")
    if markdown and (follow or lineage or coverage or as_json):
        raise UserError("--markdown: expected RESULTS alone, got --follow, --lineage, --coverage, or --json")
    if follow:
        if coverage:
            raise UserError("--coverage: expected a finished campaign, got --follow")
        _follow(Path(results or _RESULTS), as_json)
        return
    if not results:
        raise UserError("RESULTS: Name a campaign directory. Only --follow finds one itself.")
    from vastflow.flows.plan.text import coverage_text
    from vastflow.flows.results.address import WITHOUT_RUNS, at_hand, check_directory
    from vastflow.flows.terminal.display import print_rows
    from vastflow.flows.terminal.markdown import write_markdown
    from vastflow.flows.terminal.outcome import details
    from vastflow.oracles.evidence.evidence import evidence_of
    from vastflow.oracles.results.coverage import read_coverage
    from vastflow.oracles.results.tables import read_tables

    with at_hand(results, WITHOUT_RUNS) as directory:
        check_directory(directory)
        with reading(results.rstrip("/")):
            if lineage:
                _show_lineage(directory, run, store, as_json)
            elif as_json:
                print(json.dumps(read_coverage(directory), ensure_ascii=False))
            elif coverage:
                print_rows([*coverage_text(read_coverage(directory))])
            else:
                tables = read_tables(directory)
                evidence = evidence_of(tables)
                shown = list(details(tables, evidence))
                if markdown:
                    write_markdown(details(tables, evidence, failing=True), markdown)
                print(f"{tables.metadata['name']}, {tables.metadata['created']}\n")
                print_rows(shown)
                print(f"\n{report_line(directory, results.rstrip('/'))}")


def _show_lineage(directory: Path, run: str, place: str | None, as_json: bool) -> None:
    from vastflow.flows.results.lineage import lineage_of, lineage_text
    from vastflow.flows.terminal.display import print_rows, terminal_table
    from vastflow.tasks.store.store import open_store

    steps = lineage_of(directory, *configuration_and_run(run), open_store(place, read_only=True))
    if as_json:
        print(json.dumps([step.as_json() for step in steps], ensure_ascii=False))
    else:
        print_rows([terminal_table(("step", "", "key"), rows=lineage_text(steps))])


def _follow(results: Path, as_json: bool) -> None:
    """Show the events of a campaign; exit with the code of an interrupt if it was stopped."""
    from vastflow.flows.terminal.following import FollowedCampaign, followed_directory
    from vastflow.oracles.results.events import follow

    directory = followed_directory(results)
    with Interruptible("Interrupted. The campaign goes on."), reading(directory):
        followed = FollowedCampaign()
        if as_json:
            for followed.last in follow(directory):
                print(followed.last.line.decode(), end="", flush=True)
        else:
            followed.show(follow(directory))
    last = followed.last
    if last is None or last.event != "ended":
        if not as_json:
            reason = "its events end early" if last is None else last.values.get("reason")
            print(f"{directory.name} stopped: {reason}")
        raise typer.Exit(INTERRUPTED)
    if not as_json:
        from vastflow.oracles.evidence.evidence import headline_of
        from vastflow.oracles.results.tables import read_tables

        counts = last.values
        with suppress(UnusableDirectory), reading(directory):  # one that was delivered elsewhere has no tables here
            print(headline_of(read_tables(directory)).text)
        print(f"{counts['passed']} passed, {counts['failed']} failed, {counts['not_judged']} not judged")
        print(report_line(directory))


def report_line(results: Path, place: str | None = None) -> str:
    """Return the path of the report, if any, at the `place` that `results` is a copy of."""
    where = place or str(results)
    return f"report: {where}/report.html" if (results / "report.html").exists() else f"no report, but tables: {where}"
