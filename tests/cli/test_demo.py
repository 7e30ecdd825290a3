"""The demo: bundled data with their licence, verdicts without the truth, and the numbers in the report and README."""

from __future__ import annotations

import json
import re
import sys
from importlib.resources import files
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pytest

from html_page import Page
from rpil.cli import demo
from rpil.data.errors import DataError
from rpil.faults.checking import check
from rpil.inference.findings import FINDINGS
from rpil.results.overview import look_first

ROOT = Path(__file__).parents[2]
NUMBER = r"-?\d+(?:\.\d+)?"
POLICIES = {"trust_all", "rpil", "oracle", "expert"}


@pytest.fixture(scope="module")
def stages() -> list[str]:
    return []


@pytest.fixture(scope="module")
def result(stages: list[str]) -> demo.DemoResult:
    return demo.run(episodes=10, progress=stages.append)


@pytest.fixture(scope="module")
def page(result: demo.DemoResult, tmp_path_factory: pytest.TempPathFactory) -> str:
    path = tmp_path_factory.mktemp("demo") / "demo.html"
    result.write_report(path)
    return path.read_text(encoding="utf-8")


@pytest.mark.parametrize(
    ("name", "size", "steps", "width", "actions"),
    [(demo.OVERCOOKED, 32, 10852, 94, 5), (demo.LUNARLANDER, 20, 6208, 8, 4)],
)
def test_bundled_data_have_the_recorded_sizes(name: str, size: int, steps: int, width: int, actions: int) -> None:
    data = demo.load_demonstrations(name)
    assert (len(data), data.n_steps, data.n_observations) == (size, steps, width)
    assert set(data.actions) == set(range(actions))
    assert data.observations.dtype == np.float32


def test_bundle_is_small_and_has_its_licence() -> None:
    folder = files("rpil.cli") / "bundled"
    notice = (ROOT / "NOTICE").read_text(encoding="utf-8")
    for words in ("overcooked-ai 1.1.0", "MIT License", "Copyright (c) 2019 Center for Human-Compatible AI", "AS IS"):
        assert words in notice
    assert demo.OVERCOOKED in notice
    assert demo.LUNARLANDER in notice
    assert sum(len(item.read_bytes()) for item in folder.iterdir()) < 300_000


def test_audits_agree_with_the_truth(result: demo.DemoResult) -> None:
    assert result.lander.finding == "outliers"
    assert set(result.returns) == POLICIES
    assert result.returns["rpil"].mean > result.returns["trust_all"].mean + 100
    auroc, spearman = map(float, re.findall(r"(?:AUROC|Spearman) (\d\.\d+)", result.sentences[0]))
    assert auroc > 0.8
    assert spearman > 0.4


def test_sentences_contain_the_numbers(result: demo.DemoResult, stages: list[str]) -> None:
    text = " ".join(result.sentences)
    assert f"32 real people: {result.people.finding}. " in text
    assert "corrupted demonstrations: outliers. 0 of 20" in text
    assert f"R-PIL {result.returns['rpil'].mean:.0f}" in text
    assert "0 of 20 verdicts wrong" in text
    text.encode("ascii")  # some terminals have no other characters
    assert {stage.split(":")[0] for stage in stages} == {"LunarLander", "Overcooked"}
    assert "LunarLander: R-PIL lands, 10 of 10" in stages


def test_report_has_the_people_and_both_comparisons(result: demo.DemoResult, page: str) -> None:
    parsed = Page(page)
    assert all(
        (attributes.get("href") or "#").startswith("#") and "src" not in attributes for _, attributes in parsed.tags
    )
    for words in ("Overcooked: real people", "32 demonstrations", "LunarLander", "Spearman", "Mean return"):
        assert words in parsed.text
    assert FINDINGS[result.people.finding] in parsed.text
    (view,) = (json.loads(text) for text in re.findall(r'<script type="application/json">(.*?)</script>', page))
    assert len(view["demonstrations"]["id"]) == len(view["drawings"]) == 32


def test_without_gymnasium_no_policy_flies(monkeypatch: pytest.MonkeyPatch) -> None:
    is_good = demo.load_truth(demo.LUNARLANDER, "is_good")
    monkeypatch.setattr(demo, "OVERCOOKED", demo.LUNARLANDER)  # which is judged in a second
    monkeypatch.setattr(demo, "load_truth", lambda *_: is_good)
    monkeypatch.setitem(sys.modules, "gymnasium", None)
    result = demo.run()
    assert result.returns == {}
    assert re.fullmatch(r"No policy has flown\. .*rpil\[gym\].*", result.sentences[-1])


def test_one_landing_is_refused() -> None:
    with pytest.raises(DataError, match="two landings"):
        demo.run(episodes=1)


# --- the README ------------------------------------------------------------------------------------------------------


def test_picture_shows_the_landings_of_the_demo(result: demo.DemoResult) -> None:
    texts = [
        "".join(row.itertext()) for row in ElementTree.parse(ROOT / "docs" / "audit.svg").iter() if "text" in row.tag
    ]
    rows = [re.fullmatch(r"(\d+) +(\w+) +([-+]\S+) +.*", text) for text in texts]
    shown = [row.groups() for row in rows if row is not None]
    audit, faults = result.lander, check(demo.load_demonstrations(demo.LUNARLANDER))
    assert len(audit.ids) == 20
    first = look_first(audit, [fault.id for fault in faults.findings])
    assert [int(name) for name, *_ in shown] == [audit.ids[m] for m in first]
    for name, verdict, log_odds in shown:
        m = audit.ids.index(int(name))
        assert verdict == audit.verdicts[m]
        # The last digits depend on the processor.
        assert float(log_odds) == pytest.approx(audit.log_odds[m], abs=0.1)
    assert any(" of 20 act differently" in text for text in texts)


def test_readme_quotes_the_demo(result: demo.DemoResult) -> None:
    quoted = re.findall(r"^> ?(.*)$", (ROOT / "README.md").read_text(), re.MULTILINE)
    text, printed = " ".join(" ".join(quoted).split()), " ".join(result.sentences)
    assert re.sub(NUMBER, "#", text) == re.sub(NUMBER, "#", printed)
    audits = " ".join(result.sentences[:2])  # the returns are of more landings
    for told, now in zip(re.findall(NUMBER, text), re.findall(NUMBER, audits), strict=False):
        assert float(told) == pytest.approx(float(now), abs=0.02 if "." in told else 10)
