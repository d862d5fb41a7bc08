"""The command `plan`: the work of a run and its reasons, without executing it."""

import json
import sys
from collections.abc import Mapping
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Annotated, Any

import typer

from vastflow.flows.cli.consent import Trust
from vastflow.flows.cli.run import Campaign, is_directory, requested
from vastflow.flows.results.address import check_directory
from vastflow.flows.terminal.ending import Interruptible, check_writable, writing
from vastflow.flows.terminal.options import AsJson, Out, asking


@asking("runs", "results", "store", "only", "sample", "map_dir", "strict", "force")
def plan(
    source: Campaign,
    asked: Mapping[str, Any],
    why: Annotated[bool, typer.Option("--why", help="Show why results would be computed.")] = False,
    coverage: Annotated[
        bool, typer.Option("--coverage", help="Show the coverage of each dimension and pair of producers.")
    ] = False,
    pictures: Annotated[int, typer.Option(min=0, metavar="N", help="Draw the first N configurations.")] = 0,
    out: Out = None,
    since: Annotated[
        Path | None, typer.Option(metavar="RESULTS", help="Campaign to compare with (default: the newest earlier one).")
    ] = None,
    trust: Trust = False,
    as_json: AsJson = False,
) -> None:
    """Show what a run would do, without running it.

    Configurations, rejections, exclusions, cached results, and what would be computed. Pictures go to pictures-NAME.
    """
    if since is not None:
        check_directory(since, "--since")
    with Interruptible("interrupted"):
        if out is not None:
            check_writable(out, "--out")
        from vastflow.flows.plan.plan import draw, plan_of
        from vastflow.flows.plan.text import plan_json, plan_text
        from vastflow.flows.results.directory import directory_name
        from vastflow.flows.terminal.display import print_rows

        with requested(source, asked, trust) as request, TemporaryDirectory(prefix="vastflow-") as environments:
            found = plan_of(request, Path(environments), since or (source if is_directory(source) else None))
            for fault in found.unexecutable:
                print(f"this version can't run the file: {fault}", file=sys.stderr)
            if not as_json:
                print_rows(plan_text(found, why=why, coverage=coverage))
            folder = out or Path(f"pictures-{directory_name(found.name)}")
            with writing(folder, "--out"):
                drawn = [str(path) for path in draw(found.distinct[:pictures], folder)]
        if as_json:
            print(json.dumps(plan_json(found, str(source)) | {"pictures": drawn}, ensure_ascii=False))
        elif drawn:
            print("\npictures:", *drawn, sep="\n")
