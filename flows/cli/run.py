"""The commands `run` and `resume`: a campaign from file to report, or again from its own directory."""

import json
import os
import shlex
import sys
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Final

import typer

from vastflow.flows.request.run_request import NAMES, RunRequest, request_of
from vastflow.flows.results.address import check_directory, meant_address
from vastflow.flows.terminal.ending import FAULT, Interruptible, check_writable
from vastflow.flows.terminal.options import CampaignFile, asking
from vastflow.oracles.results.unusable import UnusableDirectory, reading
from vastflow.sim.model.faults import UserError

if TYPE_CHECKING:
    from vastflow.flows.results.summary import Results


def print_dry_run(request: RunRequest, *, since: Path | None, as_json: bool) -> None:
    """Print the dry run of a request."""
    from vastflow.flows.plan.dry_run import dry_run
    from vastflow.sim.plug_ins.effects import looking_only

    with Interruptible("interrupted; nothing was written"), looking_only():
        found = dry_run(
            Path(request.campaign),
            runs=request.runs,
            results=Path(request.results),
            store=request.store,
            only=request.only,
            sample=request.sample,
            map_dir=None if request.map_dir is None else Path(request.map_dir),
            as_v1=request.as_v1,
            strict=request.strict,
            since=since,
        )
    from vastflow.flows.plan.dry_run import dry_run_json, dry_run_text
    from vastflow.flows.terminal.outcome import printed

    if as_json:
        print(json.dumps(dry_run_json(found, Path(request.campaign)), ensure_ascii=False))
    else:
        printed(dry_run_text(found))


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
    from vastflow.tasks.store.store import is_address

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
    from vastflow.flows.results.answer import kept_answer

    return kept_answer(request)


def _run(request: RunRequest) -> "Results":
    going_on = f"`{command_line(sys.argv)}` again computes only what is missing"
    with Interruptible(f"interrupted; {going_on}") as interruptible:
        from vastflow.flows.terminal.display import Display

        with Display() as display:
            interruptible.last_words_by(display.close)
            from vastflow.flows import run_campaign
            from vastflow.flows.request.work_pool import WorkersFailed
            from vastflow.tasks.prefect.server import PrefectUnavailable

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
    from vastflow.flows.cli.show import report_line
    from vastflow.flows.terminal.display import duration_text
    from vastflow.flows.terminal.outcome import outcome, printed
    from vastflow.oracles.evidence.evidence import evidence_of
    from vastflow.oracles.results.tables import read_tables
    from vastflow.tasks.store.store import is_address

    tables, summary = read_tables(found.directory), found.summary
    printed(outcome(tables, evidence_of(tables)))
    print(f"{summary.executed} runs executed, {summary.reused} from the store, in {duration_text(summary.wall_s)}")
    print(report_line(found.directory))
    if is_address(summary.results):
        print(f"uploaded to {summary.results}; what is here stays for a day")


@asking("store", "workers", "pool", "shards", "pool_wait_s")
def resume(
    results: Annotated[
        Path, typer.Argument(metavar="RESULTS", help="A campaign directory, or one that a killed process left half.")
    ],
    asked: Mapping[str, Any],
    as_json: Annotated[bool, typer.Option("--json", help="Print a JSON summary and nothing else.")] = False,
) -> None:
    """Run a campaign again from the inputs in its directory.

    With the runs and the selection it was asked for; what is in the store is not computed again. A new campaign
    directory is made beside it.
    """
    asked_request(results, asked)  # what is wrong with it is said before anything is read
    directory = _directory(results)
    from vastflow.flows.request.asked import asked_of
    from vastflow.flows.results.inputs import replica
    from vastflow.sim.model.files import read_json

    with reading(directory):
        metadata = read_json(directory / "metadata.json")
        before, title = asked_of(metadata), f"{metadata['name']} of {metadata['created'].replace('T', ' ')}"
    only = f", only {', '.join(before.only)}" if before.only else ""
    only += "" if before.sample is None else f", a sample of {before.sample}"
    only += ", obstacles as version 1 of RoboVAST places them" if before.as_v1 else ""
    runs = f"{before.runs} run{'' if before.runs == 1 else 's'} of each configuration{' at most' * before.sequential}"
    print(f"{title} from the inputs in {directory}, {runs}{only}", file=sys.stderr)
    selected = {
        "runs": before.fixed_runs,
        "results": directory.parent,
        "only": before.only,
        "sample": before.sample,
        "as_v1": before.as_v1,
    }
    with replica(directory, before) as laid_out:
        request = asked_request(laid_out.file, {**asked, **selected, "map_dir": laid_out.map_dir})
        run_and_show(request, as_json)


def _directory(results: Path) -> Path:
    """The campaign directory that is meant; a half written one where there is no whole one."""
    from vastflow.flows.results.directory import left_behind

    if meant_address(results):
        check_directory(results)
    half = left_behind(results)
    if half is not None and (half == results or not results.exists()):
        return _half_written(half)
    if not results.exists():
        raise UnusableDirectory(
            f"{results}: no such folder; a campaign that did not end has none: `vastflow run` with its campaign file goes "
            "on where it was, and computes only what is missing"
        )
    check_directory(results)
    return results


def _half_written(half: Path) -> Path:
    from vastflow.flows.results.directory import writer_of

    if writer := writer_of(half):
        raise UnusableDirectory(f"{half}: process {writer} is writing it now; wait for it, or end it first")
    if not all((half / name).is_file() for name in ("campaign.vast", "metadata.json")):
        raise UnusableDirectory(
            f"{half}: holds too little to go on from; `vastflow run` with the campaign file computes only what is missing"
        )
    print(f"{half} was left half written by a process that was killed", file=sys.stderr)
    return half
