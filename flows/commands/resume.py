"""The command `resume`: a campaign again from its own directory."""

import sys
from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Any

import typer

from vastflow.flows.commands.run import asked_request, run_and_show
from vastflow.flows.results.at_hand import check_directory, meant_address
from vastflow.flows.terminal.request_options import asking
from vastflow.oracles.directory.unusable import UnusableDirectory, reading


@asking("store", "workers", "pool", "shards", "pool_wait_s")
def resume(
    results: Annotated[
        Path, typer.Argument(metavar="RESULTS", help="A campaign directory, or one that a killed process left half.")
    ],
    asked: Mapping[str, Any],
    as_json: Annotated[bool, typer.Option("--json", help="Print a JSON summary and nothing else.")] = False,
) -> None:
    """Run a campaign again from the inputs in its directory.

    With the runs and the selection it was asked for; what is in the store is not computed again. A new campaign
    directory is made beside it.
    """
    asked_request(results, asked)  # what is wrong with it is said before anything is read
    directory = _directory(results)
    from vastflow.flows.request.asked import asked_of
    from vastflow.flows.results.replica import replica
    from vastflow.sim.model.files import read_json

    with reading(directory):
        metadata = read_json(directory / "metadata.json")
        before, title = asked_of(metadata), f"{metadata['name']} of {metadata['created'].replace('T', ' ')}"
    only = f", only {', '.join(before.only)}" if before.only else ""
    only += "" if before.sample is None else f", a sample of {before.sample}"
    only += ", obstacles as version 1 of RoboVAST places them" if before.as_v1 else ""
    runs = f"{before.runs} run{'' if before.runs == 1 else 's'} of each configuration{' at most' * before.sequential}"
    print(f"{title} from the inputs in {directory}, {runs}{only}", file=sys.stderr)
    selected = {
        "runs": before.fixed_runs,
        "results": directory.parent,
        "only": before.only,
        "sample": before.sample,
        "as_v1": before.as_v1,
    }
    with replica(directory, before) as laid_out:
        request = asked_request(laid_out.file, {**asked, **selected, "map_dir": laid_out.map_dir})
        run_and_show(request, as_json)


def _directory(results: Path) -> Path:
    """The campaign directory that is meant; a half written one where there is no whole one."""
    from vastflow.flows.results.directory import left_behind

    if meant_address(results):
        check_directory(results)
    half = left_behind(results)
    if half is not None and (half == results or not results.exists()):
        return _half_written(half)
    if not results.exists():
        raise UnusableDirectory(
            f"{results}: no such folder; a campaign that did not end has none: `vastflow run` with its campaign file goes "
            "on where it was, and computes only what is missing"
        )
    check_directory(results)
    return results


def _half_written(half: Path) -> Path:
    from vastflow.flows.results.directory import writer_of

    if writer := writer_of(half):
        raise UnusableDirectory(f"{half}: process {writer} is writing it now; wait for it, or end it first")
    if not all((half / name).is_file() for name in ("campaign.vast", "metadata.json")):
        raise UnusableDirectory(
            f"{half}: holds too little to go on from; `vastflow run` with the campaign file computes only what is missing"
        )
    print(f"{half} was left half written by a process that was killed", file=sys.stderr)
    return half
