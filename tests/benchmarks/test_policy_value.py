"""The benchmark of policies: rules, what they are told, the report by hand, and its quick mode."""

import importlib.util
import json
from types import SimpleNamespace

import numpy as np
import pytest

import policy_value
from value import report
from value.rules import ALL, ORACLE, RULES, Judged, told, weights_of
from value.worlds import make_world

MISSING = [name for name in ("torch", "gymnasium") if importlib.util.find_spec(name) is None]
needs_extra = pytest.mark.skipif(bool(MISSING), reason=f"pip install 'rpil[value]': {' and '.join(MISSING)} missing")


@pytest.fixture(scope="module")
def car():
    """Six good and six bad demonstrations."""
    pytest.importorskip("gymnasium", reason="pip install 'rpil[gym]': gymnasium is missing")
    world = make_world("MountainCar-v0", 12, 0.5, 0)
    return SimpleNamespace(world=world, judged=Judged(world.demonstrations))


@pytest.mark.slow
def test_a_rule_is_told_no_more_than_it_says_and_weights_are_those_by_hand(car):
    """Every step has a weight, the largest 1."""
    for name, rule in RULES.items():
        known = told(rule, car.world, car.judged, 0)
        assert (known.is_good is not None) == (name == ORACLE or "labels" in name)
        assert (known.success is not None) == ("success" in name or "outcome" in name)
        weight = weights_of(rule, car.world, car.judged, 0)
        assert weight.shape == (car.world.demonstrations.n_steps,)
        assert (weight.max(), weight.min() >= 0) == (1, True)
    world, lengths = car.world, car.world.demonstrations.lengths
    kept = {name: weights_of(RULES[name], world, car.judged, 0) for name in (ALL, ORACLE, "best 40 %")}
    assert kept[ALL].all()
    np.testing.assert_array_equal(kept[ORACLE], np.repeat(world.is_good, lengths))
    best = np.argsort(-car.judged.audit.log_odds, kind="stable")[:5]
    np.testing.assert_array_equal(kept["best 40 %"], np.repeat(np.isin(np.arange(12), best), lengths))


def cell(rule, success, seed=0, task="reach", share=0.1, **more):
    key = {"seed": seed, "n": 20, "share": share, "task": task, "learner": "linear", "rule": rule}
    key |= {"episodes": 5, "steps": 5, "success": success, "kept": 1.0, "weight_on_good": 1.0}
    return key | more


def test_the_report_pairs_tasks_and_seeds():
    rows = [cell(ALL, 0.5, 0, "reach", 0.1), cell(ALL, 0.3, 0, "reach", 0.5), cell(ALL, 0.2, 0, "push", 0.1)]
    rows += [cell("keep", 0.6, 0, "reach", 0.1), cell("keep", 0.6, 0, "reach", 0.5), cell("keep", 0.1, 0, "push", 0.1)]
    rows += [cell("keep", 0.9, 1, "push", 0.1)]  # not paired
    np.testing.assert_allclose(report.paired(rows, "keep"), [-0.1, 0.2])
    assert report.difference(np.array([-0.1, 0.2])) == ("+5.0", "15.0", "2")
    assert report.holm([0.01, 0.04, 0.03]) == pytest.approx([0.03, 0.06, 0.06])
    assert report.p_lower(np.array([-1.0, -2.0, -3.0])) == pytest.approx(0.0371, abs=1e-4)
    assert [report.p_lower(np.full(3, value)) for value in (-0.5, 0.0, 0.5)] == [0.0, 1.0, 1.0]


@pytest.mark.slow
@needs_extra
def test_quick_is_resumed(tmp_path, capsys):
    """A second run does only what the first one left; a line that was cut off is done again."""
    out = tmp_path / "value.jsonl"
    assert policy_value.main(["--quick", "--out", str(out)]) == 0
    lines = out.read_text().splitlines()
    assert {"commit", "dirty"} <= set(json.loads(lines[0]))
    rows = [json.loads(line) for line in lines]
    assert len(rows) == 4 * len(policy_value.PRESETS["quick"]["rules"])
    assert all(0 <= row["success"] <= 1 for row in rows)
    assert {row["weight_on_good"] for row in rows if row["rule"] == ORACLE} == {1.0}
    out.write_text("\n".join([*lines[:-1], lines[-1][:20]]))
    capsys.readouterr()
    policy_value.main(["--quick", "--out", str(out)])
    again = policy_value.read(out)
    assert [row | {"seconds": 0} for row in again] == [row | {"seconds": 0} for row in rows]
    assert "gain over all" in capsys.readouterr().out
