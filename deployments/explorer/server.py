"""The server: the pages' routes, behind the guard, on this machine."""

from collections.abc import Collection
from pathlib import Path
from typing import Final

from starlette.applications import Starlette
from starlette.exceptions import HTTPException
from starlette.middleware import Middleware
from starlette.requests import Request
from starlette.responses import Response
from starlette.routing import Mount
from starlette.staticfiles import StaticFiles

from vastflow.deployments.explorer import campaign_page, campaigns_page, comparison_page, live_page, run_page
from vastflow.deployments.explorer.directories import Directories, NoSuchCampaign
from vastflow.deployments.explorer.pages import Pages
from vastflow.deployments.explorer.security import HEADERS, Guard
from vastflow.sim.model.faults import UserError

STATIC: Final = Path(__file__).with_name("static")
PAGES: Final = (campaigns_page, campaign_page, comparison_page, live_page, run_page)


def application(directories: Directories, token: str, once: Collection[str] = ()) -> Starlette:
    """Return the explorer of some campaign directories, to which `token` admits, and each of `once` one browser."""
    pages = Pages()

    async def unusable(request: Request, error: Exception) -> Response:
        return pages.sentence(request, 404 if isinstance(error, NoSuchCampaign) else 409, str(error))

    async def refused(request: Request, error: Exception) -> Response:
        assert isinstance(error, HTTPException)
        words = {404: "There is nothing at this address.", 405: "This address takes no such request."}
        return pages.sentence(request, error.status_code, words.get(error.status_code, error.detail))

    async def failed(request: Request, error: Exception) -> Response:
        # Starlette raises it again, so that the terminal shows where; this reply does not pass the guard.
        reply = pages.sentence(request, 500, f"The explorer failed: {type(error).__name__}: {error}")
        reply.headers.update(HEADERS)
        return reply

    routes = [each for page in PAGES for each in page.routes(directories, pages)]
    return Starlette(
        routes=[*routes, Mount("/static", StaticFiles(directory=STATIC))],
        middleware=[Middleware(Guard, token=token, once=once, refuse=pages.sentence)],
        exception_handlers={
            NoSuchCampaign: unusable,
            UserError: unusable,
            HTTPException: refused,
            Exception: failed,
        },
    )
