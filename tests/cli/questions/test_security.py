"""Who may ask the server of a review, and for what."""

import json
from pathlib import Path

import pytest

from rpil.cli.questions.server import MAX_BODY
from served import need_server, review_of, serving

need_server()

GETS = ("/", "/api/version", "/api/demonstration/0", "/video/0/0", "/frame/0/0/0")


@pytest.fixture(scope="module")
def server(audit, tmp_path_factory):
    """A server that no test changes."""
    labels = tmp_path_factory.mktemp("server") / "labels.csv"
    with serving(review_of(audit, str(labels))) as client:
        yield client
        assert not labels.exists()


@pytest.fixture
def client(server):
    yield server
    assert server.get("/api/version") == {"version": 0}, "something was changed"


def test_the_address_with_the_token_leads_to_the_page_with_a_cookie(client):
    status, headers, content = client.ask("GET", f"/?token={client.gate.token}", cookie=None)
    assert (status, content) == (200, b'<meta http-equiv="refresh" content="0; url=/">')
    name, _, rest = headers["set-cookie"].partition("=")
    assert {*rest.lower().split("; ")[1:]} == {"path=/", "httponly", "samesite=strict"}
    assert headers["referrer-policy"] == "no-referrer"
    given = f"other=1; {name}={rest.partition(';')[0]}"
    assert client.ask("GET", "/", cookie=given)[0] == 200
    assert str(client.gate.port) in name, "servers at two ports share all cookies"
    for token, status in ((client.gate.token, 200), ("no", 403)):  # of another program, in a header
        assert client.ask("GET", "/api/version", cookie=None, x_rpil_token=token)[0] == status


def test_without_the_token_nothing_is_told(client):
    for cookie in (None, "", "rpil-review-1=x", "{name}=", "{name}=wrong", "{name}={token}x"):
        given = cookie and cookie.format(name=client.gate.cookie, token=client.gate.token)
        for path in (*GETS, "/?token=", "/?token=wrong", "/nothing", "/api/answer"):
            status, headers, content = client.ask("GET", path, cookie=given)
            assert status == 403, (cookie, path)
            assert "token" in json.loads(content)["error"]
            assert "set-cookie" not in headers
        assert client.ask("POST", "/api/answer", {}, cookie=given)[0] == 403


def test_another_name_of_the_server_is_refused(client):
    """A page whose name was made to lead to this computer could read all that its own server answers."""
    names = "evil.example", "127.0.0.1", "127.0.0.1:1", "[::1]:{port}", "localhost.evil:{port}", "[", ""
    for host in (name.format(port=client.gate.port) for name in names):
        for path in (*GETS, f"/?token={client.gate.token}"):
            status, headers, _ = client.ask("GET", path, host=host)
            assert status == 421, (host, path)
            assert "set-cookie" not in headers
        assert client.ask("POST", "/api/undo", {"version": 0}, host=host, origin=f"http://{host}")[0] == 421


BODY = {"version": 0, "demonstrations": [0], "key": "g"}


def test_another_page_may_change_nothing_also_by_what_a_form_can_post(client):
    for origin in (None, "null", "http://evil.example", "http://127.0.0.1", "https://127.0.0.1:{port}"):
        given = origin and origin.format(port=client.gate.port)
        for path in ("/api/answer", "/api/undo", "/api/finish"):
            assert client.ask("POST", path, BODY, origin=given)[0] == 403, (origin, path)
    for kind in (None, "text/plain", "application/x-www-form-urlencoded", "application/jsonx"):
        assert client.ask("POST", "/api/answer", BODY, content_type=kind)[0] == 415, kind


def test_what_is_posted_is_bounded(client):
    for body, length, status in (
        (b" " * (MAX_BODY + 1), str(MAX_BODY + 1), 413),
        (b"", "9" * 19, 413),
        (b"2\r\n{}\r\n0\r\n\r\n", None, 411),
        (b"", "-2", 400),  # what a server has not read when it closes can be lost with its answer
        (b"[" * MAX_BODY, str(MAX_BODY), 400),
        (b"\xff", "1", 400),
        (b"[]", "2", 400),
        (b"", "0", 400),
    ):
        chunked = {"transfer_encoding": "chunked"} if length is None else {}
        assert client.ask("POST", "/api/answer", body, content_length=length, **chunked)[0] == status, length
    body = b'd\r\n{"version": 9}\r\n0\r\n\r\n'
    status = client.ask("POST", "/api/undo", body, content_length="2", transfer_encoding="chunked")[0]
    assert status in (400, 411)  # the server itself may refuse it


def test_to_read_changes_nothing(client):
    for method in ("PUT", "DELETE", "OPTIONS", "PATCH", "TRACE"):
        assert client.ask(method, "/api/answer")[0] == 405, method
    for path in (*GETS, "/api/answer", "/api/undo", "/api/finish", "/api/answer?version=0&key=g&demonstrations=0"):
        for method in ("GET", "HEAD"):
            assert client.ask(method, path)[0] in (200, 404, 405)


NO_PATHS = ("/video/../../etc/passwd", "/video/%2e%2e/%2e%2e/etc/passwd", "/video/0/..%2f..%2fd.parquet", "/d.parquet")
NO_PATHS += ("/video/0/-1", "/video/-1/0", "/video/0/00000000000000000001", "/video/99999999999999999999999/0")
NO_PATHS += ("//etc/passwd", "/frame/0/0/-1", "/frame/0/0/99999999999999999999", "/frame/..%2f/0/0", "/labels.csv")
NO_PATHS += ("/api/demonstration/24", *(f"/api/demonstration/{'9' * digits}" for digits in (20, 190, 5000)))


def test_no_path_of_a_request_is_opened(client):
    Path("d.parquet").write_text("secret")
    for path in NO_PATHS:
        status, _, content = client.ask("GET", path)
        assert status == 404, path
        assert b"secret" not in content
        assert b"root:" not in content


def test_every_answer_forbids_what_pages_of_others_could_do(client):
    for path in ("/", "/nothing", "/video/0/0"):
        headers = client.ask("GET", path)[1]
        assert headers["cross-origin-resource-policy"] == "same-origin"
        assert headers["x-content-type-options"] == "nosniff"
        assert "frame-ancestors 'none'" in headers["content-security-policy"]
        assert headers["cache-control"] == "no-store"
