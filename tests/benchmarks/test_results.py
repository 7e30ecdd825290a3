"""docs/results.md tells losses as they are, says where figures come from, and leaves out what was not measured."""

from __future__ import annotations

import copy
import json
import re
import subprocess
import sys
from pathlib import Path

import pytest

BENCHMARKS = Path(__file__).parents[2] / "benchmarks"
ORIGIN = {
    "commit": "0123456789ab",
    "dirty": False,
    "date": "2026-01-02",
    "seeds": 0,
    "python": "3.11.7",
    "packages": {"numpy": "2.0.0"},
    "cores": 2,
    "system": "Linux x86_64",
}


def row(method: str, name: str, auroc: float | None, **more: object) -> dict:
    interval = None if auroc is None else [auroc - 0.1, auroc + 0.1]
    found = {"method": method, "set": name, "auroc": auroc, "auroc_ci95": interval, "auroc_se": 0.05}
    return found | {"spearman": auroc, "said": None, "verdicts": None} | more


def real_result(ours: float = 0.81, peer: float = 0.92) -> dict:
    size = {
        "demonstrations": 32,
        "steps": 10852,
        "observations": 94,
        "actions": 5,
        "discrete": True,
        "good": 11,
        "bad": 11,
    }
    verdicts = {
        "good": {"typical": 7, "open": 4, "unlike": 0},
        "bad": {"typical": 1, "open": 2, "unlike": 8},
    }
    message = "the actions are continuous, which it is not made for; give discrete ones."
    ranking = [row("rpil", "cramped_room", ours, verdicts=verdicts), row("length", "cramped_room", peer)]
    ranking += [row("rpil", "hopper", 0.93), row("length", "hopper", 0.95)]
    ranking += [row("ILEED", "cramped_room", 0.5), row("ILEED", "hopper", None, said=message)]
    ahead = {"ours_ahead": ours - peer, "ours_ahead_ci95": [ours - peer - 0.1, ours - peer + 0.1]}
    means = {
        "rpil": {"mean": ours, "se": 0.03, "ours_ahead": None, "ours_ahead_ci95": None},
        "length": {"mean": peer, "se": 0.04, **ahead},
    }

    def held(trained_on: str, mean: float, gain: float | None) -> dict:
        ends = None if gain is None else [gain - 0.01, gain + 0.01]
        found = {"set": "cramped_room", "trained_on": trained_on, "measure": "accuracy", "said": None}
        return found | {"mean": mean, "ci95": [mean - 0.02, mean + 0.02], "gain": gain, "gain_ci95": ends}

    import real
    import real_goals

    return {
        "provenance": ORIGIN,
        "features": "raw",
        "sets": {"cramped_room": size, "hopper": size | {"discrete": False, "actions": 3}},
        "ranking": ranking,
        "mean_auroc": means,
        "goal": real.goal(means),
        "continuous_goals": [
            real_goals.aim("hopper", "AUROC", 0.93, 0.95),
            real_goals.aim("hopper", "R²", 0.66, 0.64),
            real_goals.aim("other", "R²", None, None),
        ],
        "held_out": [held("all", 0.77, None), held("kept", 0.75, -0.02), held("good", 0.78, 0.01)],
    }


def test_page_names_a_loss_on_real_data():
    from results import results

    page = results({"real": real_result()})
    assert "missed, ours 0.810, best peer 0.920 (length)" in page
    assert "Not the best on cramped room: ours 0.81 (0.71 to 0.91), length 0.92." in page
    assert "not surely above zero: length (-0.110, -0.210 to -0.010)" in page
    assert "No better for keeping on cramped room: -0.020 (-0.030 to -0.010) against training on all." in page
    assert "| rpil | 0.81 (0.71 to 0.91) | 0.93 (0.83 to 1.03) | 0.81 ± 0.03 |" in page
    assert "| length | **0.92 (0.82 to 1.02)** | **0.95 (0.85 to 1.05)** | **0.92 ± 0.04** |" in page
    assert "No figure for ILEED on hopper: the actions are continuous" in page
    assert 'Goal "AUROC on hopper >= 0.950": missed, ours 0.930.' in page
    assert (
        'Goal "R² on hopper >= 0.640, which is what training on the truly good gives, less .03": reached, ours 0.660.'
        in page
    )
    assert "Goal for R² on other: not measured." in page
    assert "of 11 bad 1 typical, 2 open and 8 unlike" in page
    assert "| cramped room | **0.770 (0.750 to 0.790)** | 0.750" in page


def test_page_names_a_win_on_real_data():
    from results import results

    page = results({"real": real_result(ours=0.97, peer=0.80)})
    assert "reached, ours 0.970, best peer 0.800 (length)" in page
    assert "Not the best on cramped room" not in page
    assert "not surely" not in page
    assert "| rpil | **0.97 (0.87 to 1.07)** | 0.93 (0.83 to 1.03) | **0.97 ± 0.03** |" in page


def policy(mean: float, **more: object) -> dict:
    return {
        "mean": mean,
        "half_width": 2.0,
        "worst": mean - 9,
        "paper_way": {"mean": mean + 1, "half_width": 3.0},
    } | more


def paper_result() -> dict:
    policies = {
        "expert": policy(265.0),
        "raw trust all": policy(-160.0, printed=-22.24),
        "trust all": policy(-180.0),
        "paper's recipe": policy(160.0, printed=195.06, wrong=3),
        "rpil": policy(190.0, wrong=1),
        "ILEED": policy(191.5),
        "oracle": policy(191.0),
    }
    of = {"table": 3, "env": "LunarLander-v3", "kind": "corrupted", "draws": 20, "seeds": [0, 1], "verdicts": 400}
    how = {"rollouts": 100, "features": "spline", "provenance": ORIGIN}
    return how | {"tables": [of | {"policies": policies}], "draws": []}


def test_page_names_a_loss_in_the_paper():
    from results import results

    page = results({"paper": paper_result()})
    assert (
        "Table 3, LunarLander-v3 corrupted: above ours (190.0 ± 2.0): ILEED 191.5 ± 2.0, oracle 191.0 ± 2.0 and the "
        "paper's print of paper's recipe 195.06." in page
    )
    assert "| ILEED | **191.5 ± 2.0** |" in page
    assert "| rpil | 190.0 ± 2.0 |" in page
    assert "| expert | 265.0 ± 2.0 |" in page  # competes with nobody
    assert "Wrong verdicts of rpil: 1 of 400 in table 3." in page
    assert "| paper's recipe, printed | 195.06 |" in page
    assert ORIGIN["commit"] in page


def test_no_method_above_gives_one_line():
    from results import behind_in_paper

    found = paper_result()["tables"]
    found[0]["policies"]["rpil"]["mean"] = 196.0
    assert len(behind_in_paper(found)) == 1
    assert "above ours (" not in behind_in_paper(found)[0]


def cell(kind: str, share: int, mean: float, auroc: float, wrong: float, missed: list[str], ambiguous: int = 0) -> dict:
    found = {"env": "Acrobot-v1", "kind": kind, "share": share, "unknowable": kind == "shift", "missed": missed}
    found |= {"return": {"mean": mean}, "auroc": {"mean": auroc}, "wrong": {"mean": wrong}}
    return found | {"ambiguous": ambiguous, "unlabelled_draws": 10}


def grid_result() -> dict:
    cells = [
        cell("noisy", 50, 1.0, 1.0, 0.0, []),
        cell("noisy", 90, 0.912, 0.97, 0.045, ["return", "AUROC", "verdicts"]),
        cell("shift", 50, 0.99, 1.0, 0.0, ["ambiguous"], ambiguous=9),
    ]
    methods = [
        {"method": name, "auroc": {"mean": auroc, "worst": auroc - 0.1}, "normalised": {"mean": auroc, "worst": worst}}
        for name, auroc, worst in (("rpil", 0.98, 0.7), ("oracle", 1.0, 1.0), ("RM-ENT", 0.95, 0.8))
    ]
    configuration = {"features": "spline", "n_good": 10, "rollouts": 100, "code": "0"}
    found = {"reached": False, "missing": 2, "cells": cells, "methods": [*methods, copy.deepcopy(methods[2])]}
    found["methods"][3] |= {"method": "length", "normalised": None}
    return found | {"configuration": configuration, "draws": 10, "first_seed": 1000}


def test_page_names_the_missed_cells_of_the_grid():
    from results import results

    page = results({"robustness": grid_result()})
    assert "Goal for normalised return: missed in 1 of 3 cells: Acrobot-v1 noisy 90 % (0.912)." in page
    assert "Goal for wrong verdicts: missed in 1 of 3 cells: Acrobot-v1 noisy 90 % (4.5%)." in page
    assert "Goal for “ambiguous” in every draw: missed in 1 of 1 cells: Acrobot-v1 shift 50 % (9 of 10 draws)." in page
    assert "2 pieces of work failed or are not done." in page
    assert "| Acrobot-v1 | 50 % | 1.00 / 1.000 / 0.0% | 0.99 / 1.000 / 0.0%*† |" in page
    assert "| Acrobot-v1 | 90 % | 0.91 / 0.970 / 4.5%† |  |" in page
    assert "Not the best in normalised return, worst: ours 0.700, RM-ENT 0.800." in page
    assert "Not the best in AUROC" not in page  # the oracle does not count
    assert "was not recorded" in page


def test_page_names_the_missed_goals_of_acceptance():
    from results import results

    def played(kind: str, behind: float, missed: list[str]) -> dict:
        returns = {"oracle": {"mean": 141.1, "se": 2.0}, "rpil": {"mean": 141.1 - behind, "se": 2.0}}
        returns["trust_all"] = {"mean": -196.2, "se": 20.6}
        found = {"env": "LunarLander-v3", "kind": kind, "features": "raw", "draws": 10, "wrong": 0, "seconds": 0.5}
        return found | {"auroc": 1.0, "behind": behind, "missed": missed} | returns

    partly = {"env": "LunarLander-v3", "kind": "noisy", "features": "raw", "draws": 10, "wrong": 0, "auroc": 0.991}
    shift = partly | {
        "kind": "shift",
        "auroc": 0.2,
        "ambiguous": 9,
        "both": 10,
        "auroc_answered": 0.98,
        "missed": ["ambiguous"],
    }
    cells = [played("corrupted", 0.0, []), played("random", 3.5, ["return"]), partly | {"missed": []}, shift]
    page = results({"acceptance": {"cells": cells}})
    assert "random, raw: missed return (3.5 behind the oracle, whose standard error is 2.0)." in page
    assert "shift, raw: missed ambiguous (ambiguous in 9 of 10 draws)." in page
    assert "corrupted, raw: missed" not in page
    assert "1 cells: AUROC 0.991 in the worst draw." in page
    assert "holds one of either half in 10; with its answer, AUROC 0.980 in the worst draw." in page
    assert "| LunarLander-v3 | random | raw | 0 | **137.6 ± 2.0** | -196.2 ± 20.6 | 141.1 ± 2.0 |" in page


def test_every_section_has_its_provenance(tmp_path, capsys):
    from results import main

    paths = {}
    for name, result in {"real": real_result(), "robustness": grid_result(), "paper": paper_result()}.items():
        paths[name] = tmp_path / f"{name}.json"
        paths[name].write_text(json.dumps(result))
    main([word for name, path in paths.items() for word in (f"--{name}", str(path))])
    page = capsys.readouterr().out
    assert re.findall("^## (.*)$", page, re.MULTILINE) == ["The paper's tables", "Robustness", "Real demonstrations"]
    line = "*commit 0123456789ab, 2026-01-02, seeds 0; 2 cores, Linux x86_64, Python 3.11.7, numpy 2.0.0.*"
    assert page.endswith(line + "\n")


def test_the_grid_has_a_second_section_for_continuous_actions(tmp_path, capsys):
    from results import main

    discrete, continuous = tmp_path / "discrete.json", tmp_path / "continuous.json"
    discrete.write_text(json.dumps(grid_result()))
    other = grid_result()
    other["cells"] = [cell("window", 75, 0.875, 1.0, 0.0, ["return"]) | {"env": "Pendulum-v1"}]
    continuous.write_text(json.dumps(other))
    main(["--robustness-continuous", str(continuous), "--robustness", str(discrete)])
    first, second = capsys.readouterr().out.split("## Robustness, continuous actions")
    assert "| Acrobot-v1 | 90 % |" in first
    assert "Pendulum-v1" not in first
    assert "| Pendulum-v1 | 75 % | 0.88 / 1.000 / 0.0%† |" in second
    assert "Acrobot" not in second


def test_other_files_give_a_message(tmp_path, capsys):
    from results import main

    broken, other = tmp_path / "broken.json", tmp_path / "other.json"
    broken.write_text("{")
    other.write_text("{}")
    cases = [
        (["--real", str(broken)], "broken.json: no figures"),
        (["--real", str(tmp_path / "absent.json")], "absent.json: no figures"),
        (["--real", str(other)], "The figures of real.py have no 'sets'; run real.py of this version."),
        ([], "No figures were given"),
    ]
    for arguments, message in cases:
        with pytest.raises(SystemExit):
            main(arguments)
        assert message in capsys.readouterr().err


def test_provenance_names_the_commit_and_no_machine():
    import platform

    from provenance import line, provenance

    found = provenance("1000 to 1009")
    command = ["git", "-C", str(BENCHMARKS), "rev-parse", "HEAD"]
    head = subprocess.run(command, capture_output=True, text=True, check=False).stdout.strip()
    assert (found["commit"] or "") == head[:12]
    assert found["python"] == platform.python_version()
    assert "numpy" in found["packages"]
    written = json.dumps(found) + line(found)
    assert "/" not in written
    assert "\\" not in written
    if len(platform.node()) > 3:
        assert platform.node() not in written
    assert "seeds 1000 to 1009" in line(found)
    assert "with uncommitted changes" in line(found | {"dirty": True})
    assert sys.executable not in written
