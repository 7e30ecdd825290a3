"""``rpil review`` as a process: what it prints, that an end by force loses nothing, and how it is interrupted."""

from __future__ import annotations

import http.client
import json
import re
import signal
import subprocess
import sys
from contextlib import contextmanager
from pathlib import Path
from queue import SimpleQueue

import pyarrow.parquet as pq
import pytest

from asked import BAD, N_STEPS, write
from command_line import ok, refused
from rpil.cli.questions.security import Gate
from rpil.data.id_values import read_answers
from served import Client, need_server

need_server()


@pytest.fixture(scope="module")
def data(tmp_path_factory):
    return write(tmp_path_factory.mktemp("review") / "d.parquet")


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


@pytest.mark.slow
def test_what_was_answered_outlives_the_server(data):
    """Ten answers, an end by force, and a second run that goes on with them and ends by Ctrl-C."""
    given = {m: "b" if m in BAD else "g" for m in range(10)}
    with reviewing(data, "--observations", "x,v") as (process, client):
        for version, (m, key) in enumerate(given.items()):
            status, state = client.answer(version, key, m)
            assert (status, len(read_answers("labels.csv")[0])) == (200, version + 1)
        assert client.get("/api/view")["view"]["demonstrations"]["verdict"].count("bad") == len(BAD)
        process.send_signal(signal.SIGKILL)
    labels = {str(m): "bad" if key == "b" else "good" for m, key in given.items()}
    assert read_answers("labels.csv") == (labels, [])
    with reviewing(data, "--observations", "x,v") as (process, client):
        state = client.get("/api/view")
        assert len(state["view"]["answers"]) == 10
        assert (state["version"], state["n_answers"]) == (0, 0)
        assert client.answer(0, "g", 11)[0] == 200
        assert client.answer(1, "g", 3)[0] == 200, "another label for one of the first run"
        status, finished = client.post("/api/finish", version=2)
        assert status == 200
        command = f"rpil audit {data} --observations x,v --labels labels.csv"
        assert finished["lines"][0].endswith(command)
        assert finished["lines"][1] == "Keep: keep.json"
        good = client.get("/api/view")["view"]["demonstrations"]["verdict"]
        kept = json.loads(Path("keep.json").read_text())["episodes"]
        assert kept == [m for m, word in enumerate(good) if word != "bad"]
        assert len(Path("verdicts.csv").read_text().splitlines()) == 25
        assert pq.read_table("weights.parquet").num_rows == 24 * N_STEPS
        process.send_signal(signal.SIGINT)
        out, err = process.communicate(timeout=60)
    assert (process.returncode, err) == (0, "")
    assert out.splitlines()[-2:] == ["2 answers of this run in labels.csv.", f"Then run: {command}"]
    assert read_answers("labels.csv") == (labels | {"11": "good", "3": "good"}, [])


@pytest.mark.slow
def test_the_port_can_be_chosen_and_the_page_needs_its_token(data):
    with reviewing(data, "--observations", "x,v") as (_, client):
        refused("cannot be used", "review", data, "--port", client.gate.port, "--no-browser", "-q")
        connection = http.client.HTTPConnection("127.0.0.1", client.gate.port, timeout=60)
        connection.request("GET", "/")
        answer = connection.getresponse()
        assert (answer.status, list(json.loads(answer.read()))) == (403, ["error"])
        connection.close()
        page = client.ask("GET", "/")[2].decode()
        assert "Audit of d.parquet" in page


@pytest.mark.slow
def test_nothing_that_is_finished_joins_the_data(tmp_path):
    folder = tmp_path / "folder"
    folder.mkdir()
    write(folder / "d.parquet")
    with reviewing(str(folder), "--observations", "x,v", "--labels", str(folder / "labels.json")) as (_, client):
        status, answer = client.post("/api/finish", version=0)
        assert status == 400
        assert "would join the data" in answer["error"]
    assert [path.name for path in folder.iterdir()] == ["d.parquet"]


@pytest.mark.slow
def test_what_is_finished_never_replaces_the_answers(data):
    with reviewing(data, "--labels", "verdicts.csv") as (_, client):
        assert client.answer(0, "b", 3)[0] == 200
        answers = Path("verdicts.csv").read_bytes()
        status, answer = client.post("/api/finish", version=1)
        assert status == 400
        assert "verdicts.csv: it is named twice" in answer["error"]
    assert Path("verdicts.csv").read_bytes() == answers
    assert not Path("keep.json").exists()


def test_without_the_extra_it_is_named_before_any_work(monkeypatch):
    monkeypatch.setitem(sys.modules, "starlette", None)
    refused(r"rpil\[review\]", "review", "nothing-is-read.parquet")


def test_the_browser_is_given_the_address(data, monkeypatch):
    opened, served = SimpleQueue(), []
    monkeypatch.setattr("webbrowser.open", opened.put)
    monkeypatch.setattr("rpil.cli.questions.server.serve", lambda application, at: served.append(at.getsockname()[1]))
    out = ok("review", data, "--observations", "x,v", "-q").stdout
    assert [opened.get(timeout=10)] == re.findall(r"http://\S+", out)
    assert Gate(served[0], "x").url[:-1] in out
    assert out.endswith("No answer was given, and nothing was written.\n")
    ok("review", data, "--observations", "x,v", "-q", "--no-browser")
    assert opened.empty()
