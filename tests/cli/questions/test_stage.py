"""What a review shows to answer by, in a browser: films, curves, all at a glance, and the end of the review."""

import json
from pathlib import Path

import pytest

import lerobot_folders
from asked import read_answers
from browser import needs_chromium
from rpil import RPIL, read
from rpil.cli.questions.session import EpisodeVideos
from rpil.data.id_values import AnswerRow, read_answer_rows
from served import need_server, review_of, serving
from small import FAST

need_server()

VERSION = "Number(document.querySelector('.ask').dataset.version)"
CLOCK = "document.querySelector('.ask .clock').value"
FILMS = "[...document.querySelectorAll('.ask .screen video')]"
TIMES = f"{FILMS}.map((film) => film.currentTime - Number(film.src.split('#t=')[1]))"
TILES = "[...document.querySelectorAll('dialog.sweep .tile')]"
CHOSEN = f"{TILES}.filter((one) => one.getAttribute('aria-pressed') === 'true').map((one) => Number(one.dataset.m))"
PLAY = "document.querySelector('.ask .controls button').textContent"
WHILE_SEEKING = """(() => {
  const film = HTMLMediaElement.prototype, { play } = film, time = Object.getOwnPropertyDescriptor(film, "currentTime");
  window.tooEarly = 0;
  film.play = function () {
    tooEarly += this.seeking;
    return play.call(this);
  };
  Object.defineProperty(film, "currentTime", { get: time.get, set(to) {
    tooEarly += this.seeking;
    time.set.call(this, to);
  } });
})()"""
"""Counts what a film is told while it seeks: Chromium then may seek for ever."""


@pytest.fixture
def browser(chromium):
    browser = chromium.renew()
    browser.resize(1280, 900)
    still = {"name": "prefers-reduced-motion", "value": "reduce"}  # films begin when they are told to
    browser.send("Emulation.setEmulatedMedia", features=[still])
    yield browser
    assert browser.errors == []


@pytest.fixture(scope="module")
def episodes(tmp_path_factory):
    """A folder with two cameras, of which each episode has thirty frames, ten a second by the review."""
    pytest.importorskip("av")
    return lerobot_folders.write(tmp_path_factory.mktemp("films") / "set", [30] * 12, cameras=("front", "side"))


@pytest.fixture(scope="module")
def filmed(episodes):
    return RPIL(settings=FAST).fit(read(episodes)).audit_


def ask_about(page, version=0):
    """Open the page, and wait for the question of a version."""
    browser, client = page
    browser.open(client.gate.url)
    browser.wait(f"{VERSION} === {version} && document.querySelector('.ask .clock') !== null")


@needs_chromium
@pytest.mark.slow
def test_films_play_in_step_by_keys_with_a_bar_of_their_own(browser, episodes, filmed):
    videos = EpisodeVideos.of(str(episodes), filmed.ids, lerobot_folders.FPS)
    with serving(review_of(filmed, videos=videos)) as client:
        ask_about((browser, client))
        n_asked = len(client.asked())
        browser.wait(f"{FILMS}.length === {n_asked + 1} && {FILMS}.every((film) => film.readyState >= 2)")
        assert browser.evaluate(f"{FILMS}.every((film) => film.muted && film.paused && !film.controls)")
        assert browser.evaluate(CLOCK) == "0.0 / 3.0 s", "the time of the episode, and not that of its file"
        browser.evaluate(WHILE_SEEKING)
        browser.press(".", ".", ".", ",")
        assert browser.evaluate(CLOCK) == "0.2 / 3.0 s"
        browser.wait(f"{TIMES}.every((time) => time >= 0.2 && time < 0.3)")
        browser.press(">", "l", " ")
        browser.wait(f"{FILMS}.every((film) => film.playbackRate === 2)")
        browser.wait(f"{CLOCK} === '2.9 / 3.0 s' && {PLAY} === '▶'")  # it ends, because it is no loop any more
        assert browser.evaluate("scrollY") == 0
        browser.wait(f"{TIMES}.every((time) => time > 1.4)")  # at the last frame: some files end at 1.5 s
        browser.press(" ")  # from the start again
        browser.wait(f"{CLOCK} !== '2.9 / 3.0 s'")
        browser.press(" ")
        browser.evaluate("document.querySelector('.ask .track input').value = 12")
        browser.evaluate("document.querySelector('.ask .track input').dispatchEvent(new Event('input'))")
        browser.wait(f"{TIMES}.every((time) => time >= 1.2 && time < 1.3)")
        browser.wait("location.hash.endsWith('&t=1.2')")
        front = browser.evaluate(f"{FILMS}[0].src")
        browser.click(".cameras button:nth-child(2)")
        browser.wait(f"{FILMS}[0].src !== {json.dumps(front)} && {FILMS}.every((film) => film.readyState >= 2)")
        browser.wait(f"{TIMES}.every((time) => time >= 1.2 && time < 1.3)")
        assert browser.evaluate("tooEarly") == 0
        browser.evaluate(f"window.old = {FILMS}")
        browser.press("u")
        browser.wait(f"{VERSION} === 1 && old.every((film) => !film.hasAttribute('src'))")  # no connection is kept


@pytest.fixture
def review(audit, data):
    return review_of(audit, data=read(data, observations=["x", "v"]))


def test_many_are_answered_at_once_and_taken_back_in_one_step(review):
    with serving(review) as client:
        assert [one["name"] for one in client.view()["columns"]] == ["action", "x", "v"]
        assert client.ask("GET", "/api/column/9")[0] == 404
        status, state = client.answer(0, "b", 2, 5, 8, 11)
        assert status == 200
        assert state["lines"][0].startswith("Now: "), "the audit's opinion of many is no line"
        assert client.answer(1, "g", 1, 2)[0] == 200, "two are no pair here"
        assert read_answers("labels.csv")[0] == {"5": "bad", "8": "bad", "11": "bad", "1": "good", "2": "good"}
        assert len(client.asked()) == 2, "the pair is still asked about"
        assert client.post("/api/undo", version=2)[1]["n_answers"] == 4
        assert read_answers("labels.csv")[0] == dict.fromkeys(("2", "5", "8", "11"), "bad")
        assert client.answer(3, "u", 2, 5, 8)[0] == 400


@needs_chromium
@pytest.mark.slow
def test_a_sweep_chooses_by_clicks_and_keys_and_answers_for_all(review, browser):
    with serving(review) as client:
        browser.open(client.gate.url)
        browser.wait(f"{VERSION} === 0 && document.querySelectorAll('.ask .overlays canvas').length === 2")
        shown = "".join(map(browser.text, (".ask", ".detail", "article > header")))
        assert not [word for word in ("outlier", "score", "P(") if word in shown], "an opinion comes after the answer"
        browser.press("v")
        browser.wait(f"{TILES}.length === 24 && {TILES}.every(one => one.querySelector('polyline').points.length > 9)")
        row = browser.evaluate(f"{TILES}.map((one) => Number(one.dataset.m))")
        browser.click(".tile")
        browser.press("ArrowRight")
        browser.press("x")
        assert browser.evaluate(CHOSEN) == row[:2]
        shift = "new MouseEvent('click', {bubbles: true, shiftKey: true})"
        browser.evaluate(f"{TILES}[4].dispatchEvent({shift})")
        browser.click(".tile")
        assert browser.evaluate(CHOSEN) == row[1:5]
        browser.type("dialog.sweep input", "drop")
        browser.evaluate("document.querySelector('dialog.sweep input').dispatchEvent(new Event('input'))")
        browser.click("[data-all=b]")
        browser.wait(f"{VERSION} === 1")
        browser.wait(
            "document.querySelector('[data-role=told]').textContent === '4 marked bad; z takes them all back.'"
        )
        assert {*read_answer_rows("labels.csv")} == {AnswerRow(str(m), "bad", "drop") for m in row[1:5]}
        assert browser.evaluate("document.querySelectorAll('dialog.sweep .mark.bad').length") == 4
        assert browser.evaluate(CHOSEN) == []
        browser.press("z")
        browser.wait(f"{VERSION} === 2 && !document.querySelector('dialog.sweep .mark.bad')")
        assert not Path("labels.csv").exists()
        browser.evaluate(f"{TILES}[0].focus()")
        browser.press("x", "g")
        browser.wait(f"{VERSION} === 3")
        assert read_answers("labels.csv")[0] == {str(row[0]): "good"}
        browser.wait("document.querySelector('[data-role=told]').textContent.includes('z takes it back')")
        browser.press("Escape")
        browser.wait("!document.querySelector('dialog.sweep').open")
        browser.press("z")
        browser.wait(f"{VERSION} === 4")


@needs_chromium
@pytest.mark.slow
def test_the_end_shows_who_rejects_what_and_each_can_be_kept(audit, browser):
    asked = []

    def finish(given):
        asked.append(given)
        if given.get("write"):
            return {"files": {"keep": "<b>-keep.json"}, "command": "rpil keep <b>", "lost": []}
        rejected = {"labels": [3, 5], "answers": [8], "faults": [9]}
        left = {rule: [m for m in own if str(m) not in given["spared"]] for rule, own in rejected.items()}
        kept = 24 - sum(map(len, left.values()))
        return {"kept": kept, "rejected": {rule: own for rule, own in left.items() if own}, "notes": [], "outcome": ""}

    text = "document.querySelector('dialog.finish').innerText"
    with serving(review_of(audit, finish=finish)) as client:
        browser.open(client.gate.url)
        browser.wait(f"{VERSION} === 0")
        browser.click(".ask [data-role=finish]")
        browser.wait("document.querySelector('dialog.finish')?.open")
        assert browser.text("dialog.finish h2") == "20 of 24 kept."
        assert browser.text("[data-role=counts]") == "Rejected: 2 by you, 1 by inference, 1 with odd recordings."
        browser.click("dialog.finish summary")
        browser.wait("document.querySelector('[data-spare=\"5\"]') !== null")
        browser.click('[data-spare="5"]')
        browser.wait(f"{text}.includes('21 of 24 kept.') && {text}.includes('1 kept all the same')")
        assert browser.text("[data-role=counts]") == "Rejected: 1 by you, 1 by inference, 1 with odd recordings."
        browser.evaluate("location.reload()")
        browser.wait(f"{VERSION} === 0 && !document.querySelector('dialog.finish')")
        browser.click(".ask [data-role=finish]")
        browser.wait(f"{text}.includes('21 of 24 kept.')")  # what is kept all the same outlives a reload
        assert not any(one.get("write") for one in asked)
        browser.click("[data-role=write]")
        browser.wait("document.querySelector('[data-role=keep-command]')?.innerText === 'rpil keep <b>'")
        given = {"version": 0, "spared": ["5"], "rules": [], "write": True}
        assert asked[-1] == given
        browser.press("Escape")
        browser.wait("!document.querySelector('dialog.finish').open")
