"""The report is one page that needs no network: what matters can be read without its script, all else is data."""

from __future__ import annotations

import base64
import hashlib
import json
import re
import unicodedata
from dataclasses import replace

import pytest
from markupsafe import Markup

from audits import make_audit
from html_page import Page
from rpil.results.html.page import About, render_page
from rpil.results.record import Audit

ADDRESS = "https://github.com/leeoniya/uPlot"
"""The only one in the script: of a comment."""


def render(audit: Audit, sections=(), **about: object) -> str:
    return render_page(audit, About(**({"title": "An audit", "source": "demos.parquet"} | about)), sections)


def data_of(text: str) -> list[str]:
    return re.findall(r'<script type="application/json">(.*?)</script>', text, re.DOTALL)


@pytest.fixture(scope="module")
def audit() -> Audit:
    return make_audit()


@pytest.fixture(scope="module")
def page(audit: Audit) -> Page:
    return Page(render(audit))


def test_page_needs_no_network(audit: Audit) -> None:
    text = render(audit, sections=[("Returns", Markup("<p>1.0</p>"))])
    assert text.count(ADDRESS) == 1
    assert "Steps like the rest" not in text, "they are explained, and may be all of them at the lowest score"
    text = text.replace(ADDRESS, "")
    assert not re.search(r"https?:|//[a-z]|@import|(?<!Object)url\((?!#)|srcset|fetch\(|XMLHttp", text, re.IGNORECASE)
    for tag, attributes in Page(text).tags:
        assert tag not in ("link", "iframe", "object", "embed", "base")
        assert "src" not in attributes
        assert (attributes.get("href") or "#").startswith("#")


def test_text_from_the_data_is_never_html() -> None:
    evil = "</script><script>alert(1)</script><!--"
    ids = (evil, '"><img src=x>')
    changes = {"method": (evil,), "adversary": evil, "competing": ((ids[0],), (ids[1],)), "pair": ids}
    audit = make_audit(("open", "outlier"), ids=ids, identifiable=False, doubts=(evil,), **changes)
    audit = replace(audit, provenance={"rpil": evil, "command": evil, "settings": {evil: [evil]}})
    about = {"title": evil, "source": evil, "read": (evil,)}
    text = render(audit, sections=[(evil, evil)], tasks={evil: evil}, **about)
    assert evil not in text
    assert "<!--" not in text
    page = Page(text)
    assert (len(page.all("script")), page.all("img")) == (2, [])
    assert text.count("&lt;script&gt;") >= 9
    (data,) = data_of(text)
    assert not set(data) & set("<>&\u2028\u2029")
    assert json.loads(data)["demonstrations"]["id"] == list(ids)


def test_only_the_script_and_the_style_of_the_page_are_allowed(audit: Audit) -> None:
    text = render(audit)
    (policy,) = (m["content"] for m in Page(text).all("meta") if m.get("http-equiv") == "Content-Security-Policy")
    rules = dict(rule.strip().split(" ", 1) for rule in policy.split(";"))
    assert rules.pop("default-src") == rules.pop("base-uri") == rules.pop("form-action") == "'none'"
    for tag, rule in (("script", "script-src"), ("style", "style-src-elem")):
        (code,) = re.findall(f"<{tag}>(.*?)</{tag}>", text, re.DOTALL)
        assert len(code) > 1000
        assert rules.pop(rule) == f"'sha256-{base64.b64encode(hashlib.sha256(code.encode()).digest()).decode()}'"
    assert rules == {"style-src-attr": "'unsafe-inline'"}
    assert text.index("Content-Security-Policy") < text.index("<style>")


def test_characters_that_cannot_be_seen_are_shown_as_escapes() -> None:
    ids = ("bell\x07", "half \ud800", "reversed \u202e", "noncharacter \ufffe", "a\u00a0b", "naïve 漢字")
    audit = make_audit(("open",) * 6, ids=ids, contradicting=ids)
    text = render(audit, title="null \x00", source="demo\x1b[31m.csv", sections=[("\x7f", "two\nlines")])
    text.encode("utf-8")
    assert {c for c in text if unicodedata.category(c) in ("Cc", "Cs", "Cf", "Cn")} == {"\n"}
    shown = Page(text).text
    names = r"bell\x07", r"half \ud800", r"reversed \u202e", r"noncharacter \ufffe", "naïve 漢字", r"\x1b[31m.csv"
    assert [name for name in names if name not in shown] == []
    assert "a\u00a0b" in text
