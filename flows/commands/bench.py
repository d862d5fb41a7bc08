"""The command `bench`: measured speed, with everything that was fixed to measure it."""

import json
import sys
from collections.abc import Iterator, Mapping
from typing import Annotated, Any

import typer

bench = typer.Typer(help="Measure speed on this machine.", no_args_is_help=True, rich_markup_mode=None)


@bench.command()
def sim(
    controller: Annotated[str, typer.Option(help="Controller to drive with: mppi, dwb or rpp.")] = "mppi",
    profile: Annotated[bool, typer.Option(help="Say which stage of a tick takes how long.")] = False,
    as_json: Annotated[bool, typer.Option("--json", help="Print JSON and nothing else.")] = False,
) -> None:
    """Measure the simulator.

    One fixed scenario on one core, in CPU time, with everything that was fixed.
    """
    from vastflow.sim.bench import bench as measure

    try:
        found = measure(controller, profile=profile)
    except ValueError as error:
        print(f"vastflow bench sim: {error}", file=sys.stderr)
        raise typer.Exit(2) from None
    _show(found, as_json)


@bench.command()
def pipeline(
    configurations: Annotated[int, typer.Option(min=2, help="Configurations of the campaign.")] = 5480,
    runs: Annotated[int, typer.Option(min=1, help="Runs of each.")] = 20,
    as_json: Annotated[bool, typer.Option("--json", help="Print JSON and nothing else.")] = False,
) -> None:
    """Measure the pipeline.

    A campaign whose runs do nothing: computed, run again, and run with one configuration edited. It takes minutes.
    """
    from vastflow.flows.pipeline_bench import bench_pipeline

    _show(bench_pipeline(configurations, runs), as_json)


def _show(found: Mapping[str, Any], as_json: bool) -> None:
    if as_json:
        print(json.dumps(found))
        return
    rows = list(_rows("", found))
    width = max(len(name) for name, _ in rows)
    for name, text in rows:
        print(f"{name:<{width}}  {text}")


def _rows(prefix: str, values: Mapping[str, Any]) -> Iterator[tuple[str, str]]:
    for name, value in values.items():
        if isinstance(value, Mapping):
            yield from _rows(f"{prefix}{name}.", value)
        else:
            yield prefix + name, f"{value:.4g}" if isinstance(value, float) else str(value)
