"""The command `minimize`: a failing configuration becomes a smallest one that still fails, and shows what its failure needs."""

import json
import sys
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from vastflow.flows.cli.run import command_line
from vastflow.flows.results.address import check_directory
from vastflow.flows.terminal.ending import FAULT, Interruptible, check_writable, writing
from vastflow.flows.terminal.options import AsJson, ResultsFolder, asking
from vastflow.sim.model.faults import UserError

if TYPE_CHECKING:
    from vastflow.flows.minimization.minimized import Minimized


@asking("store", "workers")
def minimize(
    results: ResultsFolder,
    configuration: Annotated[str, typer.Argument(metavar="CONFIGURATION", help="Name of a configuration that fails.")],
    asked: Mapping[str, Any],
    oracle: Annotated[
        str | None, typer.Option(metavar="NAME", help="Whose failures count, else the oracle that fails it most often.")
    ] = None,
    rate: Annotated[float, typer.Option(help="Least failure rate that is called failing, above 0 and below 1.")] = 0.5,
    out: Annotated[
        Path | None, typer.Option(metavar="FOLDER", help="Where it is written, else RESULTS/minimized/CONFIGURATION.")
    ] = None,
    as_json: AsJson = False,
) -> None:
    """Shrink a failing configuration to a smallest one that still fails.

    Leaves out obstacles, differences of the world, waypoints and parameters, brings what stays nearer to its default, and shortens
    the path, while a sequential test shows that it still fails. Writes a campaign file of what is left, and says what can't be left
    out. What is in the store already is not computed again. A robot must drive in it: a program as the system under test is refused.
    """
    check_directory(results)
    if not 0.0 < rate < 1.0:
        raise UserError(f"--rate {rate:g}: a failure rate above 0 and below 1")
    folder = out or results / "minimized" / configuration
    check_writable(folder, "--out")
    found = _minimized(results, configuration, oracle, rate, asked)
    with writing(folder, "--out"):
        written = [str(each) for each in found.write(folder)]
    from vastflow.flows.minimization.minimized import minimized_json, minimized_text

    if as_json:
        print(json.dumps(minimized_json(found, written)))
    else:
        for line in minimized_text(found, written):
            print(line)


def _minimized(
    results: Path, configuration: str, oracle: str | None, rate: float, asked: Mapping[str, Any]
) -> "Minimized":
    going_on = f"`{command_line(sys.argv)}` again computes only what is missing"
    with Interruptible(f"interrupted; {going_on}") as interruptible:
        from vastflow.flows.terminal.display import Display

        with Display() as display:
            interruptible.last_words_by(display.close)
            from vastflow.flows.minimization.minimize import minimize_configuration
            from vastflow.tasks.prefect.server import PrefectUnavailable

            try:
                return minimize_configuration(
                    results, configuration, oracle=oracle, rate=rate, observer=display, **asked
                )
            except PrefectUnavailable as error:
                display.close(f"{error}; {going_on}")
                raise typer.Exit(FAULT) from None
