"""The commands `dev bench` and `dev paper`: scripts of the repository that measure and compare, which no wheel has."""

import os
import sys
from pathlib import Path
from typing import Final

import typer

from vastflow.flows.terminal.options import command_group
from vastflow.sim.model.faults import UserError

PROOFS: Final = Path(__file__).resolve().parents[2] / "tests" / "proofs"
dev = command_group("Measure and compare; these need a clone of the repository.")
bench = command_group("Measure speed on this machine.")
dev.add_typer(bench, name="bench")


def _script(group: typer.Typer, command: str, name: str, summary: str) -> None:
    """Add a command that replaces this process by a script of `tests/proofs`, which takes the options."""
    settings = {"allow_extra_args": True, "ignore_unknown_options": True}

    @group.command(command, help=summary, context_settings=settings, add_help_option=False)
    def run(context: typer.Context) -> None:
        script = PROOFS / f"{name}.py"
        if not script.is_file():
            raise UserError(
                f"vastflow dev: expected a clone of vastflow's repository, which has tests/proofs/{name}.py; "
                "call it there, after `pip install -e .`"
            )
        sys.stdout.flush()
        os.execv(sys.executable, [sys.executable, str(script), *context.args])


_script(bench, "sim", "bench_simulator", "Measure the CPU time of the simulator on one fixed scenario.")
_script(bench, "pipeline", "bench_pipeline", "Measure the pipeline with runs that do nothing, which takes minutes.")
_script(bench, "cluster", "bench_cluster", "Measure how busy a Dask cluster's workers are, by units that sleep.")
_script(bench, "ui", "bench_ui", "Measure the explorer's views of a synthetic campaign, with random filters.")
_script(dev, "paper", "paper_page", "Print a Markdown page that compares results with the paper's.")
