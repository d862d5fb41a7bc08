"""The page of a run: its replay, the frames of its recording, and the layers of its execution."""

import asyncio
import functools
from pathlib import Path
from typing import Any

from starlette.exceptions import HTTPException
from starlette.requests import Request
from starlette.responses import Response
from starlette.routing import BaseRoute, Route

from vastflow.deployments.explorer.around import around_run
from vastflow.deployments.explorer.directories import Directories
from vastflow.deployments.explorer.kept_layers import KeptLayers
from vastflow.deployments.explorer.pages import Pages
from vastflow.deployments.explorer.replies import ARRAYS, name_of, number_of
from vastflow.oracles.results.unusable import UnusableDirectory, reading
from vastflow.tasks.engine.executor import WorkerDied


def routes(directories: Directories, pages: Pages) -> list[BaseRoute]:
    """Return the routes of the page."""
    kept = KeptLayers()

    @functools.lru_cache(maxsize=8)
    def files_of(directory: Path, written_ns: int) -> Any:
        from vastflow.oracles.results.executed import KeptFiles  # a second of imports

        return KeptFiles(directory)

    def run(request: Request) -> Response:
        campaign = directories.find(name_of(request, "c"))
        configuration, run_index = name_of(request, "configuration"), number_of(request, "run")
        # A form that chooses no other run sends an empty one. One of another campaign has its id as `withc`.
        beside = (
            (name_of(request, "with"), number_of(request, "withrun")) if request.query_params.get("withrun") else None
        )
        elsewhere = "withc" in request.query_params or (beside is not None and beside[0] != configuration)
        around = around_run(campaign.path, configuration, run_index)
        return pages.page(
            request,
            "run.html.j2",
            campaign=campaign,
            configuration=configuration,
            run=run_index,
            beside=beside,
            elsewhere=elsewhere,
            around=around,
        )

    def frames(request: Request) -> Response:
        from vastflow.deployments.explorer.frames import frames_of, stored_run  # a second of imports too

        campaign = directories.find(name_of(request, "c"))
        configuration = name_of(request, "configuration")
        files = files_of(campaign.path, campaign.path.stat().st_mtime_ns)
        stored = stored_run(campaign.path, configuration, number_of(request, "run"), files)
        kept.prepare()
        with reading(campaign.path.name):
            return Response(frames_of(stored, configuration), media_type=ARRAYS)

    async def layers(request: Request) -> Response:
        campaign = await asyncio.to_thread(directories.find, name_of(request, "c"))
        asked = kept.layers(campaign.path, name_of(request, "configuration"), number_of(request, "run"))
        try:
            content = await asyncio.shield(asyncio.wrap_future(asked))  # another page may wait for it too
        except WorkerDied as error:
            raise UnusableDirectory(f"This run can't be executed again: {error}.") from None
        except asyncio.CancelledError:
            raise HTTPException(503, "The explorer was ended.") from None
        return Response(content, media_type=ARRAYS, headers={"Content-Encoding": "gzip"})

    return [Route("/run", run), Route("/api/frames", frames), Route("/api/layers", layers)]
