"""The README's figures are those that the code prints."""

from __future__ import annotations

import re
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pytest

from rpil.cli import demo

ROOT = Path(__file__).parents[2]
NUMBER = r"-?\d+(?:\.\d+)?"


@pytest.fixture(scope="module")
def result() -> demo.DemoResult:
    return demo.run(episodes=100)


def test_readme_is_short():
    assert len((ROOT / "README.md").read_text().splitlines()) < 150


@pytest.mark.slow
def test_picture_shows_the_landings_of_the_demo(result: demo.DemoResult):
    texts = [
        "".join(row.itertext()) for row in ElementTree.parse(ROOT / "docs" / "audit.svg").iter() if "text" in row.tag
    ]
    rows = [re.fullmatch(r"(\d+) +([\d,]+) +(\S+) +(\S+) +(\S+) +(\w+) +[\d ]+", text) for text in texts]
    shown = [row.groups() for row in rows if row is not None]
    audit = result.lunarlander.audit
    assert len(shown) == len(audit.ids) == 20
    for name, n_steps, log_odds, expert_proba, reliability, verdict in shown:
        m = audit.ids.index(int(name))
        assert int(n_steps.replace(",", "")) == np.diff(audit.offsets)[m]
        assert verdict == audit.verdicts[m]
        # The last digits depend on the processor.
        assert float(log_odds) == pytest.approx(audit.log_odds[m], abs=0.1)
        assert float(expert_proba) == pytest.approx(audit.expert_proba[m], abs=0.01)
        assert float(reliability) == pytest.approx(audit.reliability[m], abs=0.03)
    assert any(text.startswith("Told apart") for text in texts)


@pytest.mark.slow
def test_readme_quotes_the_demo(result: demo.DemoResult):
    quoted = re.findall(r"^> ?(.*)$", (ROOT / "README.md").read_text(), re.MULTILINE)
    text, printed = " ".join(" ".join(quoted).split()), " ".join(result.sentences())
    assert re.sub(NUMBER, "#", text) == re.sub(NUMBER, "#", printed)
    for told, now in zip(re.findall(NUMBER, text), re.findall(NUMBER, printed), strict=True):
        assert float(told) == pytest.approx(float(now), abs=0.02 if "." in told else 10)
