"""Small seeded demonstrations, and all that is public of what was fitted to them, as arrays by name."""

from __future__ import annotations

import json
from dataclasses import fields
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

import rpil

Array = NDArray[Any]

ROWS = 2000
"""Observations, at most, of which a policy is asked."""

FITTED = ("expert_proba_", "classes_", "lower_bound_", "objective_", "n_iter_")
FITTED += ("converged_", "ids_", "weights_", "log_likelihood_")


@cache
def simulated(env_id: str, kind: str) -> Any:
    made = rpil.simulate(env_id, kind, n_good=12, n_bad=8, seed=1)
    return rpil.Demonstrations.from_episodes(made.episodes)


@cache
def toy(kind: str, continuous: bool = False, n_good: int = 12, n_bad: int = 8, steps: int = 30, seed: int = 0) -> Any:
    """A softmax expert of 3 actions, or a linear one of 2, of 2 observations; then what acts at "random", "flipped",
    half "noisy", or the same ("none")."""
    rng = np.random.default_rng(seed)
    lengths = rng.integers(steps - steps // 3, steps + steps // 3, size=n_good + n_bad, endpoint=True)
    n = int(lengths.sum())
    x = rng.normal(size=(n, 2))
    chosen = np.c_[x, np.ones(n)] @ rng.normal(size=(3, 2 if continuous else 3)) * (1.0 if continuous else 4.0)
    actions = (
        chosen + 0.2 * rng.normal(size=chosen.shape) if continuous else (chosen + rng.gumbel(size=(n, 3))).argmax(1)
    )
    anything = rng.uniform(-3.0, 3.0, size=actions.shape) if continuous else rng.integers(3, size=n)
    half = (rng.random(n) < 0.5)[:, None] if continuous else rng.random(n) < 0.5
    flipped = -actions if continuous else 2 - actions
    spoiled = {"random": anything, "flipped": flipped, "noisy": np.where(half, anything, actions), "none": actions}[
        kind
    ]
    bad = np.repeat(np.arange(n_good + n_bad) >= n_good, lengths)
    actions = np.where(bad[:, None] if continuous else bad, spoiled, actions)
    ids = [f"d{m}" for m in range(n_good + n_bad)]
    return rpil.Demonstrations(x, actions, np.append(0, np.cumsum(lengths)), ids, observation_names=["x", "v"])


def many(continuous: bool = False) -> Any:
    """So much that the judge reads a sample."""
    return toy("noisy", continuous, 1400, 700, 100)


def audited(audit: Any) -> dict[str, Array]:
    """Every field of an audit, as numbers or text."""
    found = {}
    for name in (field.name for field in fields(audit)):
        value = getattr(audit, name)
        if name not in ("prior", "demonstrators"):  # to_dict has these as numbers
            found[name] = np.asarray(value if isinstance(value, np.ndarray) or name == "verdicts" else repr(value))
    found |= {"to_dict.json": np.array(json.dumps(audit.to_dict())), "ranking": audit.ranking()}
    return {f"audit.{k}": v for k, v in (found | {"suggested": np.array(audit.suggest_labels(4))}).items()}


def answers(model: Any, data: Any) -> dict[str, Array]:
    """What a fitted model says of demonstrations."""
    some = data.select(slice(0, max(2, int(np.searchsorted(data.offsets, ROWS)))))
    rows, actions = some.observations, some.actions
    found = {"predict": model.predict(rows), "log_prob": model.log_prob(rows, actions)}
    if len(model.classes_):
        found["predict_proba"] = model.predict_proba(rows)
    return found | {"score": np.array(model.score(rows, actions))}


def described(model: Any, data: Any, folder: Path) -> dict[str, Array]:
    """All of a fitted model; that it can be saved, and comes back the same."""
    found = {name: np.asarray(getattr(model, name)) for name in FITTED if hasattr(model, name)} | answers(model, data)
    found |= {"features_.kind": np.array(model.features_.kind)}
    found |= audited(model.audit_) if isinstance(model, rpil.RPIL) else {}
    try:
        rpil.save(model, folder / "saved")
    except rpil.DataError as error:
        return found | {"saved": np.array(str(error).partition(": ")[2])}
    back = rpil.load(folder / "saved")
    same = all(np.array_equal(a, found[k]) for k, a in answers(back, data).items())
    return found | {"saved": np.array(f"comes back: {same}")}
