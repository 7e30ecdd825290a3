"""``rpil review`` as a process: what it prints, that an end by force loses nothing, and how it is interrupted."""

import json
import re
import signal
import sys
from pathlib import Path
from queue import SimpleQueue
from urllib.parse import unquote, urlsplit

import pyarrow.parquet as pq
import pytest

from asked import BAD, N_STEPS, read_answers, with_jumps, write
from command_line import ok, refused
from rpil.cli.questions.server import Gate
from served import need_server, reviewing

need_server()


@pytest.mark.slow
def test_what_was_answered_outlives_the_server(data):
    """Ten answers, an end by force, and a second run that goes on with them and ends by Ctrl-C."""
    given = {m: "b" if m in BAD else "g" for m in range(10)}
    with reviewing(data, "--observations", "x,v") as (process, client):
        for version, (m, key) in enumerate(given.items()):
            status, _ = client.answer(version, key, m)
            assert (status, len(read_answers("labels.csv")[0])) == (200, version + 1)
        assert client.view()["demonstrations"]["verdict"].count("bad") == len(BAD)
        process.send_signal(signal.SIGKILL)
    labels = {str(m): "bad" if key == "b" else "good" for m, key in given.items()}
    assert read_answers("labels.csv") == (labels, {})
    with reviewing(data, "--observations", "x,v") as (process, client):
        assert len(client.view()["answers"]) == 10
        assert client.get("/api/version") == {"version": 0}
        assert client.answer(0, "g", 11)[0] == 200
        assert client.answer(1, "g", 3)[0] == 200, "another label for one of the first run"
        status, seen = client.post("/api/finish", version=2)
        assert (status, Path("labels-keep.json").exists()) == (200, False), "nothing is written before it is seen"
        spared = client.post("/api/finish", version=2, spared=["5"], rules=["no rule"])[1]
        assert (spared["kept"], spared["rejected"]["labels"]) == (seen["kept"] + 1, [8, 9])
        finished = client.post("/api/finish", version=2, write=True)[1]
        command = f"rpil audit {data} --observations x,v --labels labels.csv"
        assert (finished["files"]["keep"], finished["command"][-17:]) == ("labels-keep.json", "-o d-kept.parquet")
        good = client.view()["demonstrations"]["verdict"]
        kept = json.loads(Path("labels-keep.json").read_text())["episodes"]
        assert kept == [m for m, word in enumerate(good) if word != "bad"]
        assert (seen["kept"], seen["rejected"]["labels"]) == (len(kept), sorted(BAD - {3}))
        assert {*range(24)} - {*kept} == {m for rejected in seen["rejected"].values() for m in rejected}
        assert len(Path("labels-verdicts.csv").read_text().splitlines()) == 25
        assert pq.read_table("labels-weights.parquet").num_rows == 24 * N_STEPS
        process.send_signal(signal.SIGINT)
        out, err = process.communicate(timeout=60)
    assert (process.returncode, err) == (0, "")
    assert out.splitlines()[-2:] == ["2 answers of this run in labels.csv.", f"Then run: {command}"]
    assert read_answers("labels.csv") == (labels | {"11": "good", "3": "good"}, {})


@pytest.mark.slow
def test_a_review_writes_where_no_link_leads(data):
    Path("mine-keep.json").symlink_to("keep.json")
    write("other.parquet")
    Path("keep.json").write_text("MINE")
    with reviewing(data, "--labels", "mine.csv") as (_, client):
        status, answer = client.post("/api/finish", version=0, write=True)
        assert (status, answer["error"].partition(",")[0]) == (400, "mine-keep.json: it is a link")
        assert {path.name for path in Path().iterdir()} == {"mine-keep.json", "keep.json", "other.parquet"}
        Path("mine-keep.json").unlink()
        for _ in range(2):  # it replaces its files
            files = client.post("/api/finish", version=0, write=True)[1]["files"]
            assert [*files.values()] == ["mine-keep.json", "mine-verdicts.csv", "mine-weights.parquet"]
        for name in files.values():
            content = Path(name).read_bytes()
            Path(name).write_text("MINE")
            status, answer = client.post("/api/finish", version=0, write=True)
            said = f"{name}: it is there, and no review of these data wrote it"
            assert (status, answer["error"].partition(";")[0]) == (400, said)
            assert Path(name).read_text() == "MINE"
            Path(name).write_bytes(content)
        kept = Path("mine-keep.json").read_text()
        Path("mine-keep.json").write_text(json.dumps(json.loads(kept) | {"run": "e"}))
        assert client.post("/api/finish", version=0, write=True)[0] == 400, "a run id that every file has in it"
        Path("mine-keep.json").write_text(kept)
    before = Path("mine-keep.json").read_bytes()
    with reviewing(data, "--labels", "mine.csv") as (_, client):  # on another day it goes on
        client.answer(0, "b", 3)
        assert client.post("/api/finish", version=1, write=True)[0] == 200
        assert Path("mine-keep.json").read_bytes() != before
    with reviewing("other.parquet", "--labels", "mine.csv") as (_, client):
        assert client.post("/api/finish", version=0, write=True)[0] == 400, "they are of other data"
    assert Path("keep.json").read_text() == "MINE"


def test_faults_of_the_rules_that_a_page_names_reject(monkeypatch):
    shown = []
    monkeypatch.setattr("rpil.cli.questions.server.application", lambda review, gate: shown.append(review))
    monkeypatch.setattr("rpil.cli.questions.server.serve", lambda application, at: None)
    ok("review", with_jumps("jumps.parquet", {2, 7}), "-q", "--no-browser")
    for rules, expected in ((["jump", "lag"], {"faults": [2, 7]}), (["lag"], {}), ("jump", {})):
        found = shown[0].finish({"rules": rules})
        rejected = {rule: rows for rule, rows in found["rejected"].items() if rows}
        assert (rejected, found["kept"]) == (expected, 12 - 2 * len(expected))


def test_without_the_extra_it_is_named_before_any_work(monkeypatch):
    monkeypatch.setitem(sys.modules, "starlette", None)
    refused(r"rpil\[review\]", "review", "nothing-is-read.parquet")


def test_the_browser_is_given_a_private_page_that_leads_to_the_address(data, monkeypatch):
    opened, served, pages = SimpleQueue(), [], []

    def serve(application, at):
        served.append(at.getsockname()[1])
        address = opened.get(timeout=10)
        page = Path(unquote(urlsplit(address).path))
        pages.append((address, page, page.read_text(), page.stat().st_mode, page.parent.stat().st_mode))

    monkeypatch.setattr("webbrowser.open", opened.put)
    monkeypatch.setattr("rpil.cli.questions.server.serve", serve)
    out = ok("review", data, "--observations", "x,v", "-q").stdout
    [(address, page, content, mode, mode_of_folder)] = pages
    [url] = re.findall(r"http://\S+", out)
    assert address.startswith("file:///")
    assert url.rpartition("=")[2] not in address, "all users of a computer see with what a program was started"
    assert content == f'<meta http-equiv="refresh" content="0; url={url}">'
    assert (mode & 0o777, mode_of_folder & 0o777) == (0o600, 0o700)
    assert not page.parent.exists()
    assert Gate(served[0], "x").url[:-1] in out
    assert out.endswith("No answer was given, and nothing was written.\n")
    monkeypatch.setattr("rpil.cli.questions.server.serve", lambda application, at: None)
    ok("review", data, "--observations", "x,v", "-q", "--no-browser")
    assert opened.empty()
