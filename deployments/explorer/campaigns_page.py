"""The page of all campaigns."""

from starlette.requests import Request
from starlette.responses import Response
from starlette.routing import BaseRoute, Route

from vastflow.deployments.explorer.directories import Directories
from vastflow.deployments.explorer.pages import Pages


def routes(directories: Directories, pages: Pages) -> list[BaseRoute]:
    """Return the routes of the page."""

    def campaigns(request: Request) -> Response:
        return pages.page(request, "campaigns.html.j2", found=directories.all(), roots=directories.roots)

    return [Route("/", campaigns)]
