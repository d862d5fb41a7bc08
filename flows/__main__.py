"""The console command `vastflow`.

A spawned worker may import this module again, and `--help` must not wait: Prefect, numba and the like are
imported inside the commands.
"""

import gc
import sys
from typing import Annotated, Any

import typer
from typer.core import TyperGroup

import vastflow
from vastflow.flows.cli.compare import compare
from vastflow.flows.cli.deploy import deploy
from vastflow.flows.cli.development import bench, paper
from vastflow.flows.cli.execution import execution
from vastflow.flows.cli.export import export
from vastflow.flows.cli.floorplan import floorplan
from vastflow.flows.cli.init import init
from vastflow.flows.cli.minimize import minimize
from vastflow.flows.cli.params import params
from vastflow.flows.cli.plan import coverage, explain, preview
from vastflow.flows.cli.replay import replay
from vastflow.flows.cli.run import resume, run
from vastflow.flows.cli.scenario import scenario
from vastflow.flows.cli.server import server
from vastflow.flows.cli.show import show
from vastflow.flows.cli.store import store
from vastflow.flows.cli.validate import schema, validate
from vastflow.flows.terminal.ending import BAD_INPUT
from vastflow.sim.model.faults import UserError
from vastflow.tasks.engine.process import few_collections


class Commands(TyperGroup):
    """Commands that a user's mistake ends with its words, and whose exit code is their own, whatever a plug-in does here."""

    def invoke(self, ctx: Any) -> Any:
        """Run a command; click's own ends are other exceptions than `SystemExit`."""
        try:
            return super().invoke(ctx)
        except UserError as error:
            print(error, file=sys.stderr)
            raise typer.Exit(BAD_INPUT) from None
        except SystemExit as error:
            print(f"a plug-in's code raised SystemExit({error.code!r}), which would end vastflow", file=sys.stderr)
            raise typer.Exit(3) from None


def _print_version(asked: bool) -> None:
    if asked:
        print(f"vastflow {vastflow.__version__}")
        raise typer.Exit


app = typer.Typer(
    cls=Commands,
    help="Find out whether a robot's navigation can be trusted: from a campaign file to evidence.",
    no_args_is_help=True,
    pretty_exceptions_enable=False,
    rich_markup_mode=None,  # a fifth of a second for a frame round the help
)


@app.callback()
def _options(
    version: Annotated[
        bool, typer.Option("--version", callback=_print_version, is_eager=True, help="Show the version and exit.")
    ] = False,
) -> None:
    """What `vastflow` itself takes, without a command."""


for command in (
    init,
    run,
    resume,
    validate,
    preview,
    coverage,
    schema,
    params,
    show,
    compare,
    explain,
    replay,
    minimize,
    export,
    paper,
    deploy,
):
    app.command()(command)
app.add_typer(bench, name="bench")
app.add_typer(execution, name="execution")
app.add_typer(floorplan, name="floorplan")
app.add_typer(scenario, name="scenario")
app.add_typer(server, name="server")
app.add_typer(store, name="store")


def main() -> None:
    """Run the command that the arguments name."""
    try:
        with few_collections():
            app()
    finally:
        gc.freeze()  # Python looks for garbage once more before it ends, which ends all of it anyway


if __name__ == "__main__":
    main()
