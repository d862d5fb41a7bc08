"""The command `export`: a campaign directory as a folder for each run, with JUnit reports."""

import sys
import time
from pathlib import Path
from typing import Annotated, Final

import typer

from vastflow.flows.terminal.ending import Interruptible, writing
from vastflow.flows.terminal.options import PlaceOfResults, configuration_names
from vastflow.flows.terminal.progress import count_text
from vastflow.sim.model.faults import UserError

PERIOD_S: Final = 5.0
"""Time between two lines of progress."""


def export(
    results: PlaceOfResults,
    folder: Annotated[Path, typer.Argument(metavar="FOLDER", help="A new folder, or an empty one.")],
    only: Annotated[
        list[str] | None,
        typer.Option(
            metavar="PATTERN",
            help="Families and configurations to export, such as 'room*' (may be repeated).",
            autocompletion=configuration_names,
        ),
    ] = None,
) -> None:
    """Export a campaign as a folder for each run.

    With JUnit reports, CSV files, logs, and output files of programs.
    """
    said_s = time.monotonic()

    def progress(done: int, of: int) -> None:
        nonlocal said_s
        if time.monotonic() - said_s >= PERIOD_S:
            said_s = time.monotonic()
            print(f"{done} of {of} configurations exported", file=sys.stderr)

    with Interruptible(f"Interrupted. {folder} is as it was."):
        from vastflow.flows.export.export import export as lay_out
        from vastflow.flows.results.address import at_hand, check_directory

        with at_hand(results, ("traces", "figures")) as directory:
            check_directory(directory)
            try:
                with writing(folder):
                    exported = lay_out(directory, folder, only or (), progress)
            except UserError as error:  # where the directory is a copy, it is the address that the user knows
                raise UserError(str(error).replace(str(directory), results)) from None
    runs = sum(len(suite.cases) for suite in exported.suites)
    failed, broken, unjudged = (
        sum(suite.count(kind) for suite in exported.suites) for kind in ("failure", "error", "skipped")
    )
    counts = {"passed": runs - failed - broken - unjudged, "failed": failed, "broken": broken, "not judged": unjudged}
    named = ", ".join(f"{n} {what}" for what, n in counts.items() if n or what in ("passed", "failed"))
    alike = f", {exported.duplicates} equal to another" if exported.duplicates else ""
    configurations = count_text(len(exported.suites) + exported.duplicates, "configuration")
    print(f"{configurations}{alike}; {runs} runs: {named}\nexported: {exported.folder}")
