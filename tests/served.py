"""The server of a review in a thread, and requests to it."""

import http.client
import json
import re
import socket
import subprocess
import sys
import threading
import time
from contextlib import contextmanager
from dataclasses import replace

import numpy as np
import pytest

from rpil.cli.questions.server import Gate, Review, application
from rpil.cli.questions.session import EpisodeVideos, Session
from rpil.data.demonstrations import Demonstrations
from rpil.data.errors import MissingExtraError, optional
from rpil.results.html.page import About


def need_server():
    """Skip the tests of a module where the extra is not installed."""
    try:
        optional("starlette", "To review on a page", "review")
    except MissingExtraError as error:
        pytest.skip(str(error), allow_module_level=True)


class Client:
    """A browser's requests to a server, with its token as a cookie."""

    def __init__(self, gate):
        self.gate = gate
        self.host = f"127.0.0.1:{gate.port}"

    def ask(self, method, path, body=None, **headers):
        """Status, headers and content of an answer; a header that is None is not sent."""
        given = {"host": self.host, "cookie": f"{self.gate.cookie}={self.gate.token}"}
        if method == "POST":
            given |= {"origin": f"http://{self.host}", "content-type": "application/json"}
            body = body if isinstance(body, bytes) else json.dumps(body).encode()
            given |= {"content-length": str(len(body))}
        given |= {name.replace("_", "-"): value for name, value in headers.items()}
        connection = http.client.HTTPConnection("127.0.0.1", self.gate.port, timeout=60)
        try:
            connection.putrequest(method, path, skip_host=True, skip_accept_encoding=True)
            for name, value in given.items():
                if value is not None:
                    connection.putheader(name, value)
            connection.endheaders(body)
            answer = connection.getresponse()
            return answer.status, dict(answer.getheaders()), answer.read()
        finally:
            connection.close()

    def get(self, path):
        status, _, content = self.ask("GET", path)
        assert status == 200, content
        return json.loads(content)

    def view(self):
        """What the page that is shown now holds as data."""
        status, _, content = self.ask("GET", "/")
        assert status == 200, content
        return json.loads(re.search(r'<script type="application/json">(.*?)</script>', content.decode(), re.DOTALL)[1])

    def asked(self):
        """The numbers of the demonstrations that the page asks about."""
        return json.loads(re.search(r'data-asked="(.*?)"', self.ask("GET", "/")[2].decode())[1])

    def post(self, path, **given):
        """The status and the answer to what is posted."""
        status, _, content = self.ask("POST", path, given)
        return status, json.loads(content)

    def answer(self, version, key, *demonstrations):
        return self.post("/api/answer", version=version, key=key, demonstrations=list(demonstrations))


def review_of(audit, labels="labels.csv", videos=None, finish=None, data=None):
    """What a server shows of an audit, without answers from before."""
    n = len(audit.step_weight)
    return Review(
        session=Session(replace(audit, fps=10.0), labels, None, None),
        about=About("Review of d.parquet", "d.parquet"),
        videos=videos or EpisodeVideos.of("d.parquet", audit.ids, 10.0),
        data=data or Demonstrations(np.zeros((n, 1)), np.zeros(n), audit.offsets, ids=audit.ids),
        finish=finish or (lambda given: {"kept": len(audit.ids), "rejected": {}, "reason": ""}),
    )


@contextmanager
def serving(review):
    """A client of a server that runs in a thread until the block ends."""
    import uvicorn

    with socket.create_server(("127.0.0.1", 0)) as at:
        gate = Gate(at.getsockname()[1])
        config = uvicorn.Config(
            application(review, gate), log_level="warning", ws="none", lifespan="off", timeout_graceful_shutdown=1
        )
        server = uvicorn.Server(config)
        thread = threading.Thread(target=server.run, kwargs={"sockets": [at]})
        thread.start()
        while not server.started:
            time.sleep(0.01)
        try:
            yield Client(gate)
        finally:
            server.should_exit = True
            thread.join()


@contextmanager
def reviewing(*arguments):
    """A process of ``rpil review``, and a client of it."""
    code = "from rpil.cli.entry import main; main()"
    command = [sys.executable, "-c", code, "review", "--no-browser", "-q", *arguments]
    process = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
    try:
        said = ""
        while (found := re.search(r"http://127\.0\.0\.1:(\d+)/\?token=(\S+)", said)) is None:
            line = process.stdout.readline()
            assert line, process.stderr.read()
            said += line
        yield process, Client(Gate(int(found[1]), found[2]))
    finally:
        process.kill()
        process.wait(30)
        process.stdout.close()
        process.stderr.close()
