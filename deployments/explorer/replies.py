"""Queries and replies of the explorer's views: JSON without NaN, and packed arrays."""

import json
from collections.abc import Mapping
from typing import Any, Final

from numpy.typing import NDArray
from starlette.exceptions import HTTPException
from starlette.requests import Request
from starlette.responses import Response

from vastflow.deployments.explorer.packed import packed

ARRAYS: Final = "application/octet-stream"
_MOST_DIGITS: Final = 9


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


def wants_html(request: Request) -> bool:
    """Whether a request asks for a part of a page, and not for its values."""
    return "text/html" in request.headers.get("accept", "")


def json_reply(value: Any) -> Response:
    """Return `value` as JSON; numbers that are not finite have to be None."""
    return Response(json.dumps(value, allow_nan=False, ensure_ascii=False), media_type="application/json")


def arrays_reply(header: Mapping[str, Any], arrays: Mapping[str, NDArray[Any]]) -> Response:
    """Return arrays by name, see `vastflow.deployments.explorer.packed`."""
    return Response(packed(header, arrays), media_type=ARRAYS)
