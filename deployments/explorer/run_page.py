"""The page of a run: its replay, the frames of its recording, and the layers of its execution."""

import asyncio
import threading
import weakref
from collections.abc import Mapping
from concurrent.futures import Future
from functools import cached_property
from pathlib import Path
from typing import Any, Final

import numpy as np
from starlette.exceptions import HTTPException
from starlette.requests import Request
from starlette.responses import Response
from starlette.routing import BaseRoute, Route

from vastflow.deployments.explorer.directories import Directories
from vastflow.deployments.explorer.pages import ARRAYS, Pages, name_of, number_of
from vastflow.oracles.results.schema import table_rows
from vastflow.oracles.results.tables import FAIL, JUDGEMENTS, read_verdicts
from vastflow.oracles.results.unusable import UnusableDirectory, reading
from vastflow.tasks.engine.executor import Priority, WorkerDied
from vastflow.tasks.engine.pool import Pool

KEPT_RUNS: Final = 8
"""Runs whose compressed layers stay in memory, some megabytes each."""


def _prepared() -> None:
    # Imported where runs are executed: kernels would take the server two seconds and 150 MB.
    import vastflow.deployments.explorer.layers  # noqa: F401


def _layers(directory: Path, configuration: str, run_index: int) -> bytes:
    from vastflow.deployments.explorer.layers import compressed_layers

    return compressed_layers(directory, configuration, run_index)


class KeptLayers:
    """The layers of runs, executed in a process of their own; those of the last runs are kept."""

    def __init__(self) -> None:
        self._asked: dict[tuple[Path, str, int], Future[bytes]] = {}
        self._lock = threading.Lock()

    def prepare(self) -> None:
        """Start the process, so that it is ready when layers are asked for."""
        with self._lock:
            self._pool.prepare(_prepared)

    @cached_property
    def _pool(self) -> Pool:
        pool = Pool(1)
        # At the interpreter's exit the pool ends by itself, before finalizers could ask for it.
        weakref.finalize(self, pool.close).atexit = False
        return pool

    def layers(self, directory: Path, configuration: str, run_index: int) -> "Future[bytes]":
        """Return the compressed layers of a run; the future may raise `UnusableDirectory` or `WorkerDied`."""
        key = directory, configuration, run_index
        with self._lock:
            known = self._asked.pop(key, None)
            if known is None or (known.done() and known.exception()):
                known = self._pool.submit(_layers, *key, priority=Priority.EXECUTE)
            self._asked[key] = known
            if len(self._asked) > KEPT_RUNS:
                del self._asked[next(iter(self._asked))]
            return known


def around_run(directory: Path, configuration: str, run_index: int) -> Mapping[str, Any]:
    """Return the judgements of a configuration's runs, and the places of the failed runs before and after one of them.

    Raises:
        UnusableDirectory: a missing or damaged table.
    """
    with reading(directory.name):
        names = [row["name"] for row in table_rows(directory / "configurations.parquet", "name")]
        verdicts = read_verdicts(directory, names)
        own, said = verdicts.rows_of(names.index(configuration)), verdicts.together
    runs = dict(zip(verdicts.run_index[own].tolist(), map(JUDGEMENTS.get, said[own].tolist()), strict=True))
    failed, here = np.flatnonzero(said == FAIL), own.start + [*runs].index(run_index)
    ends = {"before": failed[failed < here][-1:], "after": failed[failed > here][:1]}
    places = {
        k: [(names[verdicts.configuration[row]], int(verdicts.run_index[row])) for row in end]
        for k, end in ends.items()
    }
    return {"runs": runs, **{k: next(iter(place), None) for k, place in places.items()}}


def routes(directories: Directories, pages: Pages) -> list[BaseRoute]:
    """Return the routes of the page."""
    kept = KeptLayers()

    def run(request: Request) -> Response:
        from vastflow.deployments.explorer import frames  # a third of a second of imports

        campaign = directories.find(name_of(request, "c"))
        configuration, run_index = name_of(request, "configuration"), number_of(request, "run")
        # A form that chooses no other run sends an empty one. One of another campaign has its id as `withc`.
        beside = (
            (name_of(request, "with"), number_of(request, "withrun")) if request.query_params.get("withrun") else None
        )
        elsewhere = "withc" in request.query_params or (beside is not None and beside[0] != configuration)
        places = [(campaign.path, configuration, run_index)]
        if beside:
            places.append((directories.find(request.query_params.get("withc") or campaign.id).path, *beside))
        runs = [frames.stored_run(*place) for place in places]
        with reading(campaign.path.name):
            sides = [frames.facts_of(run, asked) for run, (_, asked, _) in zip(runs, places, strict=True)]
            plots = [*frames.plots_of(runs)]
        return pages.page(
            request,
            "run.html.j2",
            campaign=campaign,
            configuration=configuration,
            run=run_index,
            beside=beside,
            elsewhere=elsewhere,
            around=around_run(campaign.path, runs[0].configuration, run_index),
            sides=sides,
            plots=plots,
        )

    def frames(request: Request) -> Response:
        from vastflow.deployments.explorer.frames import frames_of, stored_run

        campaign = directories.find(name_of(request, "c"))
        configuration = name_of(request, "configuration")
        stored = stored_run(campaign.path, configuration, number_of(request, "run"))
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
