"""The page in a browser: what a reader filters, sorts, marks and downloads, also where the data are hostile."""

from __future__ import annotations

import csv
import io
import json
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from asked import read_answers
from audits import make_audit
from browser import Browser, needs_chromium
from rpil.faults.report import FaultReport
from rpil.faults.rule import Fault
from rpil.results.answering import looking_order
from rpil.results.html.page import About, write_page
from rpil.results.judged import Demonstrator
from rpil.results.record import Audit
from rpil.segments.ranges import Segments

pytestmark = [pytest.mark.slow, needs_chromium]

HOSTILE = (
    *("</script><script>document.title='ran'</script>", '"quoted", and more', "=HYPERLINK(1)", "'=1+1", "-5", "-5x"),
    *("\u202ereversed", "<img src=x onerror=document.title='ran'>", "constructor", "__proto__", "ends with \\"),
)

MADE = {"rpil": "1", "command": "rpil audit x.csv", "seed": 0, "settings": {}, "files": []}


@pytest.fixture
def browser(chromium: Browser, tmp_path: Path) -> Iterator[Browser]:
    yield chromium.renew(tmp_path)
    assert chromium.errors == []
    assert all(url.startswith(("file:", "blob:")) for url in chromium.requests)


def write(path: Path, audit: Audit, **about: object) -> Path:
    n = len(audit.ids)
    of_x = "x", 1.0, 0.5, 2.0
    findings = Fault("jump", audit.ids[-1], 3, 5, *of_x, "it leaps"), Fault("constant state", "", 0, 1, *of_x, "x is 0")
    given = {
        "source": "x.csv",
        "faults": FaultReport(findings, {}, {}, {}, {}, n, 99),
        "demonstrators": {str(name): ("ann", "bob")[m % 2] for m, name in enumerate(audit.ids)},
    }
    write_page(path, audit, About("An audit", **(given | about)))
    return path


def column(browser: Browser, place: int) -> list[str]:
    """What the rows that can be seen show in one column."""
    return browser.evaluate(f"[...document.querySelectorAll('tr[data-row]')].map(r => r.cells[{place}].textContent)")


def marked(sentence: str) -> str:
    """An expression that is true where the page says how many marks there are."""
    return f"document.querySelector('[data-role=marked]').innerText === {json.dumps(sentence)}"


def downloaded(folder: Path, browser: Browser, role: str, name: str) -> str:
    browser.click(f"[data-role={role}]")
    for _ in range(500):
        if (folder / name).exists() and (folder / name).stat().st_size:  # an empty file holds the name first
            return (folder / name).read_bytes().decode()
        browser.evaluate("new Promise(done => setTimeout(done, 20))")
    raise AssertionError(name)


def test_it_opens_on_what_needs_a_person_and_is_filtered_searched_and_sorted(browser: Browser, tmp_path: Path) -> None:
    audit = make_audit(pair=(0, 7))
    browser.open(write(tmp_path / "r.html", audit))
    assert browser.text("[data-role=review]") == "Show the 5 to look at"
    assert browser.evaluate("document.querySelectorAll('[data-filter=fault]').length") == 1, "of jumps"
    order = [*map(str, looking_order(audit)[0])]
    assert column(browser, 1) == order
    assert {*order[:4]} == {"6", "7", "8", "9"}, "the outliers"
    browser.click("[data-role=review]")
    assert column(browser, 1) == order[:5]
    assert browser.text(".detail h3") == order[0]
    browser.press("Escape")
    browser.click('[data-filter=verdict][data-value="outlier"]')
    browser.click('[data-filter=demonstrator][data-value="bob"]')
    assert set(column(browser, 1)) == {"7", "9"}
    assert browser.text("[data-role=shown]") == "2 of 10 demonstrations"
    browser.press("Escape")
    assert len(column(browser, 1)) == 10
    browser.click("[data-rule=jump]")
    assert column(browser, 1) == ["9"]
    assert "it leaps" in browser.text(".detail")
    browser.press("Escape")
    browser.type("[data-role=search]", "BOB")
    assert sorted(column(browser, 1)) == ["1", "3", "5", "7", "9"]
    browser.type("[data-role=search]", "nothing like it")
    assert column(browser, 1) == []
    assert browser.text(".detail") == "No demonstration matches."
    browser.press("Escape")
    heads = browser.evaluate("[...document.querySelectorAll('thead th')].map(th => th.textContent)")
    steps = f"thead th:nth-child({heads.index('Steps') + 1}) button"
    lengths = sorted(audit.lengths.tolist())
    browser.click(steps)
    assert column(browser, heads.index("Steps")) == [f"{n:,}" for n in lengths]
    browser.click(steps)
    assert column(browser, heads.index("Steps")) == [f"{n:,}" for n in lengths[::-1]]
    sorts = browser.evaluate("[...document.querySelectorAll('[aria-sort]')].map(th => th.ariaSort)")
    assert sorts == ["descending"]


def test_only_the_rows_that_can_be_seen_are_in_the_page(browser: Browser, tmp_path: Path) -> None:
    audit = make_audit(("open", "outlier", "open") * 200, lengths=[5] * 600)
    browser.open(write(tmp_path / "r.html", audit))
    assert len(column(browser, 1)) < 80
    assert browser.evaluate("document.querySelector('[role=grid]').ariaRowCount") == "601"
    browser.click("tr[data-row]")
    browser.press("End")
    browser.wait("document.querySelector('tr.chosen td')?.textContent === '600'")
    assert len(column(browser, 1)) < 80
    assert browser.evaluate("document.querySelector('tr.chosen').ariaRowIndex") == "601"
    edges = "(one => [one.top, one.bottom])(document.querySelector('{}').getBoundingClientRect())"
    (top, bottom), (above, below) = (browser.evaluate(edges.format(name)) for name in ("tr.chosen", ".table"))
    assert above < top < bottom <= below
    browser.press("ArrowUp", "k", "j", "k")
    assert browser.text("tr.chosen td") == "598"
    assert "No drawing" in browser.text(".detail")
    ids = (2**53 + 1, 2**63 - 1, 7)  # which are no numbers of JavaScript
    browser.open(write(tmp_path / "ids.html", make_audit(("open",) * 3, ids=ids)))
    assert json.loads(downloaded(tmp_path, browser, "keep", "keep.json"))["episodes"] == list(ids)


def test_marks_survive_a_reload_and_are_downloaded(browser: Browser, tmp_path: Path) -> None:
    audit = make_audit(labels={0: 1, 6: -1}, provenance=MADE)
    page = write(tmp_path / "r.html", audit)
    browser.open(page)
    first = column(browser, 1)[:3]
    browser.press("b", "j", "g", "j", "g", "u", "z")
    assert column(browser, 2)[:3] == ["bad", "good", "good"]
    browser.reload()
    browser.wait(marked("Your marks: 2 good, 1 bad."))
    assert column(browser, 2)[:3] == ["bad", "good", "good"]
    rows = list(csv.reader(io.StringIO(downloaded(tmp_path, browser, "labels", "labels.csv"))))
    marks = dict(zip(first, ("bad", "good", "good"), strict=True))
    given = {"0": "good", "6": "bad"}
    assert rows[0] == ["id", "label"]
    assert dict(rows[1:]) == given | marks
    assert len(rows) == 1 + len(given | marks)
    kept = json.loads(downloaded(tmp_path, browser, "keep", "keep.json"))
    bad = {m for m in range(10) if (given | marks).get(str(m)) == "bad"}  # an outlier need not be
    episodes = [m for m in range(10) if m not in bad]
    assert kept == {"episodes": episodes, "run": audit.run_id, "provenance": MADE}
    browser.click('[data-filter=mark][data-value="good"]')
    assert column(browser, 1) == first[1:]


def test_hostile_ids_are_text_and_are_labelled_as_they_are(browser: Browser, tmp_path: Path) -> None:

    given = dict.fromkeys(("ids", "sessions", "own_reasons", "notes", "doubts", "method"), HOSTILE)
    given |= {"order": np.arange(float(len(HOSTILE))), "demonstrators": (Demonstrator(HOSTILE[0], None, HOSTILE),)}
    audit = make_audit(("outlier",) * len(HOSTILE), lengths=[80] * len(HOSTILE), **given)
    page = write(tmp_path / "r.html", audit, tasks={name: name for name in HOSTILE}, source="rpil </code>")
    browser.open(page)
    for _ in HOSTILE:
        browser.press("b", "j")
    assert browser.evaluate("document.title") == "An audit"
    assert browser.evaluate("document.querySelectorAll('main img').length") == 0
    shown = {text.replace("\\u202e", "\u202e") for text in column(browser, 1)}
    assert shown == set(HOSTILE)
    assert "\u202e" not in browser.evaluate("document.body.innerText")
    browser.reload()
    browser.wait(marked(f"Your marks: {len(HOSTILE)} bad."))
    downloaded(tmp_path, browser, "labels", "labels.csv")
    labels, _ = read_answers(tmp_path / "labels.csv")
    assert labels == dict.fromkeys(HOSTILE, "bad")
    kept = json.loads(downloaded(tmp_path, browser, "keep", "keep.json"))
    assert kept["episodes"] == []


def test_segments_are_a_band_and_rows_are_marked_with_two_keys(browser: Browser, tmp_path: Path) -> None:
    from rpil.data.id_values import parse_marks, read_answer_rows

    kinds, why = np.array([0, 1, 3, 0], dtype=np.int8), ["", "", HOSTILE[0], ""]
    starts, ends, of = np.array([0, 30, 50, 0]), np.array([30, 50, 90, 90]), np.array([0, 0, 0, 1])
    found = Segments(of, starts, ends, kinds, np.full(4, np.nan), why)
    audit = make_audit(("outlier",) * len(HOSTILE), lengths=[90] * len(HOSTILE), ids=HOSTILE)
    audit = replace(audit, answers=replace(audit.answers, marks=np.array([[1, 60, 70, -1]])))
    browser.open(write(tmp_path / "r.html", audit, segments=found))
    titles = "[...document.querySelectorAll('.band button')].map(one => one.title)"
    name = json.dumps(HOSTILE[0])
    browser.evaluate(
        f"[...document.querySelectorAll('tr[data-row]')].find(r => r.cells[1].textContent === {name}).click()"
    )
    hostile = f"back, steps 50 to 89: {HOSTILE[0]}"
    assert browser.evaluate(titles) == ["act, steps 0 to 29", "idle, steps 30 to 49", hostile]
    browser.click(".band .idle")
    browser.press("[")
    assert browser.text(".bands [role=status]") == "From step 30 on; ] ends it."
    browser.click(".band .back")
    browser.press("]", "b")
    browser.press("[", "]", "g")  # the last step alone; newer marks replace what they overlap
    assert browser.evaluate(titles)[3:] == ["good, steps 50 to 50"]
    browser.press("z")
    assert browser.evaluate(titles)[3:] == ["bad, steps 30 to 50"]
    browser.press("b")
    assert browser.evaluate("document.title") == "An audit"
    browser.reload()
    browser.wait(marked("Your marks: 1 bad."))
    downloaded(tmp_path, browser, "labels", "labels.csv")
    rows = read_answer_rows(tmp_path / "labels.csv")
    marks = parse_marks(rows, "labels.csv", HOSTILE, np.full(len(HOSTILE), 90))
    assert sorted(marks.tolist()) == [[0, 30, 51, -1], [1, 60, 70, -1]]
    assert [(row.id, row.label) for row in rows if not row.is_mark] == [(HOSTILE[0], "bad")]


@pytest.mark.parametrize(("width", "dark"), [(390, True), (1280, False)])
def test_it_fits_the_screen_and_the_paper(browser: Browser, tmp_path: Path, width: int, dark: bool) -> None:
    audit = make_audit(ids=["a" * 300, *"bcdefghij"], order=np.arange(10.0))
    page = write(tmp_path / "r.html", audit, read=("y" * 400,))
    browser.resize(width, 800, dark=dark)
    browser.open(page)
    assert browser.evaluate("document.documentElement.scrollWidth") == width
    heads = "[...document.querySelectorAll('.table thead th')]"  # none reaches into the next one, or is cut
    assert browser.evaluate(f"{heads}.every(one => one.scrollWidth <= one.clientWidth)")
    # The contrast of text that is muted or coloured, by WCAG 2: 4.5 to 1 or more.
    luminance = """(name) => {
      const style = getComputedStyle(document.documentElement).getPropertyValue('--' + name).trim();
      const [r, g, b] = style.match(/[0-9a-f]{2}/g)
        .map((c) => parseInt(c, 16) / 255).map((c) => (c <= .04045 ? c / 12.92 : ((c + .055) / 1.055) ** 2.4));
      return .2126 * r + .7152 * g + .0722 * b; }"""
    for ink in ("ink", "muted", "upper", "open", "lower"):
        for paper in ("page", "panel"):
            one, other = sorted(browser.evaluate(f"({luminance})('{name}')") for name in (ink, paper))
            assert (other + 0.05) / (one + 0.05) >= 4.5, (ink, paper)
    browser.resize(width, 800, dark=dark, media="print")
    assert browser.evaluate("getComputedStyle(document.querySelector('.detail')).display") == "none"
