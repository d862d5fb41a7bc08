"""The live page: a campaign while it runs, its runs so far, and the request to stop it."""

import asyncio
import json
import time
from collections.abc import AsyncIterator
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
from vastflow.oracles.results.events import Event, EventReader
from vastflow.oracles.results.unfinished import ask_to_stop, is_running, place_of

EVERY_S: Final = 0.5
HEARTBEAT_S: Final = 15.0
_LOOKS: Final = 3
"""Looks in a row that find no process, before it counts as gone: a folder may be renamed during one."""
_MOST_BYTES: Final = 10_000
_GONE: Final = {"reason": "its process is gone"}


class Follower:
    """Follows a campaign's events, wherever its directory is by now."""

    def __init__(self, directory: CampaignDirectory) -> None:
        self._reader = EventReader(directory.path)
        self._looks = 0
        self.damaged = 0
        self.live = LiveCampaign()

    def look(self) -> dict[str, Any]:
        """Return the present state."""
        place = place_of(self._reader.directory)
        self._looks = 0 if place is not None and is_running(place) else self._looks + 1
        try:
            events = self._reader.new()  # after the look at the process, which may have written its last line since
        except OSError:
            events = []
        for event in events:
            try:
                self.live.take(event)
            except (KeyError, TypeError, ValueError):
                self.damaged += 1
        whole = place == self._reader.directory
        if self._looks >= _LOOKS and not self.live.over:
            now = datetime.now().astimezone()
            self.live.take(Event(now, "ended") if whole else Event(now, "stopped", _GONE))
        state = self.live.state(time.time())
        return {**state, "damaged": self.damaged + self._reader.damaged, "whole": whole}


def routes(directories: Directories, pages: Pages) -> list[BaseRoute]:
    """Return the routes of the page, of a run, of the events, and of the request to stop."""

    previews = Previews(directories)

    def page(request: Request) -> Response:
        return pages.page(request, "live.html.j2", campaign=directories.find(request.query_params.get("c", "")))

    def run(request: Request) -> Response:
        given = request.query_params
        campaign, run_index = directories.find(given.get("c", "")), given.get("run", "")
        if not run_index.isdecimal() or len(run_index) > 9:
            raise HTTPException(400, f"Expected the index of a run, got {run_index!r}.")
        name = given.get("configuration", "")
        shown = campaign if campaign.state == "finished" else previews.of(campaign, name, int(run_index))
        return RedirectResponse(address("/run", c=shown.id, configuration=name, run=run_index), 303)

    async def events(request: Request) -> Response:
        follower = Follower(await asyncio.to_thread(directories.find, request.query_params.get("c", "")))
        return StreamingResponse(_stream(follower), media_type="text/event-stream")

    async def stop(request: Request) -> Response:
        campaign = await asyncio.to_thread(directories.find, request.query_params.get("c", ""))
        try:
            reason = json.loads(await _body(request))["reason"].strip()
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


async def _body(request: Request) -> bytes:
    content = b""
    async for part in request.stream():
        content += part
        if len(content) > _MOST_BYTES:
            raise HTTPException(413, f"Expected at most {_MOST_BYTES:,} bytes.")
    return content


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
