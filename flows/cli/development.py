"""The commands `dev bench` and `dev paper`: scripts of the repository that measure and compare, which no wheel has."""

import os
import sys
from pathlib import Path
from typing import Annotated, Final, NoReturn

import typer

from vastflow.flows.terminal.options import AsJson, command_group
from vastflow.sim.model.faults import UserError

PROOFS: Final = Path(__file__).resolve().parents[2] / "tests" / "proofs"


def run_script(command: str, name: str, *arguments: object) -> NoReturn:
    """Replace this process by a script of `tests/proofs`.

    Args:
        command: The called command, for the message where there is no such script.
    """
    script = PROOFS / f"{name}.py"
    if not script.is_file():
        raise UserError(
            f"vastflow {command}: expected a clone of vastflow's repository, which has tests/proofs/{name}.py; "
            "call it there, after `pip install -e .`"
        )
    sys.stdout.flush()
    os.execv(sys.executable, [sys.executable, str(script), *map(str, arguments)])


dev = command_group("Measure and compare; these need a clone of the repository.")
bench = command_group("Measure speed on this machine.")
dev.add_typer(bench, name="bench")


@bench.command()
def sim(
    controller: Annotated[str, typer.Option(help="Controller to drive with: mppi, dwb or rpp.")] = "mppi",
    profile: Annotated[bool, typer.Option(help="Show the duration of each stage of a tick.")] = False,
    as_json: AsJson = False,
) -> None:
    """Measure the simulator.

    CPU time of one fixed scenario on one core. Needs a clone of the repository.
    """
    flags = ["--profile"] * profile + ["--json"] * as_json
    run_script("dev bench sim", "bench_simulator", f"--controller={controller}", *flags)


@bench.command()
def pipeline(
    configurations: Annotated[int, typer.Option(min=2, help="Configurations of the campaign.")] = 5480,
    runs: Annotated[int, typer.Option(min=1, help="Runs of each.")] = 20,
    as_json: AsJson = False,
) -> None:
    """Measure the pipeline.

    A campaign whose runs do nothing: computed, run again, and run after an edit of one configuration. Takes minutes. Needs a
    clone of the repository.
    """
    flags = ["--json"] * as_json
    run_script("dev bench pipeline", "bench_pipeline", f"--configurations={configurations}", f"--runs={runs}", *flags)


@dev.command()
def paper(
    results: Annotated[
        list[Path], typer.Argument(metavar="RESULTS...", help="Campaign directories of campaigns in campaigns/paper.")
    ],
) -> None:
    """Print a page that compares results with the paper's.

    Markdown on standard output. Needs a clone of the repository.
    """
    run_script("dev paper", "paper_page", "--", *results)
