"""Replies of the explorer's views: JSON without NaN, arrays, and their ETags."""

import hashlib
import json
from collections.abc import Callable, Mapping
from typing import Any, Final

from numpy.typing import NDArray
from starlette.requests import Request
from starlette.responses import Response

from vastflow.deployments.explorer.opened import Campaign
from vastflow.deployments.explorer.packed import packed
from vastflow.sim.model.faults import UserError

ARRAYS: Final = "application/octet-stream"


class BadRequest(UserError, ValueError):
    """A request whose query can't be answered; the message says what was expected."""


def number_of(request: Request, name: str, otherwise: int, most: int) -> int:
    """Return a whole number of the query, at most `most`.

    Raises:
        BadRequest: something else.
    """
    text = request.query_params.get(name, str(otherwise))
    if not text.isdecimal():
        raise BadRequest(f"{name}: expected a whole number, got {text!r}")
    return min(int(text), most)


def name_of(request: Request, name: str) -> str:
    """Return a text of the query; raises `BadRequest` without it."""
    if name not in request.query_params:
        raise BadRequest(f"{name}: expected a value in the address, got none")
    return request.query_params[name]


def json_reply(value: Any) -> Response:
    """Return `value` as JSON; numbers that are not finite have to be None."""
    return Response(json.dumps(value, allow_nan=False, ensure_ascii=False), media_type="application/json")


def arrays_reply(header: Mapping[str, Any], arrays: Mapping[str, NDArray[Any]]) -> Response:
    """Return arrays by name, see `vastflow.deployments.explorer.packed`."""
    return Response(packed(header, arrays), media_type=ARRAYS)


def unless_known(request: Request, campaign: Campaign, made: Callable[[], Response]) -> Response:
    """Return the reply of an unchanged campaign to an address, or 304 to a browser that has it."""
    text = f"{campaign.stamp}{request.url.path}?{request.url.query}"
    tag = f'"{hashlib.sha256(text.encode()).hexdigest()[:24]}"'
    if request.headers.get("if-none-match") == tag:
        return Response(status_code=304, headers={"ETag": tag})
    reply = made()
    reply.headers["ETag"] = tag
    return reply
