"""The command `validate`: faults of a campaign file, or the JSON Schema of such files."""

import json
import sys
from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Any

import typer

from vastflow.flows.terminal.ending import BAD_INPUT, print_error
from vastflow.flows.terminal.options import CampaignFile, asking
from vastflow.flows.terminal.progress import count_text
from vastflow.sim.model.faults import FileError


def _print_schema(asked: bool) -> None:
    if asked:
        from vastflow.producers.campaign_file.spec import campaign_schema

        print(json.dumps(campaign_schema(), indent=2))
        raise typer.Exit


def _print_converted(file: Path) -> None:
    import yaml

    from vastflow.producers.campaign_file.document import read_document
    from vastflow.producers.campaign_file.robovast import SCHEMAS, Converter

    document, converter = read_document(file), Converter()
    if (version := document.value(("version",))) not in SCHEMAS:
        got = f"expected a schema of RoboVAST 2 (2, 3, or 4), got {'none' if version is None else version}"
        raise FileError([document.fault(("version",), got)])
    print(yaml.safe_dump(converter.campaign(document.data), sort_keys=False, allow_unicode=True), end="")
    for name in converter.left:
        print(f"left out, as version 1 has no place for it: {name}", file=sys.stderr)


@asking("map_dir", "strict")
def validate(
    file: CampaignFile,
    asked: Mapping[str, Any],
    schema: Annotated[
        bool,
        typer.Option(
            "--schema",
            callback=_print_schema,
            is_eager=True,
            help="Print the JSON Schema of campaign files for editors, and exit.",
        ),
    ] = False,
    from_robovast: Annotated[
        bool, typer.Option("--from-robovast", help="Print a campaign file of RoboVAST 2 as version 1, and exit.")
    ] = False,
) -> None:
    """Check a campaign file.

    All faults are reported at once, with their places and what was expected.
    """
    if from_robovast:
        _print_converted(file)
        return
    from vastflow.flows.request.campaign_file import read_campaign, terminal_lines
    from vastflow.producers.campaign import infeasible_lengths
    from vastflow.producers.search.criteria import plan_text
    from vastflow.tasks.engine.machine_check import check_numba

    check_numba()
    campaign, oracles = read_campaign(file, **asked)
    infeasible = infeasible_lengths(campaign)
    unexecutable = {(fault.place.file, fault.place.line, fault.place.column) for fault in campaign.unexecutable}
    notes = [
        note for note in campaign.notes if (note.place.file, note.place.line, note.place.column) not in unexecutable
    ]
    for line in terminal_lines(notes):
        print(line)
    for note in infeasible:
        print(note)
    if campaign.unexecutable:
        print_error(FileError(campaign.unexecutable))
        print("this version can't run the file", file=sys.stderr)
        raise typer.Exit(BAD_INPUT)
    if campaign.missing:
        print_error(FileError(campaign.missing))
        lost = count_text(len(campaign.unavailable), "family", "families")
        print(f"{lost} left out because of missing files, {len(campaign.families)} left to run", file=sys.stderr)
        raise typer.Exit(BAD_INPUT)
    if campaign.spec.search is None:
        producers = sum(len(family.producers) for family in campaign.families)
        counts = [count_text(len(campaign.families), "family", "families"), count_text(producers, "producer")]
    else:
        counts = [plan_text(campaign.spec.search, campaign.runs, at_most=campaign.sequential is not None)]
    counts.append(count_text(len(oracles), "oracle"))
    print(f"OK: {', '.join(counts)}")
