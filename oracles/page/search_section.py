"""The section on a search: its space, progress, best point, and confirmation."""

import json
from collections.abc import Iterator, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any, Final

from vastflow.oracles.evidence.findings import found_text
from vastflow.oracles.figures.charts import archive_figure, boundary_figure, progress_figure
from vastflow.oracles.figures.drawing import Drawing
from vastflow.oracles.page.facts import Facts
from vastflow.oracles.page.pictures import case_picture, picture
from vastflow.oracles.page.section import Picture, Section
from vastflow.oracles.page.words import number
from vastflow.oracles.results.schema import table_rows

CELLS_DRAWN: Final = 4
"""Cells of an archive whose runs are drawn, the best ones."""


def search_section(facts: Facts) -> Section | None:
    """The section; None where the campaign was no search."""
    said = facts.metadata.get("search")
    if not said:
        return None
    point = (said["best"] or {"point": {}})["point"]
    is_number = {name: isinstance(v, int | float) and not isinstance(v, bool) for name, v in point.items()}
    values: dict[str, Any] = {
        "found": found_text(said),
        "point": [f"{name} = {number(value) if is_number[name] else value}" for name, value in point.items()],
        "searched": _searched(said),
        "pictures": [*_pictures(facts.tables.directory, said), *_cell_pictures(facts, said)],
    }
    title, figures = "What the search found", values["pictures"]
    return Section("search", "Search", title, folded=False, values=values, figures=figures)


def _searched(said: Mapping[str, Any]) -> str:
    space = ", ".join(f"{name} ({_domain(each)})" for name, each in said["space"].items())
    aim = f"to {said['direction']} {said['objective'].replace('_', ' ')}"
    spent = f"{said['proposals']} points in {said['batches']} batches, {said['runs']} runs"
    rejected = f", {said['rejected']} points that could not be built" if said["rejected"] else ""
    return f"{said['strategy']} over {space}, {aim}: {spent}{rejected}. What ended it: {said['ended_by']}."


def _domain(dimension: Mapping[str, Any]) -> str:
    if "values" in dimension:
        return " | ".join(map(str, dimension["values"]))
    return f"{dimension['low']:g} to {dimension['high']:g}" if "low" in dimension else "true | false"


def _pictures(directory: Path, said: Mapping[str, Any]) -> Iterator[Picture]:
    rows = table_rows(directory / "evaluations.parquet")
    beside = table_rows(directory / "baseline.parquet") if "baseline" in said else []
    name = said["objective"].replace("_", " ")
    if said["best"] is not None:
        alt = f"{name} of each point over the runs spent"
        caption = "Dot: a point. Line: the best so far, by the runs that the search used. Fresh runs correct it."
        caption += " Dashed: random search with as many points." if beside else ""
        figure = Drawing(progress_figure, rows, name, said["direction"], beside)
        yield picture("search-progress", "Best against budget", alt, caption, figure, drawn=True)
    archive = said["parameters"].get("archive", {})
    measures = archive.get("measures", {})
    if archive.get("type", "grid") == "grid" and len(measures) == 2:
        cells = table_rows(directory / "archive.parquet")
        bins = archive.get("bins") or 10
        ranges = {key: (each["low"], each["high"], each.get("bins") or bins) for key, each in measures.items()}
        places = {tuple(json.loads(row["cell"])): row["objective"] for row in cells}
        alt = f"{name} of the best point in each cell"
        caption = "Each cell: the best point whose measures lie in it. White: none was found."
        figure = Drawing(archive_figure, places, ranges, name)
        yield picture("search-archive", "Archive", alt, caption, figure, drawn=True)
    if (directory / "boundary.parquet").is_file() and len(said["space"]) <= 2:
        level = said["parameters"].get("level", 0.5)
        surface = table_rows(directory / "boundary.parquet")
        decoded = [{**row, "point": json.loads(row["point"])} for row in surface]
        figure = Drawing(boundary_figure, decoded, list(said["space"]), level, name)
        caption = f"Line: where {name} is expected to cross {level:g}. Band: 95 %."
        yield picture("search-boundary", "Boundary", f"Where {name} crosses {level:g}", caption, figure, drawn=True)


def _cell_pictures(facts: Facts, said: Mapping[str, Any]) -> Iterator[Picture]:
    """The runs of the best points of the archive, each on its map."""
    tables = facts.tables
    file = tables.directory / "archive.parquet"
    cells = table_rows(file) if file.is_file() else []
    sign = 1 if said["direction"] == "minimize" else -1
    known = {name: k for k, name in enumerate(tables.configurations.names)}
    name = said["objective"].replace("_", " ")
    for cell in sorted(cells, key=lambda cell: sign * cell["objective"])[:CELLS_DRAWN]:
        index = known[cell["configuration"]]
        original = tables.configurations.duplicate_of[index]
        drawn = case_picture(tables, index if original is None else known[original], facts.files)
        if drawn is not None:
            measures = ", ".join(f"{measure} {value:.3g}" for measure, value in json.loads(cell["measures"]).items())
            title = f"{cell['configuration']}: {name} {cell['objective']:.3g}"
            yield replace(
                drawn, name=f"cell-{cell['configuration']}", title=title, caption=f"The best point at {measures}."
            )
