"""The command `show`: a finished campaign in the terminal."""

import json
from pathlib import Path
from typing import Annotated, Final

import typer

PLACE_HELP: Final = (
    "A campaign directory, as `vastflow run` names it: a folder, or an address such as s3://bucket/NAME."
)


def show(
    results: Annotated[str, typer.Argument(metavar="RESULTS", help=PLACE_HELP)],
    coverage: Annotated[
        bool, typer.Option("--coverage", help="Show how much of the requested test space was realized instead.")
    ] = False,
    as_json: Annotated[bool, typer.Option("--json", help="Print the coverage as JSON and nothing else.")] = False,
) -> None:
    """Show a finished campaign.

    Success rates, rejections with their reasons, and where the report is.
    """
    from vastflow.flows.results.address import WITHOUT_RUNS, at_hand

    with at_hand(results, WITHOUT_RUNS) as directory:
        if coverage or as_json:
            _show_coverage(directory, results, as_json)
        else:
            _show(directory, results.rstrip("/"))


def _show_coverage(directory: Path, place: str, as_json: bool) -> None:
    from vastflow.flows.plan.text import coverage_text
    from vastflow.flows.results.address import check_directory
    from vastflow.flows.terminal.outcome import printed
    from vastflow.oracles.results.coverage import read_coverage
    from vastflow.oracles.results.unusable import reading

    check_directory(directory)
    with reading(place):
        found = read_coverage(directory)
        if as_json:
            print(json.dumps(found, ensure_ascii=False))
        else:
            printed(coverage_text(found))


def _show(directory: Path, place: str) -> None:
    """Show what lies in `directory`, for the user at `place`."""
    from vastflow.flows.results.address import check_directory

    check_directory(directory)
    from vastflow.flows.terminal.outcome import details, printed
    from vastflow.oracles.evidence.evidence import evidence_of
    from vastflow.oracles.results.tables import read_tables
    from vastflow.oracles.results.unusable import reading

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
