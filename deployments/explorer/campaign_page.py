"""The page of a campaign: facets, map, table, scatter, and parallel coordinates of a selection of its runs."""

import os
from collections import Counter
from collections.abc import Callable, Mapping
from contextlib import suppress
from dataclasses import asdict
from pathlib import Path
from tempfile import TemporaryFile
from typing import IO, Any, Final

import pyarrow as pa
import pyarrow.compute as pc
import pyarrow.csv
import pyarrow.parquet as pq
from starlette.exceptions import HTTPException
from starlette.requests import Request
from starlette.responses import HTMLResponse, RedirectResponse, Response, StreamingResponse
from starlette.routing import BaseRoute, Route

from vastflow.deployments.explorer import configuration_page, trajectories
from vastflow.deployments.explorer.directories import Directories, headline_of
from vastflow.deployments.explorer.opened import Campaign, OpenedCampaigns
from vastflow.deployments.explorer.pages import Pages, address, arrays_reply, name_of, number_of
from vastflow.oracles.evidence.headline import robot_text
from vastflow.oracles.query import facets
from vastflow.oracles.query.selection import (
    WIDE_FILE,
    Bools,
    Filter,
    format_filter,
    is_by_result,
    mask_of,
    parse_filter,
    python_of,
)
from vastflow.oracles.results.unusable import DAMAGE, reading
from vastflow.sim.model.files import is_file, is_inside, read_bytes, read_json, read_text
from vastflow.sim.model.parquet import open_table

MOST_POINTS: Final = 5000
MOST_LINES: Final = 800
"""Runs in parallel coordinates."""
MOST_AXES: Final = 12
MOST_ROWS: Final = 200
_ROWS: Final = 50
_SHOWN_FACTORS: Final = 6
"""Factors that the table shows at first."""
_ROWS_A_BATCH: Final = 8192
_CHUNK_BYTES: Final = 1 << 16
_WAIT_S: Final = 0.05
"""Time that a request waits for paths; what is read meanwhile comes with the next."""
_FORMATS: Final = {"csv": "text/csv; charset=utf-8", "parquet": "application/vnd.apache.parquet"}

REPORT: Final = "report.html"
POSTPROCESSING: Final = "postprocessing"
CLASSES: Final = ("reliable", "systematic", "flaky", "undecided")
_STILL: Final = (
    "sandbox; default-src 'none'; style-src 'unsafe-inline'; img-src data:; media-src data:; "
    "base-uri 'none'; form-action 'none'; frame-ancestors 'none'"
)
"""A report may be a stranger's: nothing of it is executed, and it asks for nothing."""
_MOST_FILE_BYTES: Final = 2**18

View = Callable[[Request, Campaign, Filter, Bools], Response | Mapping[str, Any]]
"""Makes a reply, or the values of the template that has the view's name."""


def routes(directories: Directories, pages: Pages) -> list[BaseRoute]:
    """Return the routes of the pages of campaigns and configurations, which share opened campaigns."""
    opened = OpenedCampaigns(directories)

    def page(request: Request) -> Response:
        directory = opened.find(name_of(request, "c"))
        if directory.state == "running":
            return RedirectResponse(address("/live", c=directory.id), 303)
        findings, classes = opened.of(directory.id).evidence  # or an error says why it has no page
        counts = Counter(classes.values())
        return pages.page(
            request,
            "campaign.html.j2",
            campaign=directory,
            robot=robot_text(directory.metadata),
            findings=findings,
            classes=[(name, counts[name]) for name in CLASSES if counts[name]],
            has_report=_own_file(directory.path, REPORT) is not None,
            file=_campaign_file(directory.path),
            notebooks=_notebooks(directory.path),
        )

    def notebook(request: Request) -> Response:
        path = directories.find(name_of(request, "c")).path
        file = _own_file(path, f"{POSTPROCESSING}/{name_of(request, 'n')}")
        if file is None or name_of(request, "n") not in _notebooks(path):
            raise HTTPException(404, "This campaign has no such notebook.")
        with reading(path):
            return HTMLResponse(read_bytes(file), headers={"Content-Security-Policy": _STILL})

    def report(request: Request) -> Response:
        file = _own_file(directories.find(name_of(request, "c")).path, REPORT)
        if file is None:
            raise HTTPException(404, "This campaign has no report.")
        with reading(file.parent):
            return HTMLResponse(read_bytes(file), headers={"Content-Security-Policy": _STILL})

    def view(name: str, made: View) -> Callable[[Request], Response]:
        def answer(request: Request) -> Response:
            campaign = opened.of(name_of(request, "c"))
            chosen = parse_filter(request.query_params.get("f", ""))
            with reading(campaign.directory.path):
                found = made(request, campaign, chosen, mask_of(campaign.table, chosen))
                return found if isinstance(found, Response) else pages.part(request, f"{name}.html.j2", found)

        return answer

    views: dict[str, View] = {
        "summary": summary,
        "facets": facet_counts,
        "rows": rows,
        "points": points,
        "paths": paths,
        "table": table,
    }
    return [
        Route("/campaign", page),
        Route("/report", report),
        Route("/notebook", notebook),
        *(Route(f"/api/{name}", view(name, made)) for name, made in views.items()),
        *configuration_page.routes(opened, pages),
    ]


def summary(request: Request, campaign: Campaign, chosen: Filter, mask: Bools) -> Mapping[str, Any]:
    """Return the counts of the selection, its reasons, its program, and the choices of the page."""
    found = facets.summary_json(campaign.table, mask, by_result=is_by_result(campaign.table, chosen))
    if mask.all() and (told := headline_of(campaign.directory)):
        found["headline"] = str(told.get("text"))
    return {
        "filter": format_filter(chosen),
        "conditions": [asdict(each) for each in chosen.values()],
        "summary": found,
        "reasons": facets.reasons_json(campaign.table, mask),
        "kinds": _kinds(campaign, mask),
        "columns": facets.column_list(campaign.facets),
        "maps": campaign.maps,
        "python": python_of(campaign.table, chosen, campaign.directory.path),
    }


def _kinds(campaign: Campaign, mask: Bools) -> list[Mapping[str, Any]]:
    from vastflow.oracles.page.failures import failure_kinds  # with matplotlib, which takes a second

    with suppress(*DAMAGE):  # the rest of the page does without
        return failure_kinds(campaign.failures[mask[campaign.failures.row]])[: facets.MOST_REASONS]
    return []


def _notebooks(directory: Path) -> list[str]:
    """Pages of the notebooks that the campaign file names, by their places below the folder of postprocessing."""
    with suppress(*DAMAGE):
        steps = read_json(directory / POSTPROCESSING / "steps.json")["steps"]
        shown = [step["files"] for step in steps if "level" in step["parameters"]]
        return [name for files in shown for name in files if name.endswith(".html")]
    return []


def _own_file(directory: Path, name: str) -> Path | None:
    file = directory / name
    return file if is_file(file) and is_inside(file, os.path.realpath(directory)) else None


def _campaign_file(directory: Path) -> str:
    try:
        return read_text(file, most_bytes=_MOST_FILE_BYTES) if (file := _own_file(directory, "campaign.vast")) else ""
    except DAMAGE as error:
        return str(error)


def facet_counts(request: Request, campaign: Campaign, chosen: Filter, mask: Bools) -> Mapping[str, Any]:
    """Return each facet's counts under the other facets' conditions."""
    return {**campaign.facets.json(chosen), "conditions": {name: asdict(each) for name, each in chosen.items()}}


def rows(request: Request, campaign: Campaign, chosen: Filter, mask: Bools) -> Mapping[str, Any]:
    """Return a page of the selection's configurations."""
    start, count = number_of(request, "start", 0), min(number_of(request, "count", _ROWS), MOST_ROWS)
    sort, descending = request.query_params.get("sort", "rate"), request.query_params.get("order") == "descending"
    shown = request.query_params.getlist("column") or campaign.facets.varying("factor")[:_SHOWN_FACTORS]
    by_result = is_by_result(campaign.table, chosen)
    return facets.rows_json(
        campaign.table, mask, shown, sort, descending=descending, start=start, count=count, by_result=by_result
    )


def points(request: Request, campaign: Campaign, chosen: Filter, mask: Bools) -> Response:
    """Return runs in some columns; without names those that vary, for parallel coordinates."""
    names, constant, most = request.query_params.getlist("column"), list[str](), MOST_POINTS
    if len(names) != 2:
        most = MOST_LINES
        names, constant = facets.varying_of(campaign.table, mask, names or facets.axes_of(campaign.facets, chosen))
    header, arrays = facets.points(campaign.table, mask, names[:MOST_AXES], most)
    return arrays_reply({**header, "constant": constant, "left_out": names[MOST_AXES:]}, arrays)


def paths(request: Request, campaign: Campaign, chosen: Filter, mask: Bools) -> Response:
    """Return a layer of the map of the runs that were read so far."""
    if (environment := name_of(request, "environment")) not in [each["id"] for each in campaign.maps]:
        raise HTTPException(400, f"environment: expected a map of this campaign, got {environment!r}")
    asked = request.query_params.get("layer", "paths")
    if asked not in trajectories.LAYERS:
        raise HTTPException(400, f"layer: expected one of {', '.join(trajectories.LAYERS)}, got {asked!r}")
    found = campaign.reading(environment, _WAIT_S)
    header = {
        "problem": found.problem,
        "read": found.done,
        "configurations_here": len(found.configurations),
        "damaged": found.damaged,
        "floor": found.floor.json if found.floor else None,
    }
    if found.paths is None or found.floor is None:
        return arrays_reply({**header, "form": "nothing"}, {})
    told, arrays = trajectories.layer(found.paths, campaign.table, mask, found.floor.grid, asked)
    return arrays_reply({**header, **told}, arrays)


def table(request: Request, campaign: Campaign, chosen: Filter, mask: Bools) -> Response:
    """Return the selected runs with all columns, as a file."""
    form = request.query_params.get("format", "csv")
    if form not in _FORMATS:
        raise HTTPException(400, f"format: expected csv or parquet, got {form!r}")
    file = TemporaryFile()  # noqa: SIM115 - it is closed with the reply
    with reading(campaign.directory.path):
        write_selected(campaign.directory.path / WIDE_FILE, mask, file, form)
    name = f"{campaign.directory.id}-{int(mask.sum())}-runs.{form}"
    headers = {"Content-Length": str(file.tell()), "Content-Disposition": f'attachment; filename="{name}"'}
    file.seek(0)
    return StreamingResponse(iter(lambda: file.read(_CHUNK_BYTES), b""), 200, headers, _FORMATS[form])


def write_selected(table: Path, mask: Bools, file: IO[bytes], form: str) -> None:
    """Write the selected runs of a table as `csv` or `parquet`, some rows at a time to save memory."""
    writer, start = None, 0
    for batch in open_table(table).iter_batches(_ROWS_A_BATCH):
        plain = [pc.cast(each, pa.string()) if pa.types.is_dictionary(each.type) else each for each in batch.columns]
        part = pa.table(plain, names=batch.schema.names).filter(pa.array(mask[start : start + len(batch)]))
        start += len(batch)
        writer = writer or (pyarrow.csv.CSVWriter if form == "csv" else pq.ParquetWriter)(file, part.schema)
        writer.write_table(part)
    if writer is not None:
        writer.close()
