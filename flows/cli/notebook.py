"""The command `notebook`: a notebook over a campaign, a configuration, or a run, to begin with."""

from pathlib import Path
from typing import Annotated, Any

import typer

from vastflow.flows.terminal.ending import Interruptible, writing
from vastflow.flows.terminal.options import ResultsFolder, configuration_and_run, configuration_names, run_names
from vastflow.sim.model.faults import UserError


def notebook(
    results: ResultsFolder,
    run: Annotated[
        str,
        typer.Option(
            metavar="CONFIGURATION/RUN", help="A run: where it drove, and its signals.", autocompletion=run_names
        ),
    ] = "",
    configuration: Annotated[
        str,
        typer.Option(
            metavar="NAME", help="A configuration: its runs over each other.", autocompletion=configuration_names
        ),
    ] = "",
    campaign: Annotated[bool, typer.Option("--campaign", help="The whole campaign (the default).")] = False,
    execute: Annotated[bool, typer.Option("--execute/--no-execute", help="Execute it, and write a page of it.")] = True,
    folder: Annotated[Path, typer.Option(metavar="FOLDER", help="Folder for the files.")] = Path(),
) -> None:
    """Write a notebook over a campaign, a configuration, or a run, and execute it."""
    if sum(map(bool, (run, configuration, campaign))) > 1:
        raise UserError("expected one of --run, --configuration, and --campaign, got several")
    with Interruptible("Interrupted."):
        from vastflow.flows.results.address import check_directory
        from vastflow.flows.run.notebook import Book, execute_books, filled, shipped
        from vastflow.oracles.query.frames import stored_run
        from vastflow.oracles.results.executed import configuration_row
        from vastflow.producers.campaign_file.visualization import missing_library

        if execute and (name := missing_library()):
            raise UserError(f"{name} is missing. Call pip install 'vastflow[notebook]', or use --no-execute.")
        check_directory(results)
        name, index = configuration_and_run(run) if run else (configuration, 0)
        if name:
            configuration_row(results, name)  # or says that there is none
        if run:
            stored_run(results, name, int(index))
        where = results.resolve()
        values: dict[str, Any] = {"RESULTS": str(where), "CONFIGURATION": name, "RUN": index}
        text = shipped("run" if run else "config" if name else "campaign")
        place = folder / "-".join(filter(None, (where.name, name, str(index) * bool(run))))
        file = place.with_name(f"{place.name}.ipynb")
        if file.exists():
            raise UserError(f"{file}: expected a new file, got one that exists. Remove it, or name another --folder.")
        with writing(folder):
            folder.mkdir(parents=True, exist_ok=True)
            file.write_text(filled(text, values), encoding="utf-8")
        print(f"notebook: {file}")
        if not execute:
            return
        (wrong,) = execute_books([Book(text, values, str(place.resolve()))])
        if wrong:
            raise UserError(f"{file}: {wrong}")
        print(f"page: {file.with_suffix('.html')}")
