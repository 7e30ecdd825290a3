"""The sections on labels, calibration and demonstrators tell what was reached and what was missed."""

from __future__ import annotations


def labels_result(suggested: float, random: float) -> dict:
    def of(how: str, auroc: float) -> dict:
        found = {"how": how, "k": 3, "all": auroc, "auroc": 0.75, "without": 0.7, "wrong": 1.0, "questions": 4.0}
        by_set = {"all": {"ring": auroc}, "auroc": {"ring": 0.75}, "without": {"ring": 0.7}}
        return found | {"se": {"all": 0.01, "auroc": 0.02}, "by_set": by_set}

    none = {"set": "ring", "how": "none", "all": 0.71}
    curve = [of("suggested", suggested), of("random", random)]
    return {"adversary": "auto", "draws": 10, "rows": [none], "curve": curve}


def test_labels():
    from results import results

    page = results({"labels": labels_result(0.9, 0.8)})
    assert "3 suggested, AUROC of all, labels counted: better than 3 at random (+0.100 ± 0.010)." in page
    assert "3 suggested, AUROC of the rest: no different from 3 at random (+0.000 ± 0.020)." in page
    assert "Worse on" not in page
    assert "| 0 |  | 0.710 | 0.710 | 0.710 |" in page
    assert "| 3 | random | 0.800 ± 0.010 | 0.750 ± 0.020 | 0.700 |" in page
    assert "| 3 | suggested | 0.900 |" in page
    page = results({"labels": labels_result(0.8, 0.9)})
    assert "all, labels counted: worse than 3 at random (-0.100 ± 0.010)." in page
    assert "Worse on ring with 3: 0.800, at random 0.900." in page


def calibration_result(ece: float) -> dict:
    by = {"env": {"Acrobot-v1": ece}, "kind": {"noisy": ece}, "share": {"75": None}}
    found = {"ece": ece, "ece_by": by, "bins": [{"proba": 0.99, "good": 1.0, "n": 10}], "n_judged": 10, "n_draws": 2}
    accused = {"all good": [0, 0], "steps shuffled": [1, 3]}
    return found | {"n_ambiguous": 1, "covered": 0.95, "accused": accused, "n_each": 20}


def test_calibration():
    from results import results

    page = results({"calibration": calibration_result(0.06)})
    assert "Goal missed: expected calibration error 0.0600, at most .05." in page
    assert "Goal reached: the interval for the share of experts held the truth in 95% of draws" in page
    assert "Goal reached: called adversaries without signal 5.0%, at most 5 %." in page
    assert "| steps shuffled | 4 | 40 |" in page
    assert "| 0.990 | 1.000 | 10 |" in page
    assert "Goal reached: expected calibration error 0.0400" in results({"calibration": calibration_result(0.04)})


def test_demonstrators():
    from results import results

    def row(steps: int | None, without: float, knowing: float) -> dict:
        found = {"set": "car", "people": 3, "steps": steps, "without": without, "knowing": knowing}
        ends = {"without_ci95": [0.5, 0.9], "knowing_ci95": None}
        return found | ends | {"gain": knowing - without, "gain_se": None if steps is None else 0.02}

    found = {"adversary": "auto", "steps": 10, "draws": 3, "rows": [row(None, 0.9, 0.89), row(10, 0.6, 0.8)]}
    page = results({"demonstrators": found})
    assert "Cut to 10 steps: 0.600 without, 0.800 with" in page
    assert "car, all steps: -0.010." in page
    assert "| car | 3 | 10 | 0.600 (0.50 to 0.90) | 0.800 | +0.200 ± 0.020 |" in page
