"""Who may ask the server of a review, and for what: pages of its own on this computer, with its token."""

from __future__ import annotations

import hmac
from collections.abc import Awaitable, Callable, Mapping, MutableMapping
from dataclasses import dataclass
from secrets import token_urlsafe

MAX_BODY, MAX_ADDRESS = 65_536, 4096
"""Bytes of what is posted, and of an address, in which Python reads no longer number."""

TOKEN_HEADER = "x-rpil-token"

RESPONSE_HEADERS = {
    "cache-control": "no-store",
    "content-security-policy": "frame-ancestors 'none'",
    "cross-origin-resource-policy": "same-origin",
    "cross-origin-opener-policy": "same-origin",
    "referrer-policy": "no-referrer",
    "x-content-type-options": "nosniff",
}
"""Headers of every answer; the page itself says which scripts it has."""

Message = MutableMapping[str, object]
Receive = Callable[[], Awaitable[Message]]
Send = Callable[[Message], Awaitable[None]]
Application = Callable[[Message, Receive, Send], Awaitable[None]]
"""As ASGI defines them."""


@dataclass(frozen=True)
class Gate:
    """The port of a server, and the token that who asks must show as a cookie or a header."""

    port: int
    token: str

    @classmethod
    def new(cls, port: int) -> Gate:
        return cls(port, token_urlsafe(32))

    @property
    def url(self) -> str:
        """Address with the token, which opens the page."""
        return f"http://127.0.0.1:{self.port}/?token={self.token}"

    @property
    def cookie(self) -> str:
        """Its name: cookies of one computer are shared by all ports."""
        return f"rpil-review-{self.port}"

    def knows(self, token: str) -> bool:
        return hmac.compare_digest(token.encode(), self.token.encode())

    def is_host(self, headers: Mapping[str, str]) -> bool:
        """Whether this computer was asked by its own name: the owner of another name could make a browser read all."""
        return headers.get("host") in (f"127.0.0.1:{self.port}", f"localhost:{self.port}")

    def refusal(self, method: str, headers: Mapping[str, str], cookie: str) -> tuple[int, str] | None:
        """The status and the sentence with which a request is refused, or None."""
        if not self.is_host(headers):
            return 421, f"This server is called 127.0.0.1:{self.port}."
        if not any(map(self.knows, [headers.get(TOKEN_HEADER, ""), cookie])):
            return 403, "This page needs the token of its address; open the address that rpil review printed."
        if method in ("GET", "HEAD"):
            return None
        if method != "POST":
            return 405, f"{method[:20]} is not allowed."
        if headers.get("origin") != f"http://{headers['host']}":
            return 403, "Only the page of this review may change it."
        if headers.get("content-type", "").partition(";")[0].strip().lower() != "application/json":
            return 415, "An answer is JSON."
        length = headers.get("content-length", "")
        if "transfer-encoding" in headers or not (length.isascii() and length.isdigit()):
            return 411, "The length of an answer must be given."
        return (413, f"An answer has {MAX_BODY:,} bytes at most.") if int(length[:20]) > MAX_BODY else None


def guarded_by(gate: Gate, application: Application) -> Application:
    """The application behind a gate; the address with the token leads to the page, with a cookie."""
    from starlette.datastructures import MutableHeaders
    from starlette.requests import Request
    from starlette.responses import HTMLResponse, JSONResponse

    async def guarded(scope: Message, receive: Receive, send: Send) -> None:
        async def send_with_headers(message: Message) -> None:
            if message["type"] == "http.response.start":
                MutableHeaders(scope=message).update(RESPONSE_HEADERS)
            await send(message)

        request = Request(scope)
        asked, given = (request.method, scope["path"]), request.query_params.get("token", "")
        respond = application
        if asked == ("GET", "/") and gate.is_host(request.headers) and gate.knows(given):
            # With status 303 a browser that followed a link of another site would keep the cookie back.
            respond = HTMLResponse('<meta http-equiv="refresh" content="0; url=/">')
            respond.set_cookie(gate.cookie, gate.token, httponly=True, samesite="strict")
        elif refused := gate.refusal(request.method, request.headers, request.cookies.get(gate.cookie, "")):
            respond = JSONResponse({"error": refused[1]}, refused[0], {"connection": "close"})
        elif len(request.url.path) > MAX_ADDRESS:
            respond = JSONResponse({"error": "There is no such address."}, 404)
        await respond(scope, receive, send_with_headers)

    return guarded
