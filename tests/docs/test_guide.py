"""The snippets of docs/policies.md run, and its pictures show what the text says."""

from __future__ import annotations

import re
import runpy
from pathlib import Path

import numpy as np
import pytest

import rpil
from rpil.inference.settings import JudgeSettings

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


def plain() -> list[str]:
    return [code for code in SNIPPETS if "orch" not in code and "HistGradient" not in code and "reweight" not in code]


def test_snippets_run(pictures):
    """The snippets without torch, in their order."""
    demonstrations, good = pictures["ring_demonstrations"]()
    names = {"RPIL": rpil.RPIL, "demonstrations": demonstrations}
    for code in plain():
        exec(compile(code, "docs/policies.md", "exec"), names)
    assert len(plain()) == 2
    assert names["audit"].verdicts == tuple("similar" if expert else "outlier" for expert in good)
    proba = names["answered"].expert_proba
    assert proba[good].min() > proba[~good].max()
    assert {word for word, expert in zip(names["answered"].verdicts, good, strict=True) if expert} <= {
        "good",
        "similar",
    }


@pytest.mark.filterwarnings("ignore::sklearn.exceptions.ConvergenceWarning")  # trees change by leaps
def test_snippet_with_an_estimator_runs(pictures):
    (code,) = [code for code in SNIPPETS if "HistGradient" in code]
    demonstrations, _ = pictures["ring_demonstrations"]()
    fast = code.replace("sklearn.ensemble", "sklearn.tree").replace("HistGradientBoosting", "DecisionTree")
    names = {"RPIL": rpil.RPIL, "demonstrations": demonstrations}
    exec(compile(fast, "docs/policies.md", "exec"), names)
    assert names["model"].predict(demonstrations.observations[:3]).shape == (3,)


@pytest.mark.filterwarnings("ignore::sklearn.exceptions.ConvergenceWarning")  # two epochs are few
def test_snippets_with_torch_run(pictures):
    torch = pytest.importorskip("torch", reason="torch is not installed: pip install 'rpil[torch]'")
    pytest.importorskip("skorch", reason="skorch is not installed: pip install 'rpil[torch]'")
    network, loop = [code for code in SNIPPETS if "orch" in code]
    demonstrations, _ = pictures["ring_demonstrations"]()
    demonstrations = demonstrations.select(np.arange(8, 16))
    names = {"RPIL": rpil.RPIL, "demonstrations": demonstrations}
    exec(compile(network.replace("max_iter=30", "max_iter=2"), "docs/policies.md", "exec"), names)
    assert names["model"].predict(demonstrations.observations[:3]).shape == (3,)

    class Net(torch.nn.Linear):
        def __init__(self):
            super().__init__(2, 3)

    step = """    x, a, w = (torch.as_tensor(part, dtype=kind) for part, kind in
        zip((observations, actions, weights), (torch.float32, torch.int64, torch.float32)))
    learner.optimizer.zero_grad()
    loss = torch.nn.functional.cross_entropy(learner.net(x), a, reduction="none")
    (w * loss).mean().backward()
    learner.optimizer.step()
"""
    start = loop.index("    ...\n")
    loop = loop[:start] + step + loop[loop.rindex("    ...\n") + 8 :]

    def distribution(learner, observations):
        with torch.no_grad():
            logits = learner.net(torch.as_tensor(np.asarray(observations), dtype=torch.float32))
        return Categorical(logits)

    class Categorical(torch.distributions.Categorical):
        def __init__(self, logits):
            super().__init__(logits=logits)

        def log_prob(self, actions):
            return super().log_prob(torch.as_tensor(np.asarray(actions)))

    names |= {"torch": torch, "make_network": Net}
    loop = loop.replace("found = reweight(", "Learner.distribution = distribution\nfound = reweight(")
    exec(compile(loop, "docs/policies.md", "exec"), names | {"distribution": distribution})


def test_all_adversaries_rank_the_experts_first(pictures):
    found, sorts = pictures["opinions"]()
    expert = np.array(sorts) == "expert"
    for name, audit in found.items():
        assert audit.log_odds[expert].min() > audit.log_odds[~expert].max()
        # Mistaken keys are too similar to the expert for this adversary.
        known = "mistakes a key" if name == "normalised complement" else "expert"
        assert all(sort in ("expert", known) for sort in np.array(sorts)[audit.log_odds >= 0]), name
    careful = {name: np.abs(audit.log_odds).mean() for name, audit in found.items() if name != "auto"}
    assert min(careful, key=careful.__getitem__) == "normalised complement"
    for audit in (audit for name, audit in found.items() if name != "auto"):
        doubtful = np.argsort(np.where(expert, -np.inf, audit.log_odds))[-1]
        assert sorts[doubtful] == "mistakes a key"


def test_straight_line_gives_no_verdict(pictures):
    demonstrations, good = pictures["ring_demonstrations"]()
    for name, right in (("a straight line", 0), ('features="auto"', 20)):
        model = pictures["RIVALS"][name]().fit(demonstrations)
        assert pictures["count_right"](model, good) == f"{right} of 20 verdicts right"


def test_reliability_interval_holds_the_share_of_the_experts_steps(pictures):
    demonstrations, _ = pictures["partly_bad"]()
    share = np.linspace(0.9, 0.0, 7)  # right actions are more: some random ones are right by chance
    audit = rpil.RPIL().fit(demonstrations).audit_
    low, high = audit.reliability_interval.T
    grid = 0.5 / JudgeSettings().reliability_nodes
    assert ((low[9:] - grid <= share) & (share <= high[9:] + grid)).all()
    assert audit.reliability[:9].min() > 0.95


def test_pictures_exist_and_are_small():
    named = re.findall(r"\]\((\w+\.png)\)", TEXT)
    assert named == ["policies.png", "adversaries.png", "reliability.png"]
    for name in named:
        assert (DOCS / name).stat().st_size < 150_000
