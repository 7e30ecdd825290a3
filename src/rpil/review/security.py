"""Who may ask the server of a review, and for what: pages of its own on this computer, with its token."""

from __future__ import annotations

import hmac
import json
import secrets
from collections.abc import Awaitable, Callable, Mapping, MutableMapping
from dataclasses import dataclass
from urllib.parse import parse_qs

MAX_BODY = 4096
"""Bytes of what is posted: ids, a key and a version."""

TOKEN_HEADER = "x-rpil-token"

RESPONSE_HEADERS = {
    "cache-control": "no-store",
    "content-security-policy": "frame-ancestors 'none'",
    "cross-origin-resource-policy": "same-origin",
    "cross-origin-opener-policy": "same-origin",
    "referrer-policy": "no-referrer",
    "x-content-type-options": "nosniff",
}
"""Of every answer; the page itself says which scripts it has."""

Message = MutableMapping[str, object]
Receive = Callable[[], Awaitable[Message]]
Send = Callable[[Message], Awaitable[None]]
Application = Callable[[Message, Receive, Send], Awaitable[None]]
"""As ASGI defines them."""


@dataclass(frozen=True)
class Gate:
    """The port of a server and the token that whoever asks must show, as a cookie or a header."""

    port: int
    token: str

    @classmethod
    def new(cls, port: int) -> Gate:
        return cls(port, secrets.token_urlsafe(32))

    @property
    def url(self) -> str:
        """What opens the page."""
        return f"http://127.0.0.1:{self.port}/?token={self.token}"

    @property
    def cookie(self) -> str:
        """Its name: cookies of one computer are shared by all ports."""
        return f"rpil-review-{self.port}"

    def refusal(self, method: str, headers: Mapping[str, str]) -> tuple[int, str] | None:
        """The status and the sentence with which a request is refused, or None."""
        if (refused := self.refuse_host(headers)) is not None:
            return refused
        if not any(map(self.knows, [headers.get(TOKEN_HEADER, ""), *self._cookies(headers)])):
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
        if not (length.isascii() and length.isdigit()):
            return 411, "The length of an answer must be given."
        return (413, f"An answer has {MAX_BODY:,} bytes at most.") if int(length[:20]) > MAX_BODY else None

    def refuse_host(self, headers: Mapping[str, str]) -> tuple[int, str] | None:
        """The refusal where another name than this computer's was asked: its owner could make a browser read all."""
        if headers.get("host") in (f"127.0.0.1:{self.port}", f"localhost:{self.port}"):
            return None
        return 421, f"This server is called 127.0.0.1:{self.port}."

    def knows(self, token: str) -> bool:
        return hmac.compare_digest(token.encode(), self.token.encode())

    def _cookies(self, headers: Mapping[str, str]) -> list[str]:
        pairs = (part.strip().partition("=") for part in headers.get("cookie", "").split(";"))
        return [value for name, _, value in pairs if name == self.cookie]


def guarded_by(gate: Gate, application: Application) -> Application:
    """The application behind a gate; the address with the token leads to the page, with a cookie."""

    async def guarded(scope: Message, receive: Receive, send: Send) -> None:
        headers = {name.decode("latin-1"): value.decode("latin-1") for name, value in scope["headers"]}  # type: ignore[attr-defined]
        method, path, query = str(scope["method"]), scope["path"], bytes(scope["query_string"])  # type: ignore[call-overload]

        async def send_with_headers(message: Message) -> None:
            if message["type"] == "http.response.start":
                own = [(name.encode(), value.encode()) for name, value in RESPONSE_HEADERS.items()]
                message["headers"] = [*message.get("headers", ()), *own]  # type: ignore[misc]
            await send(message)

        given = parse_qs(query.decode("latin-1")).get("token", []) if path == "/" and method == "GET" else []
        if given and gate.refuse_host(headers) is None and gate.knows(given[0]):
            cookie = f"{gate.cookie}={gate.token}; Path=/; HttpOnly; SameSite=Strict"
            await _respond(send_with_headers, 303, "", location="/", set_cookie=cookie)
        elif (refused := gate.refusal(method, headers)) is not None:
            await _respond(send_with_headers, refused[0], json.dumps({"error": refused[1]}), connection="close")
        else:
            await application(scope, receive, send_with_headers)

    return guarded


async def _respond(send: Send, status: int, text: str, **headers: str) -> None:
    given = {"content-type": "application/json", "content-length": str(len(text.encode())), **headers}
    named = [(name.replace("_", "-").encode(), value.encode()) for name, value in given.items()]
    await send({"type": "http.response.start", "status": status, "headers": named})
    await send({"type": "http.response.body", "body": text.encode()})
