"""Retries of requests to a Prefect server that is away, for a bounded time. Importing this module imports Prefect."""

import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Final, TypeVar

import httpx
from prefect.exceptions import PrefectHTTPStatusError
from prefect.settings import temporary_settings

AT_THE_END_S: Final = 20.0
"""Time that a server may be away when all is computed; Prefect's clients then try for as long again."""

IN_BETWEEN_S: Final = 60.0
"""Time that an indispensable server may be away; it starts in a quarter of that, or half on a busy machine."""

RETRIES: Final = 2
"""Retries of a request by Prefect's own client, which takes some 10 s then; see `bounded`."""

PAUSE_S: Final = 1.0
_SERVER_FAULT: Final = 500

T = TypeVar("T")


@contextmanager
def bounded() -> Iterator[None]:
    """Let Prefect's clients give up a request after some seconds, unless the user has set how often they try.

    By default each tries for more than a minute, and an ending flow makes several requests in sequence.
    """
    with temporary_settings(set_defaults={"client.max_retries": RETRIES}):
        yield


def retried(
    request: Callable[[], T],
    away_s: float,
    ended: Callable[[], bool] = lambda: False,
    missed: Callable[[Exception], None] = lambda error: None,
) -> T:
    """Return the answer to a request, retried while the server is away, for `away_s` at the most.

    Args:
        ended: Returns True if nobody waits for an answer any more.
        missed: Called once, when the server is away.

    Raises:
        httpx.TransportError, PrefectHTTPStatusError: the server stayed away, or refused the request.
    """
    deadline = time.monotonic() + away_s
    tries = 0
    while True:
        try:
            return request()
        except (httpx.TransportError, PrefectHTTPStatusError) as error:
            if not is_away(error) or ended() or time.monotonic() > deadline:
                raise
            if not tries:
                missed(error)
        tries += 1
        time.sleep(PAUSE_S)


def busy(error: BaseException) -> bool:
    """True if a server is there and can't answer now; Prefect may have wrapped its error."""
    status = isinstance(error, PrefectHTTPStatusError) and error.response.status_code >= _SERVER_FAULT
    slow = isinstance(error, httpx.TimeoutException)
    return status or slow or (error.__cause__ is not None and busy(error.__cause__))


def is_away(error: Exception) -> bool:
    """True if an error is about the server and not about the request."""
    if isinstance(error, PrefectHTTPStatusError):
        return bool(error.response.status_code >= _SERVER_FAULT)
    return isinstance(error, httpx.TransportError)
