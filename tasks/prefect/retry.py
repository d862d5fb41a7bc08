"""Patience with a Prefect server that is away: requests are made again, for a bounded time. Importing it imports Prefect."""

import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Final, TypeVar

import httpx
from prefect.exceptions import PrefectHTTPStatusError
from prefect.settings import temporary_settings

AT_THE_END_S: Final = 20.0
"""So long a server may be away when all is computed and Prefect is only to be told; its clients then try for as long again."""

IN_BETWEEN_S: Final = 60.0
"""So long one without which nothing goes on; it starts in a quarter of that, in half of it on a busy machine."""

RETRIES: Final = 2
"""Of a request by Prefect's own client, which takes some 10 s then; see `bounded`."""

_PAUSE_S: Final = 1.0
_SERVER_FAULT: Final = 500

T = TypeVar("T")


@contextmanager
def bounded() -> Iterator[None]:
    """Let Prefect's clients give up a request in this context after some seconds.

    By default each takes more than a minute, and a flow that ends makes several, one after the other: of a server that is gone
    it would hear five minutes later. What the user has set stays.
    """
    with temporary_settings(set_defaults={"client.max_retries": RETRIES}):
        yield


def retried(
    request: Callable[[], T],
    away_s: float,
    ended: Callable[[], bool] = lambda: False,
    missed: Callable[[Exception], None] = lambda error: None,
) -> T:
    """The answer to a request, which is made again while the server is away, for `away_s` at the most.

    Args:
        ended: Whether nobody waits for an answer any more.
        missed: Is told when the server is found to be away.

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
        time.sleep(_PAUSE_S)


def is_away(error: Exception) -> bool:
    """Whether an error says that the server is not there or not itself, and nothing about the request."""
    if isinstance(error, PrefectHTTPStatusError):
        return bool(error.response.status_code >= _SERVER_FAULT)
    return isinstance(error, httpx.TransportError)
