"""The page of a run: its replay, the frames of its recording, and the layers of its execution."""

import asyncio
import threading
import weakref
from collections import Counter
from collections.abc import Awaitable, Callable, Mapping
from pathlib import Path
from typing import Any, Final, TypeAlias
from urllib.parse import quote

import numpy as np
from starlette.exceptions import HTTPException
from starlette.requests import Request
from starlette.responses import JSONResponse, Response
from starlette.routing import BaseRoute, Route

from vastflow.deployments.explorer.directories import Directories
from vastflow.deployments.explorer.outputs import content_of, written_by
from vastflow.deployments.explorer.packed import packed
from vastflow.deployments.explorer.pages import ARRAYS, Pages, name_of, number_of
from vastflow.flows.results.trust import NotPermitted
from vastflow.oracles.results.executed import configuration_row
from vastflow.oracles.results.schema import table_rows
from vastflow.oracles.results.tables import FAIL, JUDGMENTS, read_verdicts
from vastflow.oracles.results.unusable import UnusableDirectory, reading
from vastflow.tasks.engine.executor import Priority, WorkerDied
from vastflow.tasks.engine.pool import Pool

KEPT_RUNS: Final = 8
"""Runs whose compressed layers stay in memory, some megabytes each."""
AT_ONCE: Final = 2
"""Runs that are executed at the same time."""
LOOK_S: Final = 0.25
"""Time between two looks whether somebody still waits."""

Run: TypeAlias = tuple[Path, str, int]
"""Directory, configuration, and run index."""


def _prepared() -> None:
    # Imported where runs are executed: kernels would take the server two seconds and 150 MB.
    import vastflow.deployments.explorer.layers  # noqa: F401


def _layers(*run: Any) -> bytes:
    from vastflow.deployments.explorer.layers import compressed_layers

    return compressed_layers(*run)


def _bag(*run: Any) -> bytes:
    from vastflow.deployments.explorer.layers import bag_file

    return bag_file(*run)


class KeptExecutions:
    """Results of runs that are executed, in processes of their own; the last results are kept.

    What is asked for waits its turn, however much is asked for, and is given up when nobody waits for it any more.

    Args:
        execute: Function of a module that returns what is kept of a run, such as its compressed layers.
    """

    def __init__(self, execute: Callable[..., bytes] = _layers) -> None:
        self._execute = execute
        self._asked: dict[Run, asyncio.Task[bytes]] = {}
        self._waiting = Counter[Run]()
        self._turns = asyncio.Semaphore(AT_ONCE)
        self._idle: list[Pool] = []
        # At the interpreter's exit the pools end by themselves, before finalizers could ask for it.
        weakref.finalize(self, _close, self._idle).atexit = False

    def prepare(self) -> None:
        """Start a process, so that it is ready when a run is asked for."""
        if not self._asked:
            pool = self._taken()
            pool.prepare(_prepared)
            self._idle.append(pool)

    async def result(self, run: Run, is_gone: Callable[[], Awaitable[bool]], consent: str | None = None) -> bytes:
        """Return what the execution of a run gives.

        Args:
            consent: See `permitted_contents`.
            is_gone: Tells whether the client has left.

        Raises:
            UnusableDirectory, NotPermitted: see `compressed_layers`.
            WorkerDied: the execution ended its process.
            HTTPException: the client has left.
        """
        task = self._asked.pop(run, None)
        if task is None or (task.done() and (task.cancelled() or task.exception())):
            task = asyncio.create_task(self._executed(run, consent))
        self._asked[run] = task
        ended = [each for each, other in self._asked.items() if other.done()]
        for each in ended[: max(0, len(ended) - KEPT_RUNS)]:
            del self._asked[each]
        self._waiting[run] += 1
        try:
            while not task.done():
                await asyncio.wait({task}, timeout=LOOK_S)
                if not task.done() and await is_gone():
                    raise HTTPException(503, "Nobody waits for this any more.")
            return task.result()
        finally:
            self._waiting[run] -= 1
            if not self._waiting[run]:
                del self._waiting[run]
                if not task.done():
                    task.cancel()
                    self._asked.pop(run, None)

    async def _executed(self, run: Run, consent: str | None) -> bytes:
        async with self._turns:
            pool = self._taken()
            try:
                asked = pool.submit(self._execute, *run, consent, priority=Priority.EXECUTE)
                found: bytes = await asyncio.wrap_future(asked)
            except asyncio.CancelledError:  # its process is not waited for either
                threading.Thread(target=pool.close, daemon=True).start()
                raise
            except BaseException:
                self._idle.append(pool)
                raise
            self._idle.append(pool)
            return found

    def _taken(self) -> Pool:
        try:
            return self._idle.pop()
        except IndexError:
            return Pool(1)


def _close(pools: list[Pool]) -> None:
    for pool in pools:
        pool.close()


def around_run(directory: Path, configuration: str, run_index: int) -> Mapping[str, Any]:
    """Return the judgments of a configuration's runs, and the places of the failed runs before and after one of them.

    Raises:
        UnusableDirectory: a missing or damaged table.
    """
    with reading(directory.name):
        names = [row["name"] for row in table_rows(directory / "configurations.parquet", "name")]
        verdicts = read_verdicts(directory, names)
        own, said = verdicts.rows_of(names.index(configuration)), verdicts.together
        runs = dict(zip(verdicts.run_index[own].tolist(), map(JUDGMENTS.get, said[own].tolist()), strict=True))
        here = own.start + [*runs].index(run_index)
    failed = np.flatnonzero(said == FAIL)
    ends = {"before": failed[failed < here][-1:], "after": failed[failed > here][:1]}
    places = {
        k: [(names[verdicts.configuration[row]], int(verdicts.run_index[row])) for row in end]
        for k, end in ends.items()
    }
    return {"runs": runs, **{k: next(iter(place), None) for k, place in places.items()}}


def routes(directories: Directories, pages: Pages) -> list[BaseRoute]:
    """Return the routes of the page."""
    kept, bags = KeptExecutions(), KeptExecutions(_bag)

    def run(request: Request) -> Response:
        from vastflow.oracles.query import frames  # a third of a second of imports

        campaign = directories.find(name_of(request, "c"))
        configuration, run_index = name_of(request, "configuration"), number_of(request, "run")
        # A form that chooses no other run sends an empty one. One of another campaign has its id as `withc`.
        beside = (
            (name_of(request, "with"), number_of(request, "withrun")) if request.query_params.get("withrun") else None
        )
        elsewhere = "withc" in request.query_params or (beside is not None and beside[0] != configuration)
        campaigns = [campaign, directories.find(request.query_params.get("withc") or campaign.id)]
        places = [(campaign.path, configuration, run_index)]
        if beside:
            places.append((campaigns[1].path, *beside))
        runs = [frames.stored_run(*place) for place in places]
        with reading(campaign.path.name):
            sides = [frames.facts_of(run, asked) for run, (_, asked, _) in zip(runs, places, strict=True)]
            plots = [*frames.plots_of(runs)]
            written = [
                {
                    "c": each.id,
                    "configuration": run.configuration,
                    "run": run.run_index,
                    **written_by(each.path, run.configuration, run.run_index),
                }
                for each, run in zip(campaigns, runs, strict=False)  # the second only beside the first
            ]
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
            written=written,
        )

    def frames(request: Request) -> Response:
        from vastflow.oracles.query.frames import frames_of, stored_run

        campaign = directories.find(name_of(request, "c"))
        configuration = name_of(request, "configuration")
        stored = stored_run(campaign.path, configuration, number_of(request, "run"))
        kept.prepare()
        with reading(campaign.path.name):
            return Response(packed(*frames_of(stored, configuration)), media_type=ARRAYS)

    async def executed(request: Request, of: KeptExecutions, **headers: str) -> Response:
        campaign = await asyncio.to_thread(directories.find, name_of(request, "c"))
        place = campaign.path, name_of(request, "configuration"), number_of(request, "run")
        await request.body()  # only after it a client's end is heard
        try:
            permit = request.query_params.get("permit") or None
            content = await of.result(place, request.is_disconnected, permit)
        except NotPermitted as error:
            asks = {"named": error.code.named, "digest": error.code.digest}
            return JSONResponse({"error": f"{error.code}.", "asks": asks}, 409)
        except WorkerDied as error:
            raise UnusableDirectory(f"This run can't be executed again: {error}.") from None
        except asyncio.CancelledError:
            raise HTTPException(503, "The explorer was ended.") from None
        return Response(content, media_type=ARRAYS, headers=headers)

    async def layers(request: Request) -> Response:
        return await executed(request, kept, **{"Content-Encoding": "gzip"})

    async def mcap(request: Request) -> Response:
        return await executed(request, bags)

    def output(request: Request) -> Response:
        campaign = directories.find(name_of(request, "c"))
        name, run_index = name_of(request, "name"), number_of(request, "run")
        with reading(campaign.path.name):
            row = configuration_row(campaign.path, name_of(request, "configuration"))
            content = content_of(campaign.path, row["duplicate_of"] or row["name"], run_index, name)
        if content is None:
            raise HTTPException(404)
        # Saved, never shown: it may be a page with scripts.
        file = quote(name.rpartition("/")[2], safe="", errors="replace")
        return Response(
            content, media_type=ARRAYS, headers={"Content-Disposition": f"attachment; filename*=UTF-8''{file}"}
        )

    return [
        Route("/run", run),
        Route("/output", output),
        Route("/api/frames", frames),
        Route("/api/layers", layers, methods=["POST"]),
        Route("/api/mcap", mcap, methods=["POST"]),
    ]
