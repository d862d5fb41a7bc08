"""The console command `vastflow`.

A spawned worker may import this module again, and `--help` must not wait: Prefect, numba and the like are
imported inside the commands.
"""

import gc
import signal
import sys
import warnings
from importlib.metadata import EntryPoint, entry_points
from importlib.metadata import version as version_of
from typing import Annotated, Any, Final

import typer
from typer.core import TyperGroup
from typer.main import get_command

from vastflow.flows.cli.benchmark import benchmark
from vastflow.flows.cli.calibrate import calibrate
from vastflow.flows.cli.compare import compare
from vastflow.flows.cli.deploy import deploy
from vastflow.flows.cli.export import export
from vastflow.flows.cli.floorplan import floorplan
from vastflow.flows.cli.import_bag import import_bag
from vastflow.flows.cli.init import init
from vastflow.flows.cli.minimize import minimize
from vastflow.flows.cli.notebook import notebook
from vastflow.flows.cli.params import params
from vastflow.flows.cli.plan import plan
from vastflow.flows.cli.publish import publish
from vastflow.flows.cli.replay import replay
from vastflow.flows.cli.report_failure import repeat_failure, report_failure
from vastflow.flows.cli.run import run
from vastflow.flows.cli.scenario import scenario
from vastflow.flows.cli.show import show
from vastflow.flows.cli.store import store
from vastflow.flows.cli.validate import validate
from vastflow.flows.cli.verify import verify
from vastflow.flows.terminal.ending import BAD_INPUT, print_error
from vastflow.flows.terminal.options import with_stages
from vastflow.sim.model.faults import UserError
from vastflow.tasks.engine.process import few_collections, return_freed_memory

GROUP: Final = "vastflow.commands"
"""Entry points of commands of higher layers, functions as typer takes them; only what they import at once must be light."""


class Commands(TyperGroup):
    """Commands that report user errors without a traceback, and keep their exit codes when a plug-in raises `SystemExit`."""

    def list_commands(self, ctx: Any) -> list[str]:
        """Return the names of this layer's commands, then those of the entry points."""
        own = super().list_commands(ctx)
        return [*own, *sorted({entry.name for entry in entry_points(group=GROUP)} - {*own})]

    def get_command(self, ctx: Any, cmd_name: str) -> Any:
        """Return a command of this layer, or else of an entry point."""
        # Looked up no earlier, as it takes 10 ms.
        return super().get_command(ctx, cmd_name) or next(map(_loaded, entry_points(group=GROUP, name=cmd_name)), None)

    def resolve_command(self, ctx: Any, args: list[str]) -> Any:
        """Find a command; a stage after `--force` is its value."""
        return super().resolve_command(ctx, with_stages(args))

    def invoke(self, ctx: Any) -> Any:
        """Run a command; click's own ends are other exceptions than `SystemExit`."""
        try:
            return super().invoke(ctx)
        except UserError as error:
            print_error(error)
            raise typer.Exit(BAD_INPUT) from None
        except SystemExit as error:
            print(f"a plug-in's code raised SystemExit({error.code!r}), which would end vastflow", file=sys.stderr)
            raise typer.Exit(3) from None


def _loaded(entry: EntryPoint) -> Any:
    alone = typer.Typer(add_completion=False, rich_markup_mode=None)
    alone.command(entry.name)(entry.load())
    return get_command(alone)


def _print_version(asked: bool) -> None:
    if asked:
        print(f"vastflow {version_of('vastflow')}")
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
    """Options of `vastflow` without a command."""


for command in (
    *(init, validate, plan, run, show, replay, compare, benchmark, minimize, report_failure, repeat_failure),
    *(export, notebook, publish, verify, params, deploy),
):
    app.command()(command)
app.command("import")(import_bag)
app.command()(calibrate)
app.add_typer(store, name="store")
app.add_typer(floorplan, name="floorplan")
app.add_typer(scenario, name="scenario")


def main() -> None:
    """Run the command that the arguments name."""
    return_freed_memory()
    # Python shows none that a module raises, and a plug-in is one.
    warnings.filterwarnings("default", r"vastflow\.", DeprecationWarning)
    try:
        with few_collections():
            app()
    finally:
        signal.signal(signal.SIGINT, signal.SIG_IGN)  # a second Ctrl-C would print tracebacks of Python's own end
        gc.freeze()  # Python looks for garbage once more before it ends, which ends all of it anyway


if __name__ == "__main__":
    main()
