"""The snippets of docs/policies.md and the recipes of docs/guide.md run."""

from __future__ import annotations

import re
import runpy
from pathlib import Path

import numpy as np
import pytest

import rpil

pytestmark = pytest.mark.slow
DOCS = Path(__file__).parents[2] / "docs"
TEXT = (DOCS / "policies.md").read_text(encoding="utf-8")
SNIPPETS = re.findall(r"^```python\n(.*?)^```", TEXT, re.MULTILINE | re.DOTALL)


@pytest.fixture(scope="module")
def pictures():
    import matplotlib

    backend = matplotlib.get_backend()
    yield runpy.run_path(str(DOCS / "pictures.py"))
    matplotlib.use(backend)


def test_snippets_run(pictures):
    """The snippets without torch, in their order."""
    demonstrations, good = pictures["ring_demonstrations"]()
    names = {"RPIL": rpil.RPIL, "demonstrations": demonstrations}
    plain = [code for code in SNIPPETS if not re.search("orch|HistGradient|reweight", code)]
    assert len(plain) == 2
    for code in plain:
        exec(compile(code, "docs/policies.md", "exec"), names)
    assert names["audit"].verdicts == tuple("open" if expert else "outlier" for expert in good)
    proba = names["answered"].expert_proba
    assert proba[good].min() > proba[~good].max()
    assert "bad" not in np.array(names["answered"].verdicts)[good]


def test_the_recipes_of_the_guide_run_and_are_short():
    tool = runpy.run_path(str(DOCS.parent / "tools" / "path_of_audit.py"))
    recipes = re.findall(r"^```python\n(.*?)^```", (DOCS / "guide.md").read_text(encoding="utf-8"), re.M | re.S)
    assert len(recipes) == 4
    assert max(len([line for line in code.splitlines() if line]) for code in recipes) <= 6
    tool["write_demonstrations"](Path("drive.csv"), 16, 40)
    names: dict[str, object] = {}
    for code in recipes:
        exec(compile(code, "docs/guide.md", "exec"), names)
    kept = names["kept"]
    assert {0} <= kept < set(range(16))
    assert not {4, 8} & kept
    weight = names["audit"].step_weight.reshape(16, 40)[:, 0]
    assert weight[0] > weight[4]
    drawn = np.bincount(names["batch"] // 40, minlength=16)
    assert drawn[[4, 8]].sum() < drawn[[1, 2, 3]].sum()
    assert names["policy"].predict(np.zeros((1, 2))).shape == (1, 2)
    assert {row // 40 for row in names["rows"]} == kept
