"""The command `bench`: measured speed, with everything that was fixed to measure it."""

from typing import Annotated

import typer

from vastflow.flows.commands.checkout import run_script
from vastflow.flows.terminal.options import AsJson

bench = typer.Typer(help="Measure speed on this machine.", no_args_is_help=True, rich_markup_mode=None)


@bench.command()
def sim(
    controller: Annotated[str, typer.Option(help="Controller to drive with: mppi, dwb or rpp.")] = "mppi",
    profile: Annotated[bool, typer.Option(help="Say which stage of a tick takes how long.")] = False,
    as_json: AsJson = False,
) -> None:
    """Measure the simulator.

    One fixed scenario on one core, in CPU time, with everything that was fixed. Needs a clone of the repository.
    """
    flags = ["--profile"] * profile + ["--json"] * as_json
    run_script("bench sim", "bench_simulator", f"--controller={controller}", *flags)


@bench.command()
def pipeline(
    configurations: Annotated[int, typer.Option(min=2, help="Configurations of the campaign.")] = 5480,
    runs: Annotated[int, typer.Option(min=1, help="Runs of each.")] = 20,
    as_json: AsJson = False,
) -> None:
    """Measure the pipeline.

    A campaign whose runs do nothing: computed, run again, and run with one configuration edited. It takes minutes and
    needs a clone of the repository.
    """
    flags = ["--json"] * as_json
    run_script("bench pipeline", "bench_pipeline", f"--configurations={configurations}", f"--runs={runs}", *flags)
