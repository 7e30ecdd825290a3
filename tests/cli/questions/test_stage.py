"""What a review shows to answer by, in a browser: films in step, curves of what was recorded, sliders, and links."""

from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pytest

import lerobot_folders
from browser import browsing, needs_chromium
from rpil import RPIL, read
from rpil.cli.questions.curves import Recorded
from rpil.cli.questions.server import page_of
from rpil.cli.questions.videos import EpisodeVideos
from served import need_server, review_of, serving
from small import FAST

need_server()
pytestmark = [needs_chromium, pytest.mark.slow]

VERSION = "Number(document.querySelector('.ask').dataset.version)"
CLOCK = "document.querySelector('.ask .clock').value"
FILMS = "[...document.querySelectorAll('.ask .screen video')]"
TIMES = f"{FILMS}.map((film) => film.currentTime - Number(film.src.split('#t=')[1]))"
TOPS = "[{}].map((one) => document.querySelector(one).getBoundingClientRect().top)"
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
def browser(tmp_path):
    with browsing(tmp_path / "profile") as browser:
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


def review_with_films(audit, folder):
    return review_of(audit, videos=EpisodeVideos.of(str(folder), audit.ids, lerobot_folders.FPS), page=page_of)


def test_films_play_in_step_by_keys_with_a_bar_of_their_own(browser, episodes, filmed):
    with serving(review_with_films(filmed, episodes)) as client:
        ask_about((browser, client))
        n_asked = len(client.get("/api/view")["asked"]["demonstrations"])
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


def test_pictures_are_shown_where_the_browser_cannot_play_a_video(browser, tmp_path):
    pytest.importorskip("av")
    folder = lerobot_folders.write(tmp_path / "set", [30] * 12, codec="mpeg4", options={})
    audit = RPIL(settings=FAST).fit(read(folder)).audit_
    pictures = "[...document.querySelectorAll('.ask .screen img')]"
    with serving(review_with_films(audit, folder)) as client:
        ask_about((browser, client))
        n_asked = len(client.get("/api/view")["asked"]["demonstrations"])
        browser.wait(f"{pictures}.length === {n_asked + 1} && {pictures}.every((one) => one.naturalWidth === 320)")
        browser.press(".")
        browser.wait(f"{pictures}.every((one) => one.src.endsWith('/1') && one.complete)")
        assert browser.evaluate("document.querySelector('.ask .screen video')") is None


def test_without_films_what_was_recorded_is_drawn_where_the_pair_differs_most(audit, data, browser):
    recorded = read(data, observations=["x", "v"])
    with serving(review_of(audit, page=page_of, data=recorded)) as client:
        ask_about((browser, client))
        browser.wait("document.querySelectorAll('.ask .overlays canvas').length === 2")
        names = browser.evaluate("[...document.querySelector('.overlays select').options].map((one) => one.text)")
        assert sorted(names) == ["action (action)", "v", "x"]
        columns = Recorded(recorded).columns
        assert [one["name"] for one in columns] == ["action", "x", "v"]
        phases = [np.concatenate(_values(recorded, audit.index(name)), axis=1) for name in audit.pair]
        distance = abs(phases[0] - phases[1]).mean(axis=0) / [one["spread"] for one in columns]
        most = [columns[c]["name"] for c in np.argsort(-distance, kind="stable")]
        assert [name.partition(" ")[0] for name in names] == most
        top = "document.querySelector('.answers').getBoundingClientRect().top"
        before = browser.evaluate(top)
        browser.evaluate(
            f"tops = []; new MutationObserver(() => tops.push({top}))"
            ".observe(document.body, { childList: true, subtree: true })"
        )
        browser.press("1")
        browser.wait(f"{VERSION} === 1 && document.querySelectorAll('.ask .overlays canvas').length === 2")
        tops = browser.evaluate("tops")
        assert len(tops) > 1
        a_line = 30  # more or less of the sentence above them
        assert min(tops) > before - a_line, "buttons stay where they are while the next is drawn"
        shown = "document.querySelector('.ask .overlays canvas').toDataURL()"
        light = browser.evaluate(shown)
        browser.resize(1280, 900, dark=True)
        browser.wait(f"{shown} !== {json.dumps(light)}")
        browser.resize(1280, 900)
        browser.evaluate("document.querySelector('.overlays select').selectedIndex = 2")
        browser.evaluate("document.querySelector('.overlays select').dispatchEvent(new Event('change'))")
        browser.wait("document.querySelectorAll('.ask .overlays canvas').length === 2")
        browser.press(" ")
        browser.wait(f"!{CLOCK}.startsWith('0.0')")
        browser.press(" ")
        cursor = "new DOMMatrix(getComputedStyle(document.querySelector('.ask .u-cursor-x')).transform).e"
        step, left = (
            browser.evaluate("Number(document.querySelector('.ask .track input').value)"),
            browser.evaluate(cursor),
        )
        width = browser.evaluate("document.querySelector('.ask .u-over').clientWidth")
        assert left == pytest.approx((step + 0.5) / 40 * width, abs=2)


def _values(recorded, m):
    observations, actions = recorded[m]
    return actions.reshape(len(actions), -1), observations


def test_the_opinion_of_the_audit_comes_after_the_answer(audit, browser):
    row = "document.querySelector('tr[data-row=\"{}\"]').innerText"
    with serving(review_of(audit, page=page_of)) as client:
        ask_about((browser, client))
        pair = [audit.index(name) for name in audit.pair]
        said = ("similar", "outlier", "score", "P(")
        assert not [word for m in pair for word in said if word in browser.evaluate(row.format(m))]
        for text in (browser.text(".ask"), browser.text(".detail"), browser.text("article > header")):
            assert not [word for word in said if word in text]
        assert browser.evaluate("document.querySelectorAll('.ask .sliders .rank').length % 2") == 0
        browser.press("1")
        browser.wait(f"{VERSION} === 1")
        asked = client.get("/api/view")["asked"]["demonstrations"]
        (shown,) = [m for m in pair if m not in asked][:1]
        assert f"{shown} {audit.verdicts[shown]}, place {audit.ranks[shown]}" in browser.text(".ask [role=status]")
        assert any(word in browser.evaluate(row.format(shown)) for word in ("similar", "outlier", "open"))


def test_a_link_names_a_demonstration_and_a_time(audit, browser):
    with serving(review_of(audit, page=page_of)) as client:
        ask_about((browser, client))
        browser.open(f"http://{client.host}/favicon.ico")
        browser.open(f"http://{client.host}/#episode=7&t=1.2")
        browser.wait("document.querySelector('.detail h3')?.innerText === '7'")
        browser.wait("document.querySelector('.detail .clock').value === '1.2 / 4.0 s'")
        browser.evaluate("location.hash = '#episode=7&t=0.6'")
        browser.wait("document.querySelector('.detail .clock').value === '0.6 / 4.0 s'")
        browser.evaluate("location.hash = '#episode=11&t=0.5'")
        browser.wait("document.querySelector('.detail h3').innerText === '11'")
        browser.wait("document.querySelector('.detail .clock').value === '0.5 / 4.0 s'")
        browser.press("j")
        name = browser.text(".detail h3")
        browser.wait(f"location.hash === '#episode={name}'")
        browser.evaluate("location.hash = '#episode=nobody'")
        assert browser.text(".detail h3") == name


def test_the_box_stays_where_it_is_and_the_changed_are_shown_at_a_click(audit, browser):
    place = TOPS.format("'.answers', '.told', '.work'")
    with serving(review_of(audit, page=page_of)) as client:
        version = 1
        client.answer(0, "1", *(audit.index(name) for name in audit.pair))
        ask_about((browser, client), 1)
        drawn = "document.querySelector('.ask .overlays canvas') !== null"
        browser.wait(drawn)
        before = browser.evaluate(place)
        while not client.get("/api/view")["changed"]:
            browser.press("g" if client.get("/api/view")["asked"]["demonstrations"][0] not in (3, 5, 8, 9) else "b")
            version += 1
            browser.wait(f"{VERSION} === {version} && {drawn}")
            assert browser.evaluate(place) == before
        n = len(client.get("/api/view")["changed"])
        assert browser.text("[data-role=changed]") == f"Show the {n} that changed"
        browser.click("[data-role=changed]")
        assert browser.text("[data-role=shown]") == f"{n} of 24 demonstrations"


def test_keys_are_listed_and_play_no_part_while_they_are(audit, browser):
    with serving(review_of(audit, page=page_of)) as client:
        ask_about((browser, client))
        browser.press("?")
        listed = browser.text("dialog.keys")
        assert all(words in listed for words in ("play, pause", "no difference", "undo the last answer", "space"))
        browser.press("g")
        browser.press("Escape")
        browser.wait("document.querySelector('dialog') === null")
        browser.click("[data-role=keys]")
        browser.wait("document.querySelector('dialog[open]') !== null")
        assert client.get("/api/version") == {"version": 0}


def test_on_a_narrow_screen_the_films_stand_between_question_and_buttons(browser, episodes, filmed):
    browser.resize(390, 844)
    with serving(review_with_films(filmed, episodes)) as client:
        ask_about((browser, client))
        browser.wait("document.querySelector('.ask .screen video') !== null")
        question, films, buttons = browser.evaluate(TOPS.format("'.ask h2', '.ask .screen', '.ask .answers'"))
        assert 0 < question < films < buttons < 844
        assert browser.evaluate("document.documentElement.scrollWidth") == 390


def test_an_answer_about_one_of_many_takes_two_requests(browser):
    """What is drawn and played comes after the page."""
    rng, owner = np.random.default_rng(0), np.repeat(np.arange(300), 10)
    audit = RPIL(settings=FAST).fit(rng.normal(size=(3000, 2)), rng.normal(size=(3000, 1)), groups=owner).audit_
    with serving(review_of(replace(audit, fps=10.0), page=page_of)) as client:
        ask_about((browser, client))
        browser.wait("document.querySelector('.ask .overlays canvas') !== null")
        browser.requests.clear()
        browser.press("g")
        browser.wait(f"{VERSION} === 1")
        paths = [url.partition(client.host)[2] for url in browser.requests]
        paths = [path for path in paths if path not in ("/api/version", "/favicon.ico")]
        after = paths[paths.index("/api/answer") :]
        assert after[:2] == ["/api/answer", "/"]
