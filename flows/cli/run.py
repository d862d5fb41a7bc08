"""The command `run`: a campaign from file to report, or again from its own directory."""

import os
import shlex
import sys
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Final, TypeAlias

import typer

from vastflow.flows.cli.consent import Trust, executing
from vastflow.flows.request.run_request import NAMES, RunRequest, request_of
from vastflow.flows.results.address import check_directory, meant_address
from vastflow.flows.terminal.ending import FAULT, INTERRUPTED, Interruptible, check_writable
from vastflow.flows.terminal.options import AsJson, asking
from vastflow.flows.terminal.progress import count_text
from vastflow.oracles.results.unusable import UnusableDirectory, reading
from vastflow.sim.model.faults import UserError

if TYPE_CHECKING:
    from vastflow.flows.terminal.display import Display


OPTIONS: Final = tuple(name for name in NAMES if name != "reports")
MACHINE: Final = ("store", "workers", "cluster", "force")
"""Options that choose where and whether runs are computed, the only ones that a campaign directory takes."""


Campaign: TypeAlias = Annotated[
    Path,
    typer.Argument(metavar="FILE|RESULTS", help="Campaign file, or campaign directory to run again."),
]


@asking(*OPTIONS)
def run(
    source: Campaign,
    asked: Mapping[str, Any],
    trust: Trust = False,
    as_json: AsJson = False,
    open_report: Annotated[
        bool, typer.Option("--open", help="Open the report in the browser at the end, unless $CI is set.")
    ] = False,
) -> None:
    """Run a campaign and write its report.

    Cached results are not computed again. A campaign directory is run again from its own inputs, with its number of runs and
    selection; the new directory is written beside it.
    """
    with requested(source, asked, trust) as request:
        run_and_show(request, as_json, open_report=open_report)


def is_directory(source: Path) -> bool:
    """Whether `source` is a campaign directory, possibly half written, and not a campaign file."""
    if source.is_file():
        return False
    from vastflow.flows.results.directory import left_behind

    return not source.suffix or source.is_dir() or bool(meant_address(source) or left_behind(source))


@contextmanager
def requested(source: Path, asked: Mapping[str, Any], trust: bool) -> Iterator[RunRequest]:
    """Yield the request for a campaign file with options, or for a directory as it was run.

    Code of the directory is executed only if the user permits it.
    """
    if not is_directory(source):
        yield asked_request(source, asked)
        return
    for name, value in asked.items():
        if name not in MACHINE and (value or None) != (RunRequest.model_fields[name].get_default() or None):
            flag = f"--{name.replace('_', '-')}"
            raise UserError(f"{flag}: expected a campaign file, got {source}, which is run as it was before")
    asked_request(source, asked)  # report wrong options before anything is read
    directory = _directory(source)
    from vastflow.flows.request.run_request import asked_of
    from vastflow.flows.results.inputs import replica
    from vastflow.sim.model.files import read_json

    with reading(directory):
        metadata = read_json(directory / "metadata.json")
        before, title = asked_of(metadata), f"{metadata['name']} of {metadata['created'].replace('T', ' ')}"
    if metadata["asked"].get("as_v1"):
        raise UserError(
            f"{directory}: It was run with --as-v1, which is gone. Write placement: as_v1 into a campaign file."
        )
    only = f", only {', '.join(before.only)}" if before.only else ""
    only += "" if before.sample is None else f", a sample of {before.sample}"
    runs = f"{count_text(before.runs, 'run')} of each configuration{' at most' * before.sequential}"
    print(f"{title} from the inputs in {directory}, {runs}{only}", file=sys.stderr)
    selected = {name: getattr(before, name) for name in ("only", "sample")} | {"runs": before.fixed_runs}
    with executing(directory, trust), replica(directory, before) as laid_out:
        places = {"results": directory.parent, "map_dir": laid_out.map_dir}
        yield asked_request(laid_out.file, {**asked, **selected, **places})


def asked_request(file: Path, asked: Mapping[str, Any]) -> RunRequest:
    """Return the request of these options, or raise `UserError` for a wrong one."""
    try:
        return request_of(file, asked)
    except ValueError as error:
        raise UserError(str(error)) from None


def run_and_show(request: RunRequest, as_json: bool, *, open_report: bool = False) -> None:
    """Run a campaign with a display, print its outcome, and exit with 3 after faults."""
    from vastflow.tasks.store.store import is_address

    if not is_address(request.results):
        check_writable(Path(request.results), "--results")
    with computing(request.force is not None) as display:
        from vastflow.flows import run_campaign

        found = run_campaign(request, observer=display)
    for note in found.notes:
        print(note, file=sys.stderr)
    if as_json:
        print(found.summary.json_text())
    else:
        from vastflow.flows.cli.show import report_line
        from vastflow.flows.terminal.display import print_rows
        from vastflow.flows.terminal.outcome import outcome
        from vastflow.flows.terminal.progress import duration_text
        from vastflow.oracles.evidence.evidence import evidence_of
        from vastflow.oracles.results.tables import read_tables

        tables, summary = read_tables(found.directory), found.summary
        print_rows(outcome(tables, evidence_of(tables)))
        print(f"{summary.executed} runs executed, {summary.reused} from the store, in {duration_text(summary.wall_s)}")
        print(report_line(found.directory))
        if is_address(summary.results):
            print(f"uploaded to {summary.results} (the local copy stays for a day)")
    if open_report and not os.environ.get("CI"):
        import webbrowser

        report = found.directory / "report.html"
        if not (report.exists() and webbrowser.open(report.absolute().as_uri())):
            print(f"--open: no browser opens {report}", file=sys.stderr)
    if found.faults:
        raise typer.Exit(FAULT)


@contextmanager
def computing(forced: bool = False) -> "Iterator[Display]":
    """Show the progress of the body; after an interrupt or a lost API, print the command that resumes."""
    without = " without --force" * forced
    going_on = f"`{shlex.join(['vastflow', *sys.argv[1:]])}`{without} again computes only what is missing"
    with Interruptible(f"Interrupted. {going_on}.") as interruptible:
        from vastflow.flows.terminal.display import Display

        with Display() as display:
            interruptible.last_words_by(display.close)
            from vastflow.flows.run.event_log import CampaignStopped
            from vastflow.tasks.engine.executor import ClusterError
            from vastflow.tasks.prefect.server import PrefectUnavailable

            try:
                yield display
            except CampaignStopped as stopped:
                display.close(f"{stopped}. {going_on}.")
                raise typer.Exit(INTERRUPTED) from None
            except (PrefectUnavailable, ClusterError) as error:
                display.close(f"{error} {going_on}.")
                raise typer.Exit(FAULT) from None


def _directory(results: Path) -> Path:
    """Return the campaign directory, or an incomplete one if there is no other."""
    from vastflow.flows.results.directory import left_behind
    from vastflow.oracles.results.unfinished import writer_of

    if meant_address(results):
        check_directory(results)
    half = left_behind(results)
    if half is not None and (half == results or not results.exists()):
        if writer := writer_of(half):
            raise UnusableDirectory(f"{half}: Process {writer} is writing it. Wait for it or end it first.")
        if not all((half / name).is_file() for name in ("campaign.vast", "metadata.json")):
            raise UnusableDirectory(
                f"{half}: The campaign directory is incomplete. Give `vastflow run` the campaign file: only what is missing is computed."
            )
        print(f"{half} was left incomplete by a killed process", file=sys.stderr)
        return half
    if not results.exists():
        raise UnusableDirectory(
            f"{results}: No such folder. Give `vastflow run` the campaign file of an interrupted campaign: only what is "
            "missing is computed."
        )
    check_directory(results)
    return results
