"""What the server of a review shows, and what answers change."""

import json
import threading
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import lerobot_folders
from asked import read_answers
from rpil.cli.questions.session import EpisodeVideos
from rpil.results.html.page import make_view
from served import need_server, review_of, serving

need_server()


@pytest.fixture
def review(audit):
    return review_of(audit)


@pytest.fixture
def client(review):
    with serving(review) as client:
        yield client


def test_the_state_is_the_view_and_the_question(client, review, audit):
    state = review.state()
    more = {"question": "", "pair": [], "columns": review.recorded.columns, "said": []}
    assert client.view() == json.loads(json.dumps(make_view(replace(audit, fps=10.0), review.about, 0) | more))
    assert list(state["asked"]["buttons"]) == ["1", "2", "3", "4", "5", "u", "s"]
    pair = [audit.index(name) for name in audit.pair]
    assert state["asked"]["demonstrations"] == pair
    assert state["asked"]["sentence"].startswith("Which is better: ")
    assert (state["version"], state["n_answers"], state["can_undo"]) == (0, 0, False)
    status, headers, content = client.ask("GET", "/")
    assert status == 200
    assert b"Review of d.parquet" in content
    assert b"4 of 24 act differently from the rest." in content, "nobody is named beside the question"
    assert headers["content-type"].startswith("text/html")
    assert client.ask("GET", "/favicon.ico")[0] == 204


def test_an_answer_says_what_moved_and_asks_the_next(client, audit):
    a, b = (audit.index(name) for name in audit.pair)
    status, state = client.answer(0, "1", a, b)
    assert status == 200
    answered = audit.answered({}, [audit.pair])
    assert state["lines"][0] == "Now: 20 open, 4 outliers."
    assert state["changed"] == [m for m in range(24) if audit.verdicts[m] != answered.verdicts[m]]
    assert client.view()["demonstrations"]["verdict"] == list(answered.verdicts)
    assert list(state["asked"]["buttons"].items()) == [("g", "Good"), ("b", "Bad"), ("u", "Cannot tell"), ("s", "Skip")]
    assert state["asked"]["demonstrations"] == [audit.index(name) for name in answered.suggest_labels(1)]
    assert (state["version"], state["n_answers"], state["can_undo"]) == (1, 1, True)
    assert read_answers("labels.csv") == ({}, {tuple(map(str, audit.pair)): "better than"})


def test_of_answers_at_once_one_counts(client):
    found = []
    tabs = [threading.Thread(target=lambda m=m: found.append(client.answer(0, "g", m)[0])) for m in range(8)]
    for tab in tabs:
        tab.start()
    for tab in tabs:
        tab.join()
    assert sorted(found) == [200, *[409] * 7]
    assert len(read_answers("labels.csv")[0]) == 1


def test_what_is_no_answer_is_refused(client):
    wrong = [{}, {"demonstrations": [0]}, {"demonstrations": [0, 1], "key": "6"}]
    wrong += [{"demonstrations": [0], "key": key} for key in ("1", "3", "z", "gb", "", None, 1, ["g"])]
    wrong += [{"demonstrations": [0], "key": "g", "note": note} for note in (1, None, "x" * 501, "\0", "\ud800")]
    wrong += [{"demonstrations": m, "key": "g"} for m in (0, "0", None, [], ["0"], [True], [0.0], [-1], [24], [[0]])]
    wrong += [{"demonstrations": m, "key": "1"} for m in ([0, 0], [0, 1, 2], [0, 24])]
    for given in wrong:
        status, answer = client.post("/api/answer", version=0, **given)
        assert status == 400, given
        assert answer["error"].endswith(".")
        assert client.post("/api/answer", **given)[0] == 409, "without a version"
    assert client.get("/api/version") == {"version": 0}


def test_an_answer_about_rows_is_a_row_and_can_be_taken_back(client, review):
    n = int(review.session.audit.lengths[3])
    status, state = client.post("/api/answer", version=0, demonstrations=[3], key="b", rows=[2, 7], note="it slips")
    assert status == 200
    assert (state["n_answers"], state["can_undo"], state["lines"][0]) == (1, True, "Now: 20 open, 4 outliers.")
    assert (client.view()["rows"], client.view()["said"]) == ([[3, 2, 7, "bad"]], [[3, "bad", "it slips", 2, 7]])
    name = review.session.audit.ids[3]
    assert Path("labels.csv").read_text() == f"id,label,note,start,end\n{name},bad,it slips,2,7\n"
    given = {"version": 1, "demonstrations": [3], "key": "g", "rows": [2, 7], "note": "x" * 500}
    assert client.post("/api/answer", **given)[0] == 200
    assert client.view()["rows"] == [[3, 2, 7, "good"]]
    beyond = [[6, 9], [True, 3], [2, n + 1], [-1, 4], [4, 4], [1.5, 3], ["2", "x"], [None, 3], [[1], 2], [2, 10**30]]
    for rows in beyond:
        status, answer = client.post("/api/answer", version=2, demonstrations=[3], key="b", rows=rows)
        assert status == 400, rows
        assert answer["error"].startswith(("the labels, demonstration", "These are no rows")), rows
    wrong = [{"rows": [1]}, {"rows": "ab"}, {"rows": [1, 2], "key": "u"}, {"rows": [1, 2], "demonstrations": [3, 4]}]
    for more in wrong:
        given = {"version": 2, "demonstrations": [3], "key": "b"} | more
        assert "no rows of a demonstration" in client.post("/api/answer", **given)[1]["error"], more
    assert client.post("/api/undo", version=2)[0] == 200
    assert client.view()["rows"] == [[3, 2, 7, "bad"]]
    assert client.post("/api/undo", version=3)[0] == 200
    assert not Path("labels.csv").exists()


@pytest.fixture(scope="module")
def films(tmp_path_factory):
    """A folder of LeRobot with two cameras."""
    pytest.importorskip("av")
    return lerobot_folders.write(tmp_path_factory.mktemp("films") / "set", [24] * 24, cameras=("front", "side"))


def test_videos_are_served_in_parts(audit, films):
    videos = EpisodeVideos.of(str(films), audit.ids, 20.0)
    with serving(review_of(audit, videos=videos)) as client:
        found = client.get("/api/films/4")["videos"]
        assert [one["camera"] for one in found] == ["observation.images.front", "observation.images.side"]
        np.testing.assert_allclose([found[1]["start"], found[1]["end"]], [1.2, 2.4])
        whole = videos.file(4, 1).read_bytes()
        status, headers, content = client.ask("GET", "/video/4/1")
        assert (status, content, headers["content-type"]) == (200, whole, "video/mp4")
        status, headers, content = client.ask("GET", "/video/4/1", range="bytes=100-299")
        assert (status, content) == (206, whole[100:300])
        assert headers["content-range"] == f"bytes 100-299/{len(whole)}"
        assert client.ask("GET", "/video/4/1", range="bytes=-50")[2] == whole[-50:]
        assert client.ask("GET", "/video/4/1", range=f"bytes={len(whole)}-")[0] == 416
        status, headers, content = client.ask("GET", "/frame/4/0/7")
        assert (status, headers["content-type"], content[:3]) == (200, "image/jpeg", b"\xff\xd8\xff")
        for path in ("/video/4/2", "/frame/4/2/0", "/frame/4/0/24", "/video/24/0"):
            assert client.ask("GET", path)[0] == 404
