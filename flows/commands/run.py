"""The command `run`: a campaign from file to report."""

import os
import shlex
import sys
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Final

import typer

from vastflow.flows.commands.dry_run import print_dry_run
from vastflow.flows.request.run_request import NAMES, RunRequest, request_of
from vastflow.flows.results.at_hand import check_directory
from vastflow.flows.terminal.exit_code import FAULT
from vastflow.flows.terminal.interruptible import Interruptible
from vastflow.flows.terminal.options import CampaignFile
from vastflow.flows.terminal.request_options import asking
from vastflow.flows.terminal.writing import check_writable
from vastflow.sim.model.faults import UserError

if TYPE_CHECKING:
    from vastflow.flows.results.summary import Results

OPTIONS: Final = tuple(name for name in NAMES if name != "reports")


@asking(*OPTIONS)
def run(
    file: CampaignFile,
    asked: Mapping[str, Any],
    dry_run: Annotated[
        bool, typer.Option("--dry-run", help="Only say what would be computed and why, and write nothing.")
    ] = False,
    since: Annotated[
        Path | None,
        typer.Option(metavar="RESULTS", help="With --dry-run: compare with this campaign, else with the newest."),
    ] = None,
    as_json: Annotated[bool, typer.Option("--json", help="Print a JSON summary and nothing else.")] = False,
    open_report: Annotated[
        bool, typer.Option("--open", help="Open the report in the browser at the end; never where CI is set.")
    ] = False,
) -> None:
    """Run a campaign and write its report.

    What is in the store already is not computed again.
    """
    if since is not None:
        if not dry_run:
            raise UserError(f"--since {since}: only with --dry-run, which compares with it")
        check_directory(since, "--since")
    request = asked_request(file, asked)
    if dry_run:
        print_dry_run(request, since=since, as_json=as_json)
        return
    run_and_show(request, as_json, open_report=open_report)


def asked_request(file: Path, asked: Mapping[str, Any]) -> RunRequest:
    """The request that options make; a wrong one ends with exit code 2."""
    try:
        return request_of(file, asked)
    except ValueError as error:
        raise UserError(str(error)) from None


def run_and_show(request: RunRequest, as_json: bool, *, open_report: bool = False) -> None:
    """Run a campaign as the command line does: with a display, the outcome in words, and an exit code."""
    from vastflow.tasks.store import is_address

    if not is_address(request.results):
        check_writable(Path(request.results), "--results")
    found = _kept(request) or _run(request)
    for note in found.notes:
        print(note, file=sys.stderr)
    if as_json:
        print(found.summary.json_text())
    else:
        _show(found)
    if open_report and not os.environ.get("CI"):
        _open(found.directory / "report.html")
    if found.faults:
        raise typer.Exit(FAULT)


def _kept(request: RunRequest) -> "Results | None":
    """What an earlier run with this request came to, if nothing has changed since."""
    from vastflow.flows.results.kept_answer import kept_answer

    return kept_answer(request)


def _run(request: RunRequest) -> "Results":
    going_on = f"`{command_line(sys.argv)}` again computes only what is missing"
    with Interruptible(f"interrupted; {going_on}") as interruptible:
        from vastflow.flows.terminal.display import Display

        with Display() as display:
            interruptible.last_words_by(display.close)
            from vastflow.flows import run_campaign
            from vastflow.flows.request.work_pool import WorkersFailed
            from vastflow.tasks.server import PrefectUnavailable

            try:
                return run_campaign(request, observer=display)
            except (PrefectUnavailable, WorkersFailed) as error:
                display.close(f"{error}; {going_on}")
                raise typer.Exit(FAULT) from None


def command_line(arguments: list[str]) -> str:
    """The command as it was typed, with `vastflow` for its first word."""
    return shlex.join(["vastflow", *arguments[1:]])


def _open(report: Path) -> None:
    """Open a report in the user's browser; where there is none, its path was said."""
    import webbrowser

    if not (report.exists() and webbrowser.open(report.absolute().as_uri())):
        print(f"--open: no browser opens {report}", file=sys.stderr)


def _show(found: "Results") -> None:
    from vastflow.flows.commands.show import report_line
    from vastflow.flows.terminal.display import duration_text
    from vastflow.flows.terminal.outcome import outcome, printed
    from vastflow.oracles.directory.tables import read_tables
    from vastflow.oracles.evidence.evidence import evidence_of
    from vastflow.tasks.store import is_address

    tables, summary = read_tables(found.directory), found.summary
    printed(outcome(tables, evidence_of(tables)))
    print(f"{summary.executed} runs executed, {summary.reused} from the store, in {duration_text(summary.wall_s)}")
    print(report_line(found.directory))
    if is_address(summary.results):
        print(f"uploaded to {summary.results}; what is here stays for a day")
