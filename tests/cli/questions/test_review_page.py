"""The page of a review in a browser: answers by keys, and what is written."""

import re

import pytest

from asked import read_answers
from browser import needs_chromium
from rpil.data.id_values import read_answer_rows
from served import need_server, review_of, serving

need_server()

VERSION = "Number(document.querySelector('.ask').dataset.version)"
CHOSEN = "document.querySelector('.detail h3').innerText"


@pytest.fixture
def browser(chromium):
    yield chromium.renew()
    assert chromium.errors == []


def after(browser, version, *keys):
    """Press keys, and wait for the page of a version."""
    browser.press(*keys)
    browser.wait(f"{VERSION} === {version}")


def test_the_page_names_what_is_asked_and_escapes_it(audit):
    review = review_of(audit)
    review.session.path = "<script>alert(1)</script>.csv"
    page = review.page()
    assert "<script>alert" not in page
    assert "&lt;script&gt;alert(1)" in page
    assert f'data-asked="{[audit.index(name) for name in audit.pair]}"' in page
    assert "connect-src &#39;self&#39;" in page or "connect-src 'self'" in page


@needs_chromium
@pytest.mark.slow
def test_answers_by_keys_are_written_and_shown(audit, browser, tmp_path):
    with serving(review_of(audit)) as client:
        (tmp_path / "link.html").write_text(f"<a href='{client.gate.url}'>the page</a>")
        browser.open(tmp_path / "link.html")
        browser.click("a")  # a link of another site, as in a terminal that is a page
        browser.wait(f"{CHOSEN} === '{audit.pair[0]}'")
        address = rf"http://127\.0\.0\.1:{client.gate.port}/(#episode=\d+)?"  # soon with what is chosen
        assert re.fullmatch(address, browser.evaluate("location.href")), "the token is not shown"
        assert "Which is better" in browser.text(".ask h2")
        after(browser, 1, "1")
        assert read_answers("labels.csv") == ({}, {tuple(map(str, audit.pair)): "better than"})
        asked = audit.answered({}, [audit.pair]).suggest_labels(1)[0]
        browser.wait(f"{CHOSEN} === '{asked}'")  # the next question is chosen
        assert "Now: 20 open, 4 outliers." in browser.text(".ask [role=status]")
        browser.press("j")
        other = browser.evaluate(CHOSEN)
        assert other != str(asked)
        browser.press("n")
        browser.wait("document.activeElement.dataset.role === 'note'")
        browser.type(".why [data-role=note]", "<b>=slips")
        browser.press("Enter")
        after(browser, 2, "b")
        assert read_answer_rows("labels.csv")[-1][:3] == (other, "bad", "<b>=slips")
        assert browser.evaluate(CHOSEN) == other, "another one than that of the question stays"
        assert browser.evaluate("document.querySelector('[data-mark=bad]').getAttribute('aria-pressed')") == "true"
        browser.press("k")
        assert browser.evaluate(CHOSEN) == str(asked)
        browser.press("g", "j", "g", "z")  # faster than the server
        browser.wait(f"{VERSION} === 5")
        assert read_answers("labels.csv")[0] == {other: "bad", str(asked): "good"}
        browser.press("1")  # no pair is asked about
        after(browser, 6, "s")
        assert "3 answers of this run" in browser.text(".ask .told")
        browser.click(".ask [data-role=take-back]")
        browser.wait(f"{VERSION} === 7")
        browser.evaluate("location.reload()")
        browser.wait("document.querySelector('.ask')?.innerText.includes('3 answers of this run')")
        assert all(url.startswith((f"http://{client.host}/", "data:", "blob:")) for url in browser.requests[1:])
