"""The live page: a campaign while it runs, its runs so far, and the request to stop it."""

import asyncio
import json
import threading
import time
from collections.abc import AsyncIterator, Callable, Mapping
from contextlib import suppress
from datetime import datetime
from functools import lru_cache
from pathlib import Path
from tempfile import TemporaryDirectory, mkdtemp
from typing import Any, Final

from pydantic import ValidationError
from starlette.exceptions import HTTPException
from starlette.requests import Request
from starlette.responses import JSONResponse, RedirectResponse, Response, StreamingResponse
from starlette.routing import BaseRoute, Route

from vastflow.deployments.explorer.directories import CampaignDirectory, Directories, directory_at
from vastflow.deployments.explorer.live import LiveCampaign
from vastflow.deployments.explorer.pages import Pages, address, name_of, number_of
from vastflow.flows.request.run_request import RunRequest
from vastflow.flows.results.trust import running_as
from vastflow.oracles.results.events import LAST, Event, EventReader, gone_event
from vastflow.oracles.results.unfinished import ask_to_stop, final_of, place_of
from vastflow.oracles.results.unusable import DAMAGE, UnusableDirectory
from vastflow.sim.model.faults import UserError
from vastflow.tasks.engine.child import Child

EVERY_S: Final = 0.5
HEARTBEAT_S: Final = 15.0
PATIENCE_S: Final = 120
_WHOLE: Final = "[!.]*"
_SHARED: Final = ("runs", "store", "map_dir")
"""Options that decide which runs a configuration has, and where they are."""


class Follower:
    """Follows a campaign's events, wherever its directory is by now."""

    def __init__(self, directory: CampaignDirectory) -> None:
        self._reader = EventReader(directory.path)
        self.damaged = 0
        self.live = LiveCampaign()

    def look(self) -> dict[str, Any]:
        """Return the present state."""
        events, reader = [], self._reader
        with suppress(OSError, ValueError):
            events = reader.new()
        whole = place_of(reader.directory) == reader.directory
        if reader.gone and not any(event.event in LAST for event in events) and not self.live.over:
            events.append(Event(datetime.now().astimezone(), "ended") if whole else gone_event())
        for event in events:
            try:
                self.live.take(event)
            except DAMAGE:
                self.damaged += 1
        return {**self.live.state(time.time()), "damaged": self.damaged + reader.damaged, "whole": whole}


class Previews:
    """Directories of single configurations, written from the store when they are asked for, and removed with this object."""

    def __init__(self, directories: Directories) -> None:
        self._folder = TemporaryDirectory(prefix="vastflow-")
        self._lock = threading.Lock()
        self._fetched = lru_cache(None)(_fetch)
        directories.hide(Path(self._folder.name))

    def of(self, campaign: CampaignDirectory, configuration: str, run_index: int) -> CampaignDirectory:
        """Return a finished directory with the runs of a configuration up to `run_index`; some seconds the first time.

        Raises:
            UnusableDirectory: the events don't tell how the campaign was begun, or a run is not judged yet.
        """
        with self._lock:
            return self._fetched(Path(self._folder.name).resolve(), campaign, configuration, run_index)


def _fetch(folder: Path, campaign: CampaignDirectory, configuration: str, run_index: int) -> CampaignDirectory:
    """Write a preview in a process of its own, as a campaign's plug-ins don't belong into the server.

    The user's own record tells file and store. Nothing that the directory names is believed.
    """
    place = Path(mkdtemp(dir=folder))
    try:
        values = running_as(final_of(campaign.path)) or {}
        asked = RunRequest.model_validate(values["request"]).model_dump(include={*_SHARED})
        request = RunRequest.model_validate({**asked, "campaign": values["file"], "results": str(place)})
    except (LookupError, ValidationError):
        raise UnusableDirectory(
            f"{campaign.name}: its runs are shown when it has finished. Campaigns that you began on this machine are shown before."
        ) from None
    asked_for = {"request": request.model_dump(mode="json"), "configuration": configuration, "runs": run_index + 1}
    with Child("vastflow.flows.run.stored:answer") as child:
        try:
            child.ask(asked_for, PATIENCE_S)
        except UserError as error:
            raise UnusableDirectory(f"{configuration}, run {run_index}, can't be had from the store: {error}") from None
    return directory_at(next(place.glob(_WHOLE)))


def routes(directories: Directories, pages: Pages) -> list[BaseRoute]:
    """Return the routes of the page, of a run, of the events, and of the request to stop."""

    previews = Previews(directories)

    def page(request: Request) -> Response:
        return pages.page(request, "live.html.j2", campaign=directories.find(name_of(request, "c")))

    def run(request: Request) -> Response:
        campaign, name = directories.find(name_of(request, "c")), name_of(request, "configuration")
        run_index, executes = number_of(request, "run"), request.method == "POST"
        if campaign.state != "finished" and not executes:
            raise UnusableDirectory(f"{campaign.name} has not finished. Its live page opens its runs.")
        shown = campaign if campaign.state == "finished" else previews.of(campaign, name, run_index)
        place = address("/run", c=shown.id, configuration=name, run=run_index)
        return JSONResponse({"address": place}) if executes else RedirectResponse(place, 303)

    async def events(request: Request) -> Response:
        follower = Follower(await asyncio.to_thread(directories.find, name_of(request, "c")))

        def html(state: Mapping[str, Any]) -> str:
            return bytes(pages.page(request, "live_state.html.j2", **state).body).decode()

        return StreamingResponse(_stream(follower, html), media_type="text/event-stream")

    async def stop(request: Request) -> Response:
        campaign = await asyncio.to_thread(directories.find, name_of(request, "c"))
        try:
            reason = (await request.json())["reason"].strip()
        except (ValueError, LookupError, TypeError, AttributeError):
            reason = ""
        if not reason:
            raise HTTPException(400, "Expected a reason why the campaign shall stop.")
        await asyncio.to_thread(ask_to_stop, campaign.path, reason)
        return JSONResponse({"asked": reason})

    return [
        Route("/live", page),
        Route("/live-run", run, methods=["GET", "POST"]),
        Route("/api/events", events),
        Route("/api/stop", stop, methods=["POST"]),
    ]


async def _stream(follower: Follower, html: Callable[[Mapping[str, Any]], str]) -> AsyncIterator[str]:
    """Yield states and their parts of the page as they change, to the end, and comments as signs of life."""
    shown, said_s = dict[str, Any](), time.monotonic()
    while True:
        state = await asyncio.to_thread(follower.look)
        if state != shown:
            shown, said_s = state, time.monotonic()
            yield f"data: {json.dumps({**state, 'html': html(state)})}\n\n"
        elif time.monotonic() - said_s > HEARTBEAT_S:
            said_s = time.monotonic()
            yield ": still here\n\n"
        if follower.live.over:
            return
        await asyncio.sleep(EVERY_S)
