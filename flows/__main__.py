"""The console command `vastflow`.

A spawned worker may import this module again, and `--help` must not wait: Prefect, numba and the like are
imported inside the commands.
"""

import typer

from vastflow.flows.bench_command import bench
from vastflow.flows.compare_command import compare
from vastflow.flows.coverage_command import coverage
from vastflow.flows.deploy_command import deploy
from vastflow.flows.execution_command import execution
from vastflow.flows.explain_command import explain
from vastflow.flows.export_command import export
from vastflow.flows.file_commands import schema, validate
from vastflow.flows.floorplan_command import floorplan
from vastflow.flows.paper_command import paper
from vastflow.flows.params_command import params
from vastflow.flows.preview_command import preview
from vastflow.flows.replay_command import replay
from vastflow.flows.resume_command import resume
from vastflow.flows.run_command import run
from vastflow.flows.scenario_command import scenario
from vastflow.flows.show_command import show
from vastflow.flows.store_command import store

app = typer.Typer(
    help="Find out whether a robot's navigation can be trusted: from a campaign file to evidence.",
    no_args_is_help=True,
    add_completion=False,
    pretty_exceptions_enable=False,
    rich_markup_mode=None,  # a fifth of a second for a frame round the help
)
for command in (
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
    export,
    paper,
    deploy,
):
    app.command()(command)
app.add_typer(bench, name="bench")
app.add_typer(execution, name="execution")
app.add_typer(floorplan, name="floorplan")
app.add_typer(scenario, name="scenario")
app.add_typer(store, name="store")


def main() -> None:
    """Run the command that the arguments name."""
    app()


if __name__ == "__main__":
    main()
