"""The benchmark of trust: which figures meet the goals."""

from __future__ import annotations


def real_row(name: str, ours: float, pooled: float, **changed):
    ranking = {"rpil": ours, "rpil without length": ours - 0.02, "pooled": pooled, "length": 0.99}
    found = {"set": name, "family": "people", "size": 20, "failed": {}, "said": {}, "seconds": {"rpil": 1.0}}
    found["ranking"] = {method: {"auroc": value} for method, value in ranking.items()}
    found |= {"verdicts": {}, "finding": "some are unlike", "groups": [], "extra": {}, "answered": 0.7}
    return found | {"wrong": 1, "given": 14, "brier": 0.1, "base_rate_brier": 0.25} | changed


def met(sets):
    from trust_goals import goals

    return {row["goal"]: row["met"] for row in goals(sets)}


def test_goals_on_real_sets():
    peer, mean, length = "at least that of the best peer", "above that of every peer", "mean AUROC over real sets"
    few, over_all, low = "at most 10 % of the verdicts", "at most 5 % of the verdicts", "no AUROC below .4"
    brier, silent = "Brier score no worse than the base rate's in", "a verdict for 60 %"

    def missed(*sets):
        found = met(sets)
        return {part for part in (peer, mean, length, few, over_all, low, brier, silent) for name in found
                if part in name and found[name] is False}  # fmt: skip

    fine = real_row("a", 1.0, 0.95, wrong=0)
    assert missed(fine) == {mean}  # length has .99
    assert missed(real_row("a", 0.91, 0.95, wrong=0)) == {mean}
    assert missed(real_row("a", 0.89, 0.95, wrong=0)) == {peer, mean}
    assert missed(real_row("a", 0.87, 0.7, wrong=0)) == {mean, length}
    assert missed(fine, real_row("b", 1.0, 0.9, wrong=4)) == {mean, few, over_all}
    assert missed(fine, real_row("b", 1.0, 0.9, wrong=2)) == {mean, over_all}  # 2 of 14 may be an accident
    assert low in missed(real_row("a", 0.3, 0.3, wrong=0))
    assert low not in missed(real_row("a", 0.3, 0.3, wrong=0, given=0))
    assert missed(real_row("a", 1.0, 0.95, wrong=0, brier=0.26)) == {mean, brier}
    assert missed(real_row("a", 1.0, 0.95, wrong=0, answered=0.59)) == {mean, silent}
    assert missed(real_row("a", 1.0, 0.94, wrong=0, answered=0.59)) == {mean}
    assert set(met([]).values()) == {None}


def simulated_row(kind: str, seed: int, right: int, finding: str = "some are unlike"):
    verdicts = {"good": {"typical": 10, "open": 0, "unlike": 0}, "bad": {"unlike": right}}
    verdicts["bad"]["typical"] = 10 - right
    judged = {"verdicts": verdicts, "wrong": 10 - right, "given": 20, "brier": 0.1, "base_rate_brier": 0.25}
    row = real_row(f"simulated Acrobot-v1 {kind} 50 % {seed}", 1.0, 0.9) | {"family": "simulated", "finding": finding}
    row |= judged | {"extra": {"unknowable": kind == "flip"}}
    return row | ({"labelled": judged | {"auroc": 1.0}} if kind == "flip" else {})


def test_goals_of_the_grid():
    from trust_goals import cell_met, cells_goal

    assert cell_met([simulated_row("noisy", seed, 10) for seed in (0, 1)])
    assert not cell_met([simulated_row("noisy", 0, 10), simulated_row("noisy", 1, 9)])  # 2.5 % are wrong
    assert not cell_met([simulated_row("flip", 0, 10)])  # it claims to know
    assert cell_met([simulated_row("flip", 0, 10, "two groups")])
    unsure = simulated_row("flip", 0, 10, "two groups")
    assert not cell_met([unsure | {"labelled": unsure["labelled"] | {"auroc": 0.98}}])
    few = simulated_row("noisy", 0, 10)
    assert not cell_met([few | {"verdicts": few["verdicts"] | {"bad": {"unlike": 5, "open": 5}}}])  # a word for 75 %
    counts = [cells_goal("", {str(n): n < right for n in range(of)}, 45, 43)["met"]
              for right, of in ((43, 45), (42, 45), (40, 42), (40, 43), (43, 43))]  # fmt: skip
    assert counts == [True, False, None, False, True]


def test_goals_of_power():
    from trust_goals import power_goals

    row = {"size": 20, "extra": {"steps": 10}, "correct": 16, "oracle_correct": 20, "wrong": 1, "given": 17}
    fine = row | {"wrong_expected": 1.0}
    assert [goal["met"] for goal in power_goals([fine])] == [True, True]
    weak = row | {"wrong_expected": 1.0, "correct": 15, "extra": {"steps": 30}}
    assert [goal["figure"] for goal in power_goals([fine, weak])] == ["1 of 2", "2 of 2"]
    assert [goal["met"] for goal in power_goals([row | {"wrong": 4, "wrong_expected": 1.0}])] == [True, False]
