"""Fits of every kind through the public API of `rpil` alone: `CASES`, functions of an empty folder, by name."""

from __future__ import annotations

import os
import subprocess
import sys
import tomllib
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from sklearn.ensemble import RandomForestRegressor
from sklearn.linear_model import LogisticRegression
from sklearn.pipeline import make_pipeline
from sklearn.preprocessing import StandardScaler
from zoo import answers, audited, described, many, simulated, toy

import rpil

Array = NDArray[Any]

DISCRETE = ("constant", "uniform", "marginal", "complement", "normalised complement", "confusion", "own policy")
CONTINUOUS = ("uniform", "marginal", "own policy")


def mixture(**chosen: Any) -> rpil.Settings:
    """Settings of the mixture alone."""
    return rpil.Settings(mixture=rpil.MixtureSettings(**chosen))


FEATURES = ("raw", "folded", "nystroem", "auto")
ENVIRONMENTS = {
    "MountainCar-v0": ("corrupted", "random", "flip", "shift", "noisy", "window", "sensor"),
    "Acrobot-v1": ("flip", "corrupted"),
    "LunarLander-v3": ("shift", "corrupted"),
}


def fit(make: Callable[[], Any], data: Callable[[], Any], folder: Path, **given: Any) -> dict[str, Array]:
    return described(make().fit(data(), **given), data(), folder)


def rows(continuous: bool, folder: Path) -> dict[str, Array]:
    """X, y, groups, the actions being text where they are discrete, in single precision, out of order."""
    data = toy("random", continuous)
    order = np.random.default_rng(3).permutation(data.n_steps)
    x, groups = data.observations.astype(np.float32)[order], np.array(data.ids)[data.groups][order]
    y = data.actions[order] if continuous else np.array(["left", "none", "right"])[data.actions[order]]
    model = rpil.RPIL(random_state=3).fit(x, y, groups=groups)
    return described(model, rpil.Demonstrations.from_groups(x, y, groups), folder)


def streamed(continuous: bool, folder: Path, labels: Any = None, engine: Any = None) -> dict[str, Array]:
    """The same from disk."""
    rpil.write(folder / "many.parquet", many(continuous))
    data = rpil.open(folder / "many.parquet", on_disk=True).demonstrations
    return described(rpil.RPIL(engine=engine).fit(data, labels=labels), many(continuous), folder)


def on_dask(folder: Path) -> dict[str, Array]:
    from distributed import Client, LocalCluster

    options = {"n_workers": 1, "threads_per_worker": 1, "processes": False, "dashboard_address": None}
    with LocalCluster(**options) as cluster, Client(cluster, set_as_default=False) as client:
        return streamed(False, folder, engine=rpil.DaskEngine(client, n_shards=3))


def log_prob(weights: Array, x: Array, actions: Array) -> Array:
    logits = np.c_[x, np.ones(len(x))] @ weights
    return (logits - np.logaddexp.reduce(logits, axis=1)[:, None])[np.arange(len(x)), actions]


def ascend(weights: Array, x: Array, actions: Array, trust: Array) -> Array:
    rows = np.c_[x, np.ones(len(x))]
    for _ in range(20):
        proba = np.exp(log_prob(weights, np.repeat(x, 3, axis=0), np.tile(np.arange(3), len(x)))).reshape(-1, 3)
        weights = weights + 2.0 * rows.T @ (trust[:, None] * (np.eye(3)[actions] - proba)) / trust.sum()
    return weights


def reweighted(kind: str, folder: Path, **given: Any) -> dict[str, Array]:
    found = rpil.reweight(np.zeros((3, 3)), toy(kind), log_prob=log_prob, train=ascend, **given)
    return audited(found.audit) | {"policy": found.policy, "n_rounds": np.array([found.n_rounds, found.converged])}


def answered(folder: Path) -> dict[str, Array]:
    found = rpil.RPIL().fit(toy("noisy")).audit_
    return audited(found.answered({"d0": "good", "d1": "good", "d2": "bad", "d13": "bad", "d15": "bad"}))


def files(folder: Path) -> dict[str, Array]:
    found = {}
    for continuous in (False, True):
        for suffix in ("npz", "csv", "parquet"):
            path = folder / f"data.{suffix}"
            rpil.write(path, toy("random", continuous), {"is_good": np.arange(20) < 12})
            for how in ("read", "open_dataset")[: 2 if suffix == "parquet" else 1]:
                data = rpil.read(path) if how == "read" else rpil.open(path, on_disk=True).demonstrations
                name = f"{suffix} {'continuous' if continuous else 'discrete'} {how}"
                data = data if isinstance(data, rpil.Demonstrations) else data.select(slice(None))
                found |= {f"{name} {part}": getattr(data, part) for part in ("observations", "actions", "offsets")}
                found[f"{name} names"] = np.array([*data.ids, *data.observation_names])
    return found


def played(env_id: str, kind: str, folder: Path) -> dict[str, Array]:
    model = rpil.BehavioralCloning(features="folded").fit(simulated(env_id, kind))
    return {"returns": rpil.rollout(model, env_id, n_episodes=4, seed=0).returns}


def refused(folder: Path) -> dict[str, Array]:
    """What is messages of mistakes."""
    data, continuous = toy("random"), toy("random", True)
    wrong: dict[str, Callable[[], Any]] = {
        "label": lambda: rpil.RPIL().fit(data, labels={"d99": "good"}),
        "label word": lambda: rpil.RPIL().fit(data, labels={"d0": "good"}),
        "adversary": lambda: rpil.RPIL(adversary="evil").fit(data),
        "adversary of the other kind": lambda: rpil.RPIL(adversary="complement").fit(continuous),
        "m_step": lambda: rpil.RPIL(settings=mixture(m_step="both")).fit(data),
        "features": lambda: rpil.RPIL(features="deep").fit(data),
        "one": lambda: rpil.RPIL().fit(data.select([0])),
        "demonstrators": lambda: rpil.RPIL().fit(data, demonstrators=["a"]),
        "matrix": lambda: rpil.Confusion.given([[1.0, 1.0], [0.0, 1.0]]),
        "n_trusted": lambda: rpil.RMEnt(n_trusted=99).fit(data),
        "weight": lambda: rpil.BehavioralCloning().fit(data, sample_weight=np.zeros(data.n_steps)),
        "read": lambda: rpil.read("nowhere.npz"),
        "format": lambda: rpil.read("demonstrations.txt"),
        "load": lambda: rpil.load("nowhere.rpil"),
        "dataset": lambda: rpil.open("nowhere.parquet", on_disk=True),
        "environment": lambda: rpil.simulate("Nowhere-v0", "flip", n_good=1, n_bad=1, seed=0),
        "kind": lambda: rpil.simulate("MountainCar-v0", "odd", n_good=1, n_bad=1, seed=0),
    }
    messages = {}
    for name, call in wrong.items():
        try:
            call()
            messages[name] = np.array("nothing")
        except Exception as error:
            messages[name] = np.array(f"{type(error).__name__}: {error}")
    return messages


def commanded(words: str, kind: str, folder: Path) -> dict[str, Array]:
    """What the command prints, and what is in the files that it writes."""
    rpil.write(folder / "data.npz", simulated("MountainCar-v0", kind))
    scripts = tomllib.loads((Path(rpil.__file__).parents[2] / "pyproject.toml").read_text())["project"]["scripts"]
    module, _, main = scripts["rpil"].partition(":")  # of the code to test, whatever is installed
    code = f"import sys; from {module} import {main} as main; sys.argv[0] = 'rpil'; main()"
    command = [sys.executable, "-c", code, *words.split()]
    done = subprocess.run(command, cwd=folder, capture_output=True, text=True, env=os.environ | {"COLUMNS": "100"})
    if done.returncode:
        raise RuntimeError(done.stderr[-500:])
    found = {"stdout.json" if "json" in words else "stdout": np.array(done.stdout)}
    for path in folder.iterdir():
        if path.suffix == ".html":
            lines = path.read_text().splitlines()
            found["report"] = np.array([line for line in lines if "<dt>Time</dt>" not in line])
        elif path.suffix == ".csv":
            found["weights"] = np.genfromtxt(path, delimiter=",", skip_header=1)
            found["columns"] = np.array(path.read_text().splitlines()[0])
        elif path.suffix == ".rpil":
            found |= answers(rpil.load(path), simulated("MountainCar-v0", kind))
    return found


CASES: dict[str, Callable[[Path], dict[str, Array]]] = {"files": files, "mistakes": refused, "answered": answered}


def add(name: str, make: Callable[[], Any], data: Callable[[], Any], **given: Any) -> None:
    CASES[name] = partial(fit, make, data, **given)


for env_id, kinds in ENVIRONMENTS.items():
    for kind in kinds:
        add(f"default {env_id} {kind}", rpil.RPIL, partial(simulated, env_id, kind))
        if kind == kinds[0]:
            CASES[f"rollout {env_id}"] = partial(played, env_id, kind)
for continuous, action in ((False, "discrete"), (True, "continuous")):
    noisy, rival = partial(toy, "noisy", continuous), partial(toy, "flipped", continuous, 12, 9)
    for kind in ("random", "flipped", "noisy", "none"):
        add(f"default {action} {kind}", rpil.RPIL, partial(toy, kind, continuous))
    add(f"two groups {action}", rpil.RPIL, rival)
    add(f"two groups, pair {action}", rpil.RPIL, rival, labels={"d0": "better than d15"})
    add(f"labels {action}", rpil.RPIL, rival, labels={"d0": "good", "d15": "bad"})
    add(f"one label {action}", rpil.RPIL, noisy, labels={"d2": "bad"})
    add(f"demonstrators {action}", rpil.RPIL, noisy, demonstrators=[f"p{m // 4}" for m in range(20)])
    add(f"demonstrators by id {action}", rpil.RPIL, noisy, demonstrators={f"d{m}": m % 3 for m in range(15)})
    add(f"one step each {action}", rpil.RPIL, partial(toy, "random", continuous, 120, 80, 1))
    add(f"C {action}", partial(rpil.RPIL, C=0.5, random_state=7), noisy)
    CASES[f"rows {action}"] = partial(rows, continuous)
    for features in FEATURES:
        add(f"features {features} {action}", partial(rpil.RPIL, features=features), noisy)
        add(f"cloning {features} {action}", partial(rpil.BehavioralCloning, features=features), noisy)
    add(
        f"judge_features {action}",
        partial(rpil.RPIL, features="auto", settings=rpil.Settings(judge_features="nystroem")),
        noisy,
    )
    for adversary in CONTINUOUS if continuous else DISCRETE:
        for m_step in ("joint", "expert_only"):
            for kind in ("random", "flipped"):
                make = partial(rpil.RPIL, adversary=adversary, settings=mixture(m_step=m_step))
                add(f"adversary {adversary} {m_step} {action} {kind}", make, partial(toy, kind, continuous))
    for prior in (0.6, (3.0, 2.0)):
        make = partial(rpil.RPIL, adversary="marginal", settings=mixture(prior=prior), features="nystroem")
        add(f"prior {prior} {action}", make, noisy, labels={"d0": "good", "d14": "bad"})
    add(f"RMEnt {action}", rpil.RMEnt, noisy)
    add(f"RMEnt n_trusted {action}", partial(rpil.RMEnt, n_trusted=11, n_starts=30, features="auto"), noisy)
    CASES[f"large {action}"] = partial(fit, rpil.RPIL, partial(many, continuous))
    CASES[f"large streamed {action}"] = partial(streamed, continuous)
given = [[0.1, 0.1, 0.8], [0.2, 0.6, 0.2], [0.8, 0.1, 0.1]]
add("adversary given confusion", lambda: rpil.RPIL(adversary=rpil.Confusion.given(given)), partial(toy, "flipped"))
add(
    "mixture MountainCar", partial(rpil.RPIL, adversary="complement"), partial(simulated, "MountainCar-v0", "corrupted")
)
add("RMEnt MountainCar", partial(rpil.RMEnt, n_trusted=12), partial(simulated, "MountainCar-v0", "noisy"))
add("features auto LunarLander", partial(rpil.RPIL, features="auto"), partial(simulated, "LunarLander-v3", "corrupted"))
logistic = make_pipeline(StandardScaler(), LogisticRegression())
forest = RandomForestRegressor(n_estimators=10, min_samples_leaf=5, random_state=0)
add("policy classifier", partial(rpil.RPIL, policy=logistic), partial(toy, "noisy"))
add("policy regressor", partial(rpil.RPIL, policy=forest), partial(toy, "noisy", True))
CASES["large streamed labels"] = partial(streamed, False, labels={"d0": "good", "d2000": "bad"})
CASES["large demonstrators"] = partial(fit, rpil.RPIL, many, demonstrators=[f"p{m // 30}" for m in range(2100)])
CASES["large dask"] = on_dask
CASES["reweight"] = partial(reweighted, "random")
CASES["reweight one fold"] = partial(reweighted, "noisy", n_folds=1, max_rounds=5)
CASES["reweight labels"] = partial(reweighted, "flipped", labels={"d0": "good"})
report = "audit data.npz --report report.html --weights weights.csv"
CASES["command audit"] = partial(commanded, report, "corrupted")
CASES["command audit json"] = partial(commanded, "audit data.npz --format json", "noisy")
CASES["command fit"] = partial(commanded, "fit data.npz -o policy.rpil", "window")
