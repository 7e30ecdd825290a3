"""Write the saved models of ``tests/golden``, and what they must say: ``python tools/make_golden.py [FOLDER]``.

A file for every estimator, adversary, kind of features and kind of actions, fitted to a dozen short demonstrations;
``expected.json`` has, for each, what it says of 12 observations that it was not fitted to, and its audit. Run it anew
only where the format of saved files is meant to change: the files are there to find out where it was not.
"""

from __future__ import annotations

import json
import sys
import warnings
from pathlib import Path
from typing import Any

import numpy as np
from cases import CONTINUOUS, DISCRETE
from threadpoolctl import threadpool_limits
from zoo import toy

import rpil

GOLDEN = Path(__file__).parents[1] / "tests" / "golden"
GIVEN = [[0.1, 0.1, 0.8], [0.2, 0.6, 0.2], [0.8, 0.1, 0.1]]
LABELS = {"d0": "good", "d11": "bad"}
FEATURES = ("folded", "nystroem")


def models(continuous: bool) -> dict[str, Any]:
    """Name -> a fitted estimator."""
    data, rival = (toy(kind, continuous, 7, 5, 8) for kind in ("random", "flipped"))
    unfitted = {
        "cloning": rpil.BehavioralCloning(C=3.0),
        "rment": rpil.RMEnt(n_trusted=7, n_starts=3),
        "judge": rpil.RPIL(),
        "judge of two groups": rpil.RPIL(random_state=5),
        "mixture expert_only": rpil.RPIL(
            adversary="uniform",
            settings=rpil.Settings(mixture=rpil.MixtureSettings(m_step="expert_only", prior=(3.0, 2.0))),
            features="folded",
        ),
    }
    unfitted |= {f"cloning {kind}": rpil.BehavioralCloning(features=kind) for kind in FEATURES}
    unfitted |= {f"mixture {name}": rpil.RPIL(adversary=name) for name in (CONTINUOUS if continuous else DISCRETE)}
    if not continuous:
        unfitted["mixture given confusion"] = rpil.RPIL(adversary=rpil.Confusion.given(GIVEN))
    found = {name: model.fit(rival if "groups" in name else data) for name, model in unfitted.items()}
    found["judge with answers"] = rpil.RPIL().fit(
        data, labels={"d0": "better than d11"}, outcome={"d1": 1.0, "d10": 0.0}
    )
    with_labels = rpil.RPIL(features="nystroem", settings=rpil.Settings(judge_features="folded"))
    found["judge with labels"] = with_labels.fit(data, labels=LABELS)
    people = [f"person {m % 3}" for m in range(len(data))]
    found["judge of people"] = rpil.RPIL().fit(data, demonstrators=people)
    groups = np.array([m + 100 for m in range(len(data))])[data.groups]
    words = data.actions if continuous else np.array(["left", "nothing", "right"])[data.actions]
    found["judge of arrays"] = rpil.RPIL().fit(data.observations, words, groups=groups)
    return found


def outputs_of(model: Any, rows: np.ndarray) -> dict[str, Any]:
    """What `test_golden.py` compares."""
    found = {"class": type(model).__name__, "predict": model.predict(rows).tolist()}
    if len(model.classes_):
        found["predict_proba"] = model.predict_proba(rows).tolist()
    return found


def main() -> None:
    folder = Path(sys.argv[1]) if len(sys.argv) > 1 else GOLDEN
    folder.mkdir(parents=True, exist_ok=True)
    rows = np.random.default_rng(11).normal(size=(12, 2))
    expected: dict[str, Any] = {}
    warnings.simplefilter("ignore")
    with threadpool_limits(1):
        for action in ("discrete", "continuous"):
            for name, model in models(action == "continuous").items():
                file = f"{action} {name}.rpil".replace(" ", "_")
                rpil.save(model, folder / file)
                expected[file] = outputs_of(rpil.load(folder / file), rows)
    text = json.dumps({"observations": rows.tolist(), "models": expected}, ensure_ascii=False)
    (folder / "expected.json").write_text(text.replace('}, "', '},\n"') + "\n", encoding="utf-8")
    print(f"{len(expected)} models, {sum(path.stat().st_size for path in folder.iterdir())} bytes in all")


if __name__ == "__main__":
    main()
