"""The command `export`: a campaign directory in a format that other tools read."""

import sys
import time
from pathlib import Path
from typing import Annotated, Final

import typer

from vastflow.flows.cli.consent import Trust, executing
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
            help="Families and configurations to export, such as 'room*', or one run, as in room-1/3 (may be repeated).",
            autocompletion=configuration_names,
        ),
    ] = None,
    form: Annotated[
        str,
        typer.Option(
            "--format",
            metavar="NAME",
            help="`vast`: a folder for each run, with JUnit reports, CSV files, logs, and output files of programs; `junit`: one "
            "report; `csv`: the tables alone; `mcap`: bags of ROS 2 for Foxglove and RViz, for which runs are executed again; an installed format; or file.py:Class of your own.",
        ),
    ] = "vast",
    trust: Trust = False,
) -> None:
    """Export a campaign for other tools."""
    said_s = time.monotonic()

    def progress(done: int, of: int) -> None:
        nonlocal said_s
        if time.monotonic() - said_s >= PERIOD_S:
            said_s = time.monotonic()
            print(f"{done} of {of} configurations exported", file=sys.stderr)

    with Interruptible(f"Interrupted. {folder} is as it was."):
        from vastflow.flows.export.export import export as lay_out
        from vastflow.flows.export.format import format_of
        from vastflow.flows.results.address import at_hand, check_directory

        chosen = format_of(form, Path())
        with at_hand(results, ("traces", "figures")) as directory:
            check_directory(directory)
            try:
                with executing(directory, trust, code=chosen.executes), writing(folder):
                    exported = lay_out(directory, folder, only or (), progress, chosen)
            except UserError as error:  # where the directory is a copy, it is the address that the user knows
                raise UserError(str(error).replace(str(directory), results)) from None
    flaws = exported.flaws
    counts = {
        "passed": flaws[None],
        "failed": flaws["failure"],
        "broken": flaws["error"],
        "not judged": flaws["skipped"],
    }
    named = ", ".join(f"{n} {what}" for what, n in counts.items() if n or what in ("passed", "failed"))
    alike = f", {exported.duplicates} equal to another" if exported.duplicates else ""
    configurations = count_text(len(exported.names), "configuration")
    print(f"{configurations}{alike}; {sum(counts.values())} runs: {named}\nexported: {exported.folder}")
