"""The server of a review: one page, what it shows, and the answers that it sends; only who has its token may ask."""

from __future__ import annotations

import hmac
import json
import socket
from collections.abc import Awaitable, Callable, Mapping, MutableMapping
from dataclasses import dataclass, field
from functools import cached_property
from importlib.resources import files
from secrets import token_urlsafe
from threading import Lock
from typing import TYPE_CHECKING

from markupsafe import Markup

from rpil.cli.questions.session import EpisodeVideos, Recorded, Session, choices
from rpil.data.arrays import check_name
from rpil.data.errors import DataError, MissingExtraError
from rpil.data.memory import Parsed
from rpil.results.answering import question_sentence
from rpil.results.html.page import About, View, drawings, html_environment, make_view, render_page

if TYPE_CHECKING:
    from starlette.requests import Request
    from starlette.responses import Response

    from rpil.data.demonstrations import Demonstrations
    from rpil.formats.format import Dataset

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
    token: str = field(default_factory=token_urlsafe)  # of 32 bytes

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


SCRIPTS = "player", "curves", "stage", "notes", "sweep", "finish", "review"
"""Scripts of the page, in the order in which they stand in it."""

JPEG = "image/jpeg"

MAX_NOTE = 500
"""Characters of a note."""

PageChange = Callable[[Mapping[str, Parsed]], View]
"""Changes what is known, as a page says it; "lines" are sentences on what that did."""


@dataclass(eq=False)
class Review:
    """State that the server shows and changes.

    `finish` says which demonstrations are kept, or writes files for what follows; see `rpil.cli.label`.
    """

    session: Session
    about: About
    videos: EpisodeVideos
    finish: PageChange
    data: Demonstrations | Dataset
    lock: Lock = field(default_factory=Lock)

    @cached_property
    def recorded(self) -> Recorded:
        """The data that the page draws."""
        return Recorded(self.data)

    def page(self) -> str:
        """The page of the report with the question above its table. No question and no drawing is part of its view: the
        first is in the `state`, and the script asks for the others.
        """
        with self.lock:
            session, state = self.session, self.state()
            numbers = {str(name): m for m, name in enumerate(session.audit.ids)}
            said = [[numbers[row.id], str(row.label), *row[2:]] for row in session.said]
            view = make_view(session.audit, self.about, 0) | {"question": "", "pair": [], "said": said}
            view |= {"columns": self.recorded.columns}
            question = html_environment("rpil.cli.questions", "").get_template("question.html").render(state)
            scripts = [files("rpil.cli.questions").joinpath(f"{name}.js").read_text("utf-8") for name in SCRIPTS]
            return render_page(session.audit, self.about, live=(view, Markup(question), Markup("\n".join(scripts))))

    def state(self) -> View:
        """The question, and what the last answer changed; all that a page needs to answer."""
        session, audit, question = self.session, self.session.audit, self.session.question
        asked: View = {"demonstrations": [audit.index(name) for name in question]}
        if question:
            asked["sentence"] = question_sentence(audit, question)
            asked["buttons"] = choices(question)
        return {
            "version": session.version,
            "asked": asked,
            "lines": session.lines,
            "changed": [m for m, old in enumerate(session.old.verdicts) if audit.verdicts[m] != old],
            "n_answers": len(session.rows),
            "can_undo": bool(session.given),
            "path": session.path,
        }

    def answer(self, given: Mapping[str, Parsed]) -> View:
        """Answer as a page says it: the numbers of the demonstrations, a key, and perhaps a note."""
        named, ids = given.get("demonstrations"), self.session.audit.ids
        numbers = named if isinstance(named, list) else []
        known = all(type(m) is int and 0 <= m < len(ids) for m in numbers) and len({*numbers}) == len(numbers)
        question = tuple(ids[m] for m in numbers) if known else ()
        if not question or given.get("key") not in ("g", "b", *(choices(question) if len(question) < 3 else ())):
            raise DataError("This answers no question about a demonstration, or about two; reload the page.")
        note = given.get("note", "")
        if not isinstance(note, str) or len(note) > MAX_NOTE:
            raise DataError(f"A note has {MAX_NOTE} characters at most; shorten it.")
        if note.strip():
            check_name(note.strip(), "the note", "the answer")
        rows = given.get("rows", [])
        are_rows = isinstance(rows, list) and len(rows) == 2 and all(type(row) is int for row in rows)
        if rows != [] and not (are_rows and len(question) == 1 and given["key"] in "gb"):
            raise DataError("These are no rows of a demonstration that are good or bad; reload the page.")
        self.session.answer(question, given["key"], note.strip(), *rows)
        return {}

    def undo(self, given: Mapping[str, Parsed]) -> View:
        """Take the last answer back."""
        self.session.undo()
        return {}


def application(review: Review, gate: Gate) -> Application:
    """The server as an ASGI application; only what is posted changes anything."""
    from starlette.applications import Starlette
    from starlette.concurrency import run_in_threadpool
    from starlette.requests import ClientDisconnect
    from starlette.responses import FileResponse, HTMLResponse, JSONResponse, Response
    from starlette.routing import Route

    def get(path: str, respond: Callable[..., object]) -> Route:
        async def endpoint(request: Request) -> Response:
            try:
                if request.path_params.get("m", 0) >= len(session.audit.ids):
                    raise DataError("There is no such demonstration.")
                found = await run_in_threadpool(respond, **request.path_params)
                return found if isinstance(found, Response) else JSONResponse(found)
            except (DataError, MissingExtraError) as error:
                return JSONResponse({"error": str(error)}, 404)

        return Route(path, endpoint)

    def post(path: str, change: PageChange) -> Route:
        async def endpoint(request: Request) -> Response:
            return JSONResponse(*await run_in_threadpool(_changed, review, change, await request.body()))

        return Route(path, endpoint, methods=["POST"])

    videos, session = review.videos, review.session
    routes = [
        get("/", lambda: HTMLResponse(review.page())),
        get("/favicon.ico", lambda: Response(status_code=204)),
        get("/api/version", lambda: {"version": session.version}),
        get("/api/demonstration/{m:int}", lambda m: {"drawing": drawings(session.audit, [m])[str(m)]}),
        get("/api/films/{m:int}", videos.of_one),
        get("/api/curves/{m:int}", review.recorded.curves),
        get("/api/column/{k:int}", review.recorded.column),
        get("/video/{m:int}/{camera:int}", lambda m, camera: FileResponse(videos.file(m, camera))),
        get("/frame/{m:int}/{camera:int}/{step:int}", lambda **at: Response(videos.frame(**at), 200, None, JPEG)),
        post("/api/answer", review.answer),
        post("/api/undo", review.undo),
        post("/api/finish", review.finish),
    ]
    gone = {ClientDisconnect: lambda request, error: Response(status_code=400)}  # nobody waits for an answer
    return guarded_by(gate, Starlette(routes=routes, exception_handlers=gone))


def _changed(review: Review, change: PageChange, body: bytes) -> tuple[View, int]:
    """The answer to a page that asked for a change, and the status: 409 where it had not seen the last change."""
    try:
        given = json.loads(body)
    except (ValueError, RecursionError):
        given = None
    if not isinstance(given, dict):
        return {"error": "The request is no JSON object."}, 400
    with review.lock:
        seen = given.get("version")
        if type(seen) is not int or seen != review.session.version:
            return {"error": "Another tab has answered since; look again."}, 409
        try:
            changed = change(given)
            return review.state() | changed, 200
        except DataError as error:
            return {"error": error.in_shell}, 400


def serve(served: Application, at: socket.socket) -> None:
    """Answer requests until the process is interrupted."""
    import uvicorn

    quiet = {"log_level": "warning", "access_log": False, "server_header": False, "proxy_headers": False}
    config = uvicorn.Config(served, ws="none", lifespan="off", timeout_graceful_shutdown=1, **quiet)
    uvicorn.Server(config).run(sockets=[at])
