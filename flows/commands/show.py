"""The command `show`: a finished campaign in the terminal."""

import sys
from pathlib import Path
from typing import Annotated

import typer


def show(
    results: Annotated[
        Path, typer.Argument(metavar="RESULTS", help="A campaign directory, as `vastflow run` names it.")
    ],
) -> None:
    """Show a finished campaign.

    Success rates, rejections with their reasons, and where the report is.
    """
    if wrong := wrong_directory(results):
        print(wrong, file=sys.stderr)
        raise typer.Exit(2)
    from vastflow.flows.terminal.outcome import details, printed
    from vastflow.oracles.directory.tables import read_tables
    from vastflow.oracles.evidence.evidence import evidence_of

    try:
        tables = read_tables(results)
    except (OSError, ValueError, KeyError) as error:  # pyarrow's and json's errors are ValueErrors
        print(f"{results}: damaged campaign directory: {error}", file=sys.stderr)
        raise typer.Exit(2) from None
    print(f"{tables.metadata['name']}, {tables.metadata['created']}\n")
    printed(details(tables, evidence_of(tables)))
    print(f"\n{report_line(results)}")


def report_line(results: Path) -> str:
    """Where the report is, or that there is none."""
    report = results / "report.html"
    return f"report: {report}" if report.exists() else f"no report; tables: {results}"


def wrong_directory(results: Path) -> str | None:
    """Why a path is no campaign directory, and where one is; None where it is one."""
    right = "a folder that `vastflow run` wrote"
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
