"""The commands `report-failure` and `repeat-failure`: a failed run to send to somebody else, and executed there again."""

from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Any, Final

import typer

from vastflow.flows.cli.consent import Trust, executing
from vastflow.flows.cli.run import computing
from vastflow.flows.results.address import check_directory
from vastflow.flows.terminal.ending import Interruptible, check_writable, writing
from vastflow.flows.terminal.options import ResultsFolder, asking, configuration_and_run, run_names
from vastflow.sim.model.faults import UserError

FOR_S: Final = 300.0


@asking("store", "workers")
def report_failure(
    results: ResultsFolder,
    run: Annotated[
        str,
        typer.Argument(
            metavar="CONFIGURATION/RUN", help="A run that failed, such as room-1/3.", autocompletion=run_names
        ),
    ],
    asked: Mapping[str, Any],
    out: Annotated[
        Path | None,
        typer.Argument(
            metavar="OUT", help="A new folder, or a new archive that ends in .zip; RESULTS/failures by default."
        ),
    ] = None,
    for_s: Annotated[
        float,
        typer.Option("--for", metavar="SECONDS", help="Time to minimize in; what was found by then counts.", min=0.0),
    ] = FOR_S,
    no_minimize: Annotated[
        bool, typer.Option("--no-minimize", help="Report the run without a smaller campaign.")
    ] = False,
    trust: Trust = False,
) -> None:
    """Write a failed run as a report of at most 1 MB that somebody else can repeat.

    A README, a campaign that gives the same recording byte for byte, the minimized campaign, the Nav2 parameters that matter, a bag of
    ROS 2 messages, and a film. Needs the extra `ros`.
    """
    check_directory(results)
    configuration, index = configuration_and_run(run)
    place = out or results / "failures" / f"{configuration}-{index}"
    check_writable(place.parent, "OUT")
    from vastflow.flows.export.export import refuse

    if place.suffix == ".zip" and place.exists():
        raise UserError(f"{place}: expected a new file, got one that exists")
    if place.suffix != ".zip":
        refuse(place)
    with executing(results, trust), computing() as display:
        from vastflow.flows.export.mcap.topics import typestore
        from vastflow.flows.failure.failed_run import failed_run
        from vastflow.flows.failure.report import minimized, report_of
        from vastflow.flows.results.inputs import write_files

        failed = failed_run(results, configuration, index)
        typestore()  # a missing extra is said before runs are executed
        smaller, words = dict[str, bytes](), "It is not minimized: --no-minimize was given."
        if not no_minimize:
            smaller, words = minimized(failed, for_s, display, **asked)
        report = report_of(failed, smaller, words)
    with writing(place):
        place.parent.mkdir(parents=True, exist_ok=True)
        if place.suffix == ".zip":
            place.write_bytes(report.zipped())
        else:
            write_files(place, report.files)
    print(f"{configuration}, run {index}: repeated from the report, equal to the recording byte for byte")
    print(f"{failed.rate_text} fail\n{words}", *(f"left out: {each}" for each in report.left_out), sep="\n")
    print(f"written: {place}, {len(report.zipped()):,} bytes packed")


def repeat_failure(
    folder: Annotated[Path, typer.Argument(metavar="FOLDER", help="An unpacked report of `vastflow report-failure`.")],
    trust: Annotated[
        bool, typer.Option("--trust", help="Execute code in FOLDER, such as plug-ins and programs.")
    ] = False,
) -> None:
    """Execute a reported failure again; exit code 1 if the recording is another one."""
    with Interruptible("interrupted"):
        from vastflow.flows.failure.failed_run import repeat_run

        recorded, difference = repeat_run(folder, trust)
    told = recorded.run
    if difference is not None:
        print(f"NOT THE RECORDED RUN: {difference}")
        raise typer.Exit(1)
    print(
        f"equal: the run executed here is the recorded one, byte for byte\n{told.outcome.replace('_', ' ')}: {told.reason}"
    )
