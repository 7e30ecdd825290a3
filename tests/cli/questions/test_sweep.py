"""All demonstrations at a glance, notes beside answers, and the end of a review, in a browser."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

import lerobot_folders
from browser import browsing, needs_chromium
from rpil import RPIL, read
from rpil.cli.questions.server import page_of
from rpil.cli.questions.videos import EpisodeVideos
from rpil.data.id_values import AnswerRow, read_answer_rows, read_answers
from served import need_server, review_of, serving
from small import FAST

need_server()

VERSION = "Number(document.querySelector('.ask').dataset.version)"
TILES = "[...document.querySelectorAll('dialog.sweep .tile')]"
CHOSEN = f"{TILES}.filter((one) => one.getAttribute('aria-pressed') === 'true').map((one) => Number(one.dataset.m))"


@pytest.fixture
def browser(tmp_path):
    with browsing(tmp_path / "profile") as browser:
        yield browser
        assert browser.errors == []


@pytest.fixture
def review(audit, data):
    return review_of(audit, page=page_of, data=read(data, observations=["x", "v"]))


def test_many_are_answered_at_once_and_taken_back_in_one_step(review):
    with serving(review) as client:
        assert [one["name"] for one in client.get("/api/view")["view"]["columns"]] == ["action", "x", "v"]
        assert client.ask("GET", "/api/column/9")[0] == 404
        status, state = client.answer(0, "b", 2, 5, 8, 11)
        assert status == 200
        assert state["lines"][0].startswith("Now: "), "the audit's opinion of many is no line"
        assert client.answer(1, "g", 1, 2)[0] == 200, "two are no pair here"
        assert read_answers("labels.csv")[0] == {"5": "bad", "8": "bad", "11": "bad", "1": "good", "2": "good"}
        assert client.get("/api/view")["asked"]["buttons"].keys() >= {"1", "2"}, "the pair is still asked about"
        assert client.post("/api/undo", version=2)[1]["n_answers"] == 4
        assert read_answers("labels.csv")[0] == dict.fromkeys(("2", "5", "8", "11"), "bad")
        assert client.answer(3, "u", 2, 5, 8)[0] == 400


@needs_chromium
@pytest.mark.slow
def test_a_sweep_chooses_by_clicks_and_keys_and_answers_for_all(review, browser):
    with serving(review) as client:
        browser.open(client.gate.url)
        browser.wait(f"{VERSION} === 0")
        browser.press("v")
        browser.wait(
            f"{TILES}.length === 24 && {TILES}.every((one) => one.querySelector('polyline').points.length > 9)"
        )
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
        assert {tuple(one) for one in read_answer_rows("labels.csv")} == {
            AnswerRow(str(m), "bad", "drop") for m in row[1:5]
        }
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
def test_last_frames_come_when_they_are_seen(browser, tmp_path):
    pytest.importorskip("av")
    folder = lerobot_folders.write(tmp_path / "set", [30] * 12, per_file=4)
    audit = RPIL(settings=FAST).fit(read(folder)).audit_
    review = review_of(audit, videos=EpisodeVideos.of(str(folder), audit.ids, lerobot_folders.FPS), page=page_of)
    review.data = read(folder)
    with serving(review) as client:
        browser.open(client.gate.url)
        browser.wait(f"{VERSION} === 0")
        browser.press("v")
        browser.wait(f"{TILES}.length === 12 && {TILES}.every((one) => one.querySelector('img').naturalWidth === 320)")
        assert all("/0/29" in one for one in browser.evaluate(f"{TILES}.map((one) => one.querySelector('img').src)"))
        browser.evaluate("document.querySelector('dialog.sweep select').value = '1'")
        browser.evaluate("document.querySelector('dialog.sweep select').dispatchEvent(new Event('change'))")
        browser.wait(f"{TILES}.every((one) => one.querySelector('polyline'))")
        asked = browser.evaluate("document.querySelector('.ask').dataset.asked")
        browser.evaluate(f"{TILES}[5].click()")
        browser.press("b")
        browser.wait(f"{VERSION} === 1")
        assert browser.evaluate("document.querySelector('.ask').dataset.asked") == asked
        films = "[...document.querySelectorAll('.stage video')].map((one) => one.hasAttribute('src'))"
        found = browser.evaluate(films)
        assert found, "the films are shown"
        assert all(found), "they play on"


HOSTILE = '<img src=x onerror="document.title = 1">=1+1'


@needs_chromium
@pytest.mark.slow
def test_a_note_goes_with_the_next_answer(audit, browser):
    with serving(review_of(audit, page=page_of)) as client:
        browser.open(client.gate.url)
        browser.wait(f"{VERSION} === 0")
        browser.press("n")
        browser.wait("document.activeElement.dataset.role === 'note'")
        browser.type(".why [data-role=note]", HOSTILE)
        browser.press("Enter")
        browser.press("4")
        browser.wait(f"{VERSION} === 1")
        rows = read_answer_rows("labels.csv")
        assert [tuple(row) for row in rows] == [(str(m), "bad", HOSTILE) for m in audit.pair]
        assert browser.evaluate("document.querySelector('.why [data-role=note]').value") == ""
        browser.evaluate(f"document.querySelector('[data-row=\"{audit.index(audit.pair[0])}\"]').click()")
        browser.wait("document.querySelector('.detail .said') !== null")
        assert browser.text(".detail .said") == f"bad {HOSTILE}"
        assert browser.evaluate("document.title") != "1"


@needs_chromium
@pytest.mark.slow
def test_the_end_shows_who_rejects_what_and_each_can_be_kept(audit, browser):
    asked = []

    def finish(given):
        asked.append(given)
        if given.get("write"):
            return {"files": {"keep": "k.json"}, "command": "rpil keep d.parquet", "lost": []}
        rejected = {"labels": [3, 5], "answers": [8], "faults": [9]}
        left = {rule: [m for m in own if str(m) not in given["spared"]] for rule, own in rejected.items()}
        kept = 24 - sum(map(len, left.values()))
        return {"kept": kept, "rejected": {rule: own for rule, own in left.items() if own}, "notes": [], "outcome": ""}

    text = "document.querySelector('dialog.finish').innerText"
    with serving(review_of(audit, page=page_of, finish=finish)) as client:
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
        browser.wait("document.querySelector('[data-role=keep-command]')?.innerText === 'rpil keep d.parquet'")
        assert json.loads(json.dumps(asked[-1])) == {
            "version": 0, "spared": ["5"], "rules": [], "write": True,
        }  # fmt: skip
        browser.press("Escape")
        browser.wait("!document.querySelector('dialog.finish').open")
