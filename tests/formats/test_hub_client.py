"""The client of the Hugging Face Hub itself, which asks a server of this computer that answers as the Hub does."""

from __future__ import annotations

import hashlib
import json
import os
import subprocess
import sys
import threading
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from urllib.parse import unquote

import pytest

from samples import lerobot

pytest.importorskip("huggingface_hub", reason="needs the client of the Hub: pip install 'rpil[hub]'")

COMMIT = "1" * 40


@pytest.fixture
def hub(tmp_path):
    """The address of a server that has one data set, robots/reach, and refuses robots/private; what it was asked."""
    folder = lerobot(tmp_path / "server")
    (folder / "videos").mkdir(exist_ok=True)
    (folder / "videos" / "front.mp4").write_bytes(b"a video")
    files = {str(path.relative_to(folder)): path.read_bytes() for path in folder.rglob("*") if path.is_file()}
    asked = []

    class Hub(BaseHTTPRequestHandler):
        def do_HEAD(self):
            self.answer(*self.found())

        def do_GET(self):
            self.answer(*self.found(), body=True)

        def found(self):
            path = unquote(self.path.partition("?")[0]).strip("/")
            asked.append(path)
            if path.startswith("api/datasets/robots/private"):
                return 401, {"X-Error-Code": "GatedRepo", "X-Error-Message": "Access is restricted."}, b"{}"
            if path.startswith("api/datasets/robots/reach/tree"):
                rows = [
                    {"type": "file", "path": name, "size": len(data), "oid": sha(data)} for name, data in files.items()
                ]
                return 200, {}, json.dumps(rows).encode()
            if path.startswith("api/datasets/robots/reach"):
                about = {
                    "id": "robots/reach",
                    "sha": COMMIT,
                    "siblings": [{"rfilename": name, "size": len(data)} for name, data in files.items()],
                }
                return 200, {}, json.dumps(about).encode()
            name = path.removeprefix(f"datasets/robots/reach/resolve/{COMMIT}/")
            if name in files:
                return 200, {"ETag": f'"{sha(files[name])}"', "X-Repo-Commit": COMMIT}, files[name]
            return 404, {"X-Error-Code": "RepoNotFound"}, b"{}"

        def answer(self, status, headers, content, body=False):
            self.send_response(status)
            for name, value in {**headers, "Content-Length": str(len(content))}.items():
                self.send_header(name, value)
            self.end_headers()
            if body:
                self.wfile.write(content)

        def log_message(self, *_):
            pass

    server = ThreadingHTTPServer(("127.0.0.1", 0), Hub)
    threading.Thread(target=server.serve_forever, daemon=True).start()
    yield f"http://127.0.0.1:{server.server_port}", asked
    server.shutdown()
    server.server_close()


def sha(data):
    return hashlib.sha1(data).hexdigest()


def rpil(tmp_path, address, *words):
    """What ``rpil`` prints and its exit code, in a process of its own: the client reads its settings once."""
    own = {"HF_ENDPOINT": address, "HF_HOME": str(tmp_path / "cache"), "NO_PROXY": "*", "HF_HUB_DISABLE_XET": "1"}
    command = [sys.executable, "-m", "rpil", *words]
    done = subprocess.run(command, env=os.environ | own, cwd=tmp_path, capture_output=True, text=True)
    return done.returncode, done.stdout, done.stderr


def test_a_data_set_of_the_hub_is_audited_without_its_videos(hub, tmp_path):
    address, asked = hub
    status, printed, told = rpil(tmp_path, address, "audit", "hf://datasets/robots/reach")
    assert status == 0, told
    assert printed.startswith("hf://datasets/robots/reach: LeRobot v3.0; 3 demonstrations, 15 steps")
    assert "hf://datasets/robots/reach: downloads 0.0 MB." in told.splitlines()
    assert any(path.endswith("meta/info.json") for path in asked)
    assert not any(path.endswith(".mp4") for path in asked)


@pytest.mark.parametrize(
    ("name", "said"),
    [("robots/nothing", "the Hub has no such data set"), ("robots/private", "only with a token")],
)
def test_a_name_that_is_not_there_or_needs_a_token_is_one_sentence(name, said, hub, tmp_path):
    status, printed, told = rpil(tmp_path, hub[0], "audit", f"hf://datasets/{name}", "--quiet")
    assert (status, printed) == (2, "")
    assert said in told
    assert told.count("\n") == 1


def test_without_a_network_the_message_is_one_sentence(tmp_path):
    status, printed, told = rpil(tmp_path, "http://127.0.0.1:9", "audit", "hf://datasets/robots/reach", "--quiet")
    assert (status, printed) == (2, "")
    assert "the Hub could not be reached; check the network" in told
    assert told.count("\n") == 1
