"""Access to the explorer: a token, the hosts and origins that may ask, and the headers of every reply."""

import hashlib
import hmac
import re
import secrets
from collections.abc import Callable, Collection
from typing import Final
from urllib.parse import parse_qsl, quote, urlencode

from starlette.datastructures import MutableHeaders
from starlette.requests import Request
from starlette.responses import RedirectResponse, Response
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from vastflow.sim.plug_ins.loading import code_from

TOKEN: Final = "token"
HOST: Final = re.compile(r"(127\.0\.0\.1|localhost|\[::1\])(:\d{1,5})?")
"""Names of this machine. Any other is a foreign page's that was made to point here."""
OPEN: Final = "/static/"
"""Files of the package, which the page that asks for the token needs as well."""

HEADERS: Final = {
    "Content-Security-Policy": "default-src 'self'; img-src 'self' data: blob:; object-src 'none'; base-uri 'none'; "
    "form-action 'self'; frame-ancestors 'none'",
    "X-Content-Type-Options": "nosniff",
    "Referrer-Policy": "no-referrer",
    "Cross-Origin-Resource-Policy": "same-origin",
    "Cross-Origin-Opener-Policy": "same-origin",
    "Cache-Control": "no-cache",
}
"""Headers of replies that don't set them."""


class Guard:
    """An application behind a token, of which nothing executes code of campaigns.

    Args:
        app: The guarded application.
        token: The secret, which the first address carries.
        once: Other secrets, each good for one exchange for a cookie.
        refuse: Makes the page of a status and a sentence.
    """

    def __init__(
        self, app: ASGIApp, token: str, once: Collection[str], refuse: Callable[[Request, int, str], Response]
    ) -> None:
        self._app, self._token, self._once, self._refuse = app, token, {*once}, refuse
        self._secret = secrets.token_bytes()
        # Browsers send cookies to all ports of a host, so that two explorers need two names.
        self._cookie = f"vastflow-{hashlib.sha256(self._secret).hexdigest()[:8]}"

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Answer a request, or hand it on."""
        if scope["type"] != "http":  # no page uses a web socket
            if scope["type"] == "lifespan":
                await self._app(scope, receive, send)
            return

        async def send_with_headers(message: Message) -> None:
            if message["type"] == "http.response.start":
                headers = MutableHeaders(scope=message)
                for name, value in HEADERS.items():
                    headers.setdefault(name, value)
            await send(message)

        answer = self._answer(Request(scope)) or self._app
        with code_from(()):
            await answer(scope, receive, send_with_headers)

    def _answer(self, request: Request) -> Response | None:
        if not HOST.fullmatch(request.headers.get("host", "")):
            return self._refuse(request, 421, "This explorer answers at 127.0.0.1 and localhost only.")
        own_origin = f"{request.url.scheme}://{request.headers.get('host', '')}"
        if request.method not in ("GET", "HEAD") and request.headers.get("origin") != own_origin:
            return self._refuse(request, 403, "Changes are taken from the explorer's own pages only.")
        given = request.query_params.get(TOKEN)
        if given is not None and is_one_of(given, (self._token, *self._once)):
            self._once.discard(given)
            return self._admitted(request)
        has_cookie = is_one_of(request.cookies.get(self._cookie, ""), (self._content(request),))
        if given is None and (has_cookie or request.url.path.startswith(OPEN)):
            return None
        return self._refuse(request, 403, "Open the address that `vastflow ui` printed. It carries the token.")

    def _content(self, request: Request) -> str:
        """Return the cookie of this server under the name and port that a request has."""
        return hmac.new(self._secret, request.headers.get("host", "").encode(), "sha256").hexdigest()

    def _admitted(self, request: Request) -> Response:
        """Return the redirect that sets the cookie, so that the token stays in no address."""
        rest = [each for each in parse_qsl(request.url.query, keep_blank_values=True) if each[0] != TOKEN]
        # One leading slash: two would name another host.
        path = quote("/" + request.url.path.lstrip("/\\"))
        place = f"{path}?{urlencode(rest)}" if rest else path
        answer: Response = RedirectResponse(place, 303)
        if request.headers.get("sec-fetch-site") == "cross-site":
            # From a file's page a browser does not send the cookie with a redirect, but with what our own page asks for.
            answer = Response(headers={"Refresh": f"0; url={place}"}, media_type="text/html")
        answer.set_cookie(self._cookie, self._content(request), httponly=True, samesite="strict", path="/")
        return answer


def is_one_of(given: str, known: Collection[str]) -> bool:
    """True if a secret is known, compared in a time that tells nothing of it."""
    return any(hmac.compare_digest(given.encode(errors="replace"), each.encode()) for each in known)
