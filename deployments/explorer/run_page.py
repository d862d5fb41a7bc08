"""The page of a run: its replay, the frames of its recording, and the layers of its execution."""

import asyncio
from pathlib import Path
from typing import Final, TypeAlias

import numpy as np
import pyarrow.compute as pc
import pyarrow.parquet as pq
from starlette.exceptions import HTTPException
from starlette.requests import Request
from starlette.responses import Response
from starlette.routing import BaseRoute, Route

from vastflow.deployments.explorer.directories import Directories
from vastflow.deployments.explorer.kept_layers import KeptLayers
from vastflow.deployments.explorer.pages import Pages
from vastflow.oracles.results.schema import integers
from vastflow.oracles.results.unusable import UnusableDirectory, reading

_BINARY: Final = "application/octet-stream"

RunPlace: TypeAlias = tuple[str, int]
"""Configuration and run index."""


def routes(directories: Directories, pages: Pages) -> list[BaseRoute]:
    """Return the routes of the page."""
    kept = KeptLayers()

    def run(request: Request) -> Response:
        campaign = directories.find(_text(request, "c"))
        shown = _text(request, "configuration"), _number(request, "run")
        before, after = failed_neighbors(campaign.path, *shown)
        return pages.page(
            request, "run.html.j2", campaign=campaign, configuration=shown[0], run=shown[1], before=before, after=after
        )

    def frames(request: Request) -> Response:
        from vastflow.deployments.explorer.frames import frames_of, stored_run  # a second of imports

        campaign = directories.find(_text(request, "c"))
        configuration = _text(request, "configuration")
        stored = stored_run(campaign.path, configuration, _number(request, "run"))
        kept.prepare()
        with reading(campaign.path.name):
            return Response(frames_of(stored, configuration), media_type=_BINARY)

    async def layers(request: Request) -> Response:
        campaign = await asyncio.to_thread(directories.find, _text(request, "c"))
        asked = kept.layers(campaign.path, _text(request, "configuration"), _number(request, "run"))
        content = await asyncio.shield(asyncio.wrap_future(asked))  # another page may wait for it too
        return Response(content, media_type=_BINARY, headers={"Content-Encoding": "gzip"})

    return [Route("/run", run), Route("/api/frames", frames), Route("/api/layers", layers)]


def _text(request: Request, name: str) -> str:
    if not (given := request.query_params.get(name, "")):
        raise HTTPException(400, f"The address of a run needs `{name}`.")
    return given


def _number(request: Request, name: str) -> int:
    if not (given := _text(request, name)).isdecimal() or len(given) > 9:
        raise HTTPException(400, f"{name}: expected a whole number from 0, got {given!r}")
    return int(given)


def failed_neighbors(directory: Path, configuration: str, run_index: int) -> tuple[RunPlace | None, RunPlace | None]:
    """Return the failed runs before and after a run, in the order of the configurations; None where there is none.

    Raises:
        UnusableDirectory: a missing or damaged table, or an unknown configuration.
    """
    with reading(directory.name):
        columns = ["configuration", "run_index", "judgement"]
        verdicts = pq.ParquetFile(directory / "verdicts.parquet", read_dictionary=["configuration", "judgement"])
        failed = verdicts.read(columns=columns).filter(pc.field("judgement") == "fail")
        rows = pq.ParquetFile(directory / "configurations.parquet").read(columns=["name", "duplicate_of"])
        names = rows["name"].to_pylist()
        if configuration not in names:
            raise UnusableDirectory(f"{directory.name}: expected the name of a configuration, got {configuration!r}")
        name = rows["duplicate_of"][names.index(configuration)].as_py() or configuration
        place = integers(
            pc.index_in(pc.cast(failed["configuration"], "string"), value_set=rows["name"].combine_chunks())
        )
    found = np.unique(place << 32 | integers(failed["run_index"]))
    here = names.index(name) << 32 | run_index

    def at(index: int) -> RunPlace | None:
        return (names[found[index] >> 32], int(found[index] & 0xFFFFFFFF)) if 0 <= index < len(found) else None

    return at(int(np.searchsorted(found, here)) - 1), at(int(np.searchsorted(found, here, side="right")))
