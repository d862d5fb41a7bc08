"""The command `show`: a finished campaign in the terminal."""

import json
from pathlib import Path
from typing import Annotated

import typer

from vastflow.flows.terminal.options import AsJson, PlaceOfResults


def show(
    results: PlaceOfResults,
    coverage: Annotated[
        bool, typer.Option("--coverage", help="Show how much of the requested test space was realized instead.")
    ] = False,
    as_json: AsJson = False,
) -> None:
    """Show a finished campaign.

    Success rates, rejections with their reasons, and the path of the report; with --json, the coverage.
    """
    from vastflow.flows.plan.text import coverage_text
    from vastflow.flows.results.address import WITHOUT_RUNS, at_hand, check_directory
    from vastflow.flows.terminal.display import printed
    from vastflow.flows.terminal.outcome import details
    from vastflow.oracles.evidence.evidence import evidence_of
    from vastflow.oracles.results.coverage import read_coverage
    from vastflow.oracles.results.tables import read_tables
    from vastflow.oracles.results.unusable import reading

    with at_hand(results, WITHOUT_RUNS) as directory:
        check_directory(directory)
        with reading(results.rstrip("/")):
            if as_json:
                print(json.dumps(read_coverage(directory), ensure_ascii=False))
            elif coverage:
                printed([*coverage_text(read_coverage(directory))])
            else:
                tables = read_tables(directory)
                shown = list(details(tables, evidence_of(tables)))
                print(f"{tables.metadata['name']}, {tables.metadata['created']}\n")
                printed(shown)
                print(f"\n{report_line(directory, results.rstrip('/'))}")


def report_line(results: Path, place: str | None = None) -> str:
    """Return the path of the report, if any, at the `place` that `results` is a copy of."""
    where = place or str(results)
    return f"report: {where}/report.html" if (results / "report.html").exists() else f"no report; tables: {where}"
