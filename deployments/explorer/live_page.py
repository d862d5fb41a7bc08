"""The live page: a campaign while it runs, its runs so far, and the request to stop it."""

import asyncio
import json
import time
from collections.abc import AsyncIterator
from contextlib import suppress
from datetime import datetime
from typing import Any, Final

from starlette.exceptions import HTTPException
from starlette.requests import Request
from starlette.responses import JSONResponse, RedirectResponse, Response, StreamingResponse
from starlette.routing import BaseRoute, Route

from vastflow.deployments.explorer.directories import CampaignDirectory, Directories
from vastflow.deployments.explorer.live import LiveCampaign
from vastflow.deployments.explorer.pages import Pages, address
from vastflow.deployments.explorer.preview import Previews
from vastflow.deployments.explorer.replies import name_of, number_of
from vastflow.oracles.results.events import LAST, Event, EventReader, gone_event
from vastflow.oracles.results.unfinished import ask_to_stop, place_of

EVERY_S: Final = 0.5
HEARTBEAT_S: Final = 15.0


class Follower:
    """Follows a campaign's events, wherever its directory is by now."""

    def __init__(self, directory: CampaignDirectory) -> None:
        self._reader = EventReader(directory.path)
        self.damaged = 0
        self.live = LiveCampaign()

    def look(self) -> dict[str, Any]:
        """Return the present state."""
        events, reader = [], self._reader
        with suppress(OSError):
            events = reader.new()
        whole = place_of(reader.directory) == reader.directory
        if reader.gone and not any(event.event in LAST for event in events) and not self.live.over:
            events.append(Event(datetime.now().astimezone(), "ended") if whole else gone_event())
        for event in events:
            try:
                self.live.take(event)
            except (KeyError, TypeError, ValueError):
                self.damaged += 1
        return {**self.live.state(time.time()), "damaged": self.damaged + reader.damaged, "whole": whole}


def routes(directories: Directories, pages: Pages) -> list[BaseRoute]:
    """Return the routes of the page, of a run, of the events, and of the request to stop."""

    previews = Previews(directories)

    def page(request: Request) -> Response:
        return pages.page(request, "live.html.j2", campaign=directories.find(name_of(request, "c")))

    def run(request: Request) -> Response:
        campaign, name = directories.find(name_of(request, "c")), name_of(request, "configuration")
        run_index = number_of(request, "run")
        shown = campaign if campaign.state == "finished" else previews.of(campaign, name, run_index)
        return RedirectResponse(address("/run", c=shown.id, configuration=name, run=run_index), 303)

    async def events(request: Request) -> Response:
        follower = Follower(await asyncio.to_thread(directories.find, name_of(request, "c")))
        return StreamingResponse(_stream(follower), media_type="text/event-stream")

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
        Route("/live-run", run),
        Route("/api/events", events),
        Route("/api/stop", stop, methods=["POST"]),
    ]


async def _stream(follower: Follower) -> AsyncIterator[str]:
    """Yield states as they change, to that of the end, and comments as signs of life."""
    shown, said_s = "", time.monotonic()
    while True:
        text = json.dumps(await asyncio.to_thread(follower.look))
        if text != shown:
            shown, said_s = text, time.monotonic()
            yield f"data: {text}\n\n"
        elif time.monotonic() - said_s > HEARTBEAT_S:
            said_s = time.monotonic()
            yield ": still here\n\n"
        if follower.live.over:
            return
        await asyncio.sleep(EVERY_S)
