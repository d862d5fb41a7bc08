"""The command `show`: a finished campaign in the terminal."""

import sys
from pathlib import Path
from typing import Annotated, Final

import typer

from vastflow.flows.results.at_hand import meant_address
from vastflow.flows.terminal.reading import reading

PLACE_HELP: Final = (
    "A campaign directory, as `vastflow run` names it: a folder, or an address such as s3://bucket/NAME."
)


def show(results: Annotated[str, typer.Argument(metavar="RESULTS", help=PLACE_HELP)]) -> None:
    """Show a finished campaign.

    Success rates, rejections with their reasons, and where the report is.
    """
    from vastflow.flows.results.at_hand import WITHOUT_RUNS, at_hand
    from vastflow.tasks.store import StoreError

    try:
        with at_hand(results, WITHOUT_RUNS) as directory:
            _show(directory, results.rstrip("/"))
    except StoreError as error:
        print(error, file=sys.stderr)
        raise typer.Exit(2) from None


def _show(directory: Path, place: str) -> None:
    """Show what lies in `directory`, for the user at `place`."""
    if wrong := wrong_directory(directory):
        print(wrong, file=sys.stderr)
        raise typer.Exit(2)
    from vastflow.flows.terminal.outcome import details, printed
    from vastflow.oracles.directory.tables import read_tables
    from vastflow.oracles.evidence.evidence import evidence_of

    with reading(place):
        tables = read_tables(directory)
        title, shown = (
            f"{tables.metadata['name']}, {tables.metadata['created']}\n",
            details(tables, evidence_of(tables)),
        )
        print(title)
        printed(shown)
    print(f"\n{report_line(directory, place)}")


def report_line(results: Path, place: str | None = None) -> str:
    """Where the report is, or that there is none.

    Args:
        place: Of the campaign directory, where `results` is a copy of it.
    """
    where = place or str(results)
    return f"report: {where}/report.html" if (results / "report.html").exists() else f"no report; tables: {where}"


def wrong_directory(results: Path) -> str | None:
    """Why a path is no campaign directory, and where one is; None where it is one."""
    right = "a folder that `vastflow run` wrote"
    if address := meant_address(results):
        return f"{address}: only `vastflow show` and `vastflow export` read an address; copy it into a folder first"
    if not results.exists():
        return f"{results}: no such folder; {right}"
    if (results / "metadata.json").is_file():
        return None
    inside = sorted(results.glob("[!.]*/metadata.json"), key=lambda file: file.stat().st_mtime)
    if inside:
        return (
            f"{results}: holds {len(inside)} campaign directories; name one of them, the newest is {inside[-1].parent}"
        )
    return f"{results}: not a campaign directory, it has no metadata.json; {right}"
