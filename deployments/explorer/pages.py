"""Queries and replies: templates of the package, filled in, JSON without NaN, and packed arrays."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any, Final
from urllib.parse import urlencode

from jinja2 import Environment, FileSystemLoader, StrictUndefined
from numpy.typing import NDArray
from starlette.exceptions import HTTPException
from starlette.requests import Request
from starlette.responses import HTMLResponse, JSONResponse, Response

from vastflow.deployments.explorer.packed import packed

TEMPLATES: Final = Path(__file__).with_name("templates")
API: Final = "/api/"
"""Addresses whose errors are JSON, as programs read them."""
ARRAYS: Final = "application/octet-stream"
_MOST_DIGITS: Final = 9


class Pages:
    """The templates, with values escaped."""

    def __init__(self) -> None:
        self._environment = Environment(
            loader=FileSystemLoader(TEMPLATES),
            autoescape=True,
            undefined=StrictUndefined,
            trim_blocks=True,
            lstrip_blocks=True,
        )
        self._environment.globals["address"] = address
        self._environment.filters |= {"percent": percent, "count": count, "moment": moment, "points": points}

    def page(self, request: Request, template: str, status: int = 200, **values: Any) -> HTMLResponse:
        """Return a page; `request` and `values` are names in the template."""
        text = self._environment.get_template(template).render(request=request, **values)
        return HTMLResponse(text.encode(errors="replace"), status)  # names of files and in JSON may be no Unicode

    def part(self, request: Request, template: str, values: Mapping[str, Any]) -> Response:
        """Return values as a part of a page, or as JSON for programs."""
        is_asked = "text/html" in request.headers.get("accept", "")
        return self.page(request, template, **values) if is_asked else JSONResponse(values)

    def sentence(self, request: Request, status: int, text: str) -> Response:
        """Return a page, or JSON below `/api/`, that says in one sentence what went wrong."""
        if request.url.path.startswith(API):
            return JSONResponse({"error": text}, status)
        return self.page(request, "sentence.html.j2", status, text=text, number=status)


def address(path: str, **query: object) -> str:
    """Return an address with names in its query, whatever characters they have; None leaves a name out."""
    given = {key: value for key, value in query.items() if value is not None}
    return f"{path}?{urlencode(given, errors='replace')}" if given else path


def percent(share: float | None) -> str:
    """Return a share in percent, or a dash for one that was not measured."""
    return "–" if share is None else f"{100 * share:.1f} %"


def points(share: float) -> str:
    """Return a difference of shares in percentage points, with its sign."""
    text = f"{100 * share:+.1f}".replace("-", "−")
    return "0.0" if text in ("+0.0", "−0.0") else text


def count(number: object) -> str:
    """Return a number with separators of thousands, or a dash for what is none."""
    return f"{number:,}" if isinstance(number, int | float) else "–"


def moment(iso: str) -> str:
    """Return a time of ISO 8601 for people, to the minute."""
    return iso.replace("T", " ")[:16]


def name_of(request: Request, name: str) -> str:
    """Return a text of the query; raises `HTTPException` without it."""
    if not (given := request.query_params.get(name, "")):
        raise HTTPException(400, f"{name}: expected a value in the address, got none")
    return given


def number_of(request: Request, name: str, otherwise: int | None = None) -> int:
    """Return a whole number of the query; raises `HTTPException` for something else, and for none without `otherwise`."""
    if otherwise is not None and name not in request.query_params:
        return otherwise
    if not (given := name_of(request, name)).isdecimal() or len(given) > _MOST_DIGITS:
        raise HTTPException(400, f"{name}: expected a whole number, got {given!r}")
    return int(given)


def arrays_reply(header: Mapping[str, Any], arrays: Mapping[str, NDArray[Any]]) -> Response:
    """Return arrays by name, see `vastflow.deployments.explorer.packed`."""
    return Response(packed(header, arrays), media_type=ARRAYS)
