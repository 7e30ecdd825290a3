"""The report is one complete page that needs no network and shows the values of the audit."""

from __future__ import annotations

import base64
import hashlib
import json
import re
import shutil
import subprocess
import unicodedata
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from markupsafe import Markup
from matplotlib.image import imread

from audits import make_audit
from html_page import Page
from rpil.data.errors import DataError
from rpil.inference.findings import FINDINGS
from rpil.inference.settings import AnswerSettings, ClaimSettings
from rpil.results.answering import NEXT_STEPS
from rpil.results.html.number_format import format_number
from rpil.results.html.page import Article, render_page, write_page
from rpil.results.html.pictures import returns_figure
from rpil.results.record import Audit
from rpil.results.settings import AuditSettings
from rpil.results.words import WORDS


def render(audit: Audit, **options: object) -> str:
    article = Article(**({"title": "An audit", "audit": audit, "source": "demos.parquet"} | options))
    return render_page([article])


def csp_hash(code: str) -> str:
    return f"'sha256-{base64.b64encode(hashlib.sha256(code.encode()).digest()).decode()}'"


@pytest.fixture(scope="module")
def audit() -> Audit:
    return make_audit()


@pytest.fixture(scope="module")
def page(audit: Audit) -> Page:
    return Page(render(audit, seconds=1.25))


@pytest.fixture
def unknown() -> Audit:
    ids = [f"d{k}" for k in range(30)]
    return make_audit(
        ("open",) * 30,
        ids=ids,
        finding="two groups",
        identifiable=False,
        competing=(tuple(ids[:4]), tuple(ids[4:])),
        pair=("d0", "d9"),
    )


def test_page_begins_with_the_finding_and_the_next_step(page: Page) -> None:
    assert f"An audit Some are unlike. {FINDINGS['some are unlike']} 10 demonstrations:" in page.text
    assert "10 demonstrations: 5 typical , 1 open , 4 unlike ." in page.text
    assert f"Next: {NEXT_STEPS['some are unlike']}" in page.text
    assert "Share of typical ones 55 % 95 % interval 31 % to 77 %" in page.text
    assert "Compared with uniform" in page.text
    assert "Time 1.25 s" in page.text
    assert f"The most trusted first. {WORDS['none'].explanation} {WORDS['none'].experience}" in page.text


@pytest.mark.parametrize("finding", ["nobody stands out", "nothing could be learned"])
def test_page_without_groups_gives_no_verdicts(finding: str) -> None:
    audit = make_audit(("open",) * 10, finding=finding)
    text = Page(render(audit)).text
    assert f"{finding.capitalize()}. {FINDINGS[finding]} 10 demonstrations, ranked below; the ranking gives no" in text
    assert "gives no words. Next:" in text
    assert NEXT_STEPS[finding] in text
    assert "0 unlike" not in text


def test_parts_of_the_log_odds_are_columns_that_add_up(page: Page) -> None:
    audit = make_audit()
    label = np.where(np.arange(10) == 3, 12.0, 0.0)
    text = render(make_audit(log_odds=audit.log_odds + label, from_actions=audit.log_odds, from_label=label))
    parsed = Page(text)
    assert "the sum of the columns to their right: actions, label." in parsed.text
    values = [attributes["data-value"] for attributes in parsed.all("td") if "data-value" in attributes]
    order = (-(audit.log_odds + label)).argsort(kind="stable")
    actions, labels = (np.array(values[k::6], dtype=float) for k in (1, 2))
    np.testing.assert_array_equal(actions, audit.log_odds[order])
    np.testing.assert_array_equal(labels, label[order])
    assert "Log-odds Actions Label P(typical)" in parsed.text
    assert "Log-odds P(typical)" in page.text  # one part alone is the log-odds


@pytest.mark.parametrize(
    ("anchor", "settings"),
    [
        ("none", AuditSettings(claims=ClaimSettings(min_proba=0.6))),
        ("answers", AuditSettings(answers=AnswerSettings(min_proba=0.6))),
        ("named adversary", AuditSettings(min_verdict_proba=0.6)),
    ],
)
def test_thresholds_of_verdicts_are_those_of_the_audit(anchor: str, settings: AuditSettings) -> None:
    one, other = make_audit(anchor=anchor, settings=settings), make_audit(anchor=anchor)
    text = Page(render(one)).text
    assert "at least 60 %" in text
    assert "at most 40 %" in text
    assert "90 %" not in text
    both = Page(render_page([Article("a", one, "a.csv"), Article("b", other, "b.csv")])).text
    assert "at least 60 %" in both
    assert "at least 90 %" in both


def test_page_needs_no_network(audit: Audit) -> None:
    text = render(audit, sections=[("Returns", returns_figure([("all", 1.0, 0.0, 2.0)]))])
    assert not re.search(r"https?:|//[a-z]|@import|url\((?!#)|srcset", text.replace("// ", ""), re.IGNORECASE)
    for tag, attributes in Page(text).tags:
        assert tag not in ("link", "iframe", "object", "embed", "base")
        assert "src" not in attributes
        assert (attributes.get("href") or "#").startswith("#")


def test_page_is_reproducible(audit: Audit) -> None:
    assert render(audit) == render(audit)


def test_every_link_and_label_has_a_target(page: Page) -> None:
    ids = [attributes["id"] for _, attributes in page.tags if "id" in attributes]
    assert len(ids) == len(set(ids))
    used = [attributes["href"][1:] for _, attributes in page.tags if "href" in attributes]
    used += [attributes["aria-labelledby"] for _, attributes in page.tags if "aria-labelledby" in attributes]
    used += re.findall(r"url\(#(.*?)\)", str(page.tags))
    assert set(used) <= set(ids)


def test_pictures_have_descriptions_and_headers_a_scope(page: Page, audit: Audit) -> None:
    for attributes in page.all("svg"):
        assert attributes.get("aria-label") or attributes.get("aria-hidden") == "true"
    assert len(page.all("th", scope="row")) == len(audit.ids)
    assert len(page.all("th")) == len(page.all("th", scope="row")) + len(page.all("th", scope="col"))


def test_ranking_shows_the_values_of_the_audit(page: Page, audit: Audit) -> None:
    order = audit.ranking()
    values = [attributes["data-value"] for attributes in page.all("td") if "data-value" in attributes]
    minus_rank, proba, reliability, steps = (np.array(values[k::4], dtype=float) for k in range(4))
    np.testing.assert_array_equal(minus_rank, -np.arange(1, 11))
    np.testing.assert_array_equal(proba, audit.expert_proba[order])
    np.testing.assert_array_equal(reliability, audit.reliability[order])
    np.testing.assert_array_equal(steps, audit.lengths[order])
    assert format_number(audit.log_odds[order[0]]) in page.text


def test_worst_steps_are_named_marked_and_linked(page: Page, audit: Audit) -> None:
    index = int(audit.ranking()[-1])
    worst = [(n, format_number(audit.step_log_ratio[audit.offsets[index] + n])) for n in audit.worst_steps(index)]
    assert f"Worst steps: {' , '.join(f'{n} ({value})' for n, value in worst)} ." in page.text
    assert {f"step {n}: {value} nats" for n, value in worst} <= {
        mark["title"] for mark in page.all("span", **{"class": "mark"})
    }
    assert len(page.all("a", href=f"#demonstration-{index}")) == 3


def test_two_groups_are_listed_with_the_question(unknown: Audit, page: Page) -> None:
    text = Page(render(unknown)).text
    assert f"Two groups. {FINDINGS['two groups']} 30 demonstrations, ranked below" in text
    assert "It cannot be known which of two groups is good" in text
    assert "Group A 4 demonstrations: d0, d1, d2, d3 Group B 26 demonstrations: d4," in text
    assert "and 6 more" in text
    assert f"Next: {NEXT_STEPS['two groups']} Which is better: d0 (look at steps " in text
    assert "d0,better than d9 , or good or bad for either" in text
    assert "--labels labels.csv" in text
    assert "It cannot be known which of two groups is good" not in page.text
    assert "Group" not in page.text


def test_doubts_and_contradicting_labels_are_told_and_an_answered_question_is_not_asked_again() -> None:
    changes = {"doubts": ("One part says most.",), "contradicting": ("d3",), "pair": ("d0", "d9")}
    ids = [f"d{k}" for k in range(10)]
    text = Page(render(make_audit(ids=ids, **changes))).text
    assert "One part says most." in text
    assert "d3: its label contradicts the other answers; look again." in text
    assert "Which is better: d0" in text
    assert "Which is better" not in Page(render(make_audit(ids=ids, labels={"d3": 1}, **changes))).text
    assert "Which is better" not in Page(render(make_audit())).text


def test_text_from_the_data_is_escaped() -> None:
    evil = "<script>alert(1)</script>"
    ids = (evil, '"><img src=x>')
    changes = {"assumptions": (evil,), "adversary": evil, "competing": ((ids[0],), (ids[1],)), "pair": ids}
    audit = make_audit(("typical", "unlike"), ids=ids, identifiable=False, **changes)
    text = render(audit, title=evil, source=evil, sections=[(evil, evil)])
    assert evil not in text
    page = Page(text)
    assert len(page.all("script")) == 1
    assert page.all("img") == []
    assert text.count("&lt;script&gt;") >= 9


def test_only_the_script_and_the_style_of_the_page_are_allowed() -> None:
    text = render(make_audit())
    (policy,) = (m["content"] for m in Page(text).all("meta") if m.get("http-equiv") == "Content-Security-Policy")
    rules = dict(rule.strip().split(" ", 1) for rule in policy.split(";"))
    assert rules.pop("default-src") == rules.pop("base-uri") == rules.pop("form-action") == "'none'"
    for tag, rule in (("script", "script-src"), ("style", "style-src-elem")):
        (code,) = re.findall(f"<{tag}>(.*?)</{tag}>", text, re.DOTALL)
        assert len(code) > 1000
        assert rules.pop(rule) == csp_hash(code)
    assert rules == {"style-src-attr": "'unsafe-inline'"}
    assert text.index("Content-Security-Policy") < text.index("<style>")


def test_characters_that_cannot_be_seen_are_shown_as_escapes() -> None:
    ids = ("bell\x07", "half \ud800", "reversed \u202e", "noncharacter \ufffe", "a\u00a0b", "naïve 漢字")
    audit = make_audit(("typical",) * 6, ids=ids, competing=(ids[:3], ids[3:]), pair=ids[2:4])
    text = render(audit, title="null \x00", source="demo\x1b[31m.csv", sections=[("\x7f", "two\nlines")])
    text.encode("utf-8")
    assert {c for c in text if unicodedata.category(c) in ("Cc", "Cs", "Cf", "Cn")} == {"\n"}
    shown = Page(text).text
    for name in (
        r"bell\x07",
        r"half \ud800",
        r"reversed \u202e",
        r"noncharacter \ufffe",
        "naïve 漢字",
        r"demo\x1b[31m.csv",
    ):
        assert name in shown
    assert "a\u00a0b" in text


def test_reason_stands_with_every_verdict(audit: Audit, page: Page) -> None:
    reasons = {mark["title"] for mark in page.all("span") if "verdict" in (mark.get("class") or "") and "title" in mark}
    assert reasons == set(audit.reasons)
    assert all(reason in page.text for reason in audit.reasons)


def test_sections_precede_the_ranking_and_only_markup_is_html(audit: Audit) -> None:
    text = render(audit, sections=[("One", Markup("<em>kept</em>")), ("Two", "a < b")])
    assert text.index("<em>kept</em>") < text.index("<p>a &lt; b</p>") < text.index('id="ranking"')


def test_infinite_log_odds_are_shown_as_infinity() -> None:
    text = Page(render(make_audit(("typical", "unlike"), log_odds=np.array([np.inf, -np.inf])))).text
    assert "∞" in text
    assert "−∞" in text
    assert "inf " not in text


def test_page_of_two_hundred_demonstrations_is_small() -> None:
    text = render(make_audit(("typical", "unlike") * 100, lengths=[200] * 200))
    assert len(Page(text).all("details")) == 200
    assert len(text.encode()) < 3_000_000


def test_long_page_has_timelines_of_the_least_trusted_demonstrations() -> None:
    audit = make_audit(("typical",) * 150 + ("unlike",) * 100, lengths=[6] * 250)
    page = Page(render(audit))
    shown = {attributes["id"] for attributes in page.all("details")}
    assert shown == {f"demonstration-{m}" for m in audit.ranking()[50:]}
    assert "Shown are the 200 least trusted of 250 demonstrations." in page.text
    assert len(page.all("th", scope="row")) == 250


@pytest.mark.slow
def test_write_page_replaces_a_file_only_when_the_page_is_complete(tmp_path: Path, audit: Audit, monkeypatch) -> None:
    path = tmp_path / "report.html"
    part = Article("Été", audit, "demos.parquet")
    write_page(path, [replace(part, source="\udcff.csv")])  # a file whose name is not Unicode
    assert "\\udcff.csv" in path.read_text()
    write_page(path, [part])
    assert path.read_text(encoding="utf-8") == render(audit, title="Été")
    with pytest.raises(TypeError):
        write_page(path, [replace(part, sections=[None])])
    assert path.read_text(encoding="utf-8") == render(audit, title="Été")
    assert list(tmp_path.iterdir()) == [path]


def test_write_page_names_a_missing_folder(tmp_path: Path, audit: Audit) -> None:
    with pytest.raises(DataError, match="nowhere"):
        write_page(tmp_path / "nowhere" / "report.html", [Article("", audit, "")])


@pytest.mark.slow
@pytest.mark.skipif(shutil.which("chromium") is None, reason="needs a chromium binary on PATH")
def test_page_works_in_a_browser(tmp_path: Path, unknown: Audit) -> None:
    # The probe acts as a reader does, and leaves what it saw in the title.
    probe = """<script>
    const head = [...document.querySelectorAll("thead button")].find((one) => one.textContent === "Steps");
    const steps = () => [...document.querySelectorAll("tbody tr")].map((row) => Number(row.cells[7].dataset.value));
    head.click(); const up = steps(); head.click(); const down = steps();
    document.querySelector("td.worst a").click();
    const select = document.querySelector("#timeline-tools select");
    select.value = document.querySelector("details:not([open])").id;
    select.dispatchEvent(new Event("change"));
    const opened = document.querySelectorAll("details[open]").length;
    document.querySelector("#timeline-tools button").click();
    document.title = JSON.stringify({ up, down, opened, all: document.querySelectorAll("details[open]").length,
      sort: head.parentElement.getAttribute("aria-sort"), wide: document.documentElement.scrollWidth > innerWidth });
    </script>"""
    plain, probed, foreign = (tmp_path / f"{name}.html" for name in ("plain", "probed", "foreign"))
    picture = tmp_path / "report.png"
    page = render(unknown)
    plain.write_text(page, encoding="utf-8")
    allowed = page.replace("script-src ", f"script-src {csp_hash(probe[8:-9])} ")
    probed.write_text(allowed.replace("</body>", probe + "</body>"), encoding="utf-8")
    foreign.write_text(page.replace("</body>", "<script>document.title = 'ran'</script></body>"), encoding="utf-8")
    quiet = [f"--disable-{name}" for name in ("gpu", "quic", "background-networking", "component-update", "sync")]
    command = ["chromium", "--headless", "--no-sandbox", "--no-first-run", "--enable-logging=stderr", *quiet]
    command += [f"--user-data-dir={tmp_path / 'profile'}", "--window-size=500,2000"]

    def run(*arguments: str, refused: bool = False) -> str:
        done = subprocess.run([*command, *arguments], capture_output=True, text=True, timeout=120, check=True)
        assert ("CONSOLE" in done.stderr) == ("Content Security Policy" in done.stderr) == refused
        return done.stdout

    seen = json.loads(re.search("<title>(.*?)</title>", run("--dump-dom", probed.as_uri()))[1])
    lengths = sorted(unknown.lengths.tolist())
    assert seen == {"up": lengths, "down": lengths[::-1], "opened": 2, "all": 30, "sort": "descending", "wide": False}
    run(f"--screenshot={picture}", plain.as_uri())
    assert imread(picture).std() > 0.05
    assert "<title>An audit</title>" in run("--dump-dom", foreign.as_uri(), refused=True)
