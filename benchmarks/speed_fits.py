"""Rows A, B and D: fits in memory, scikit-learn beside."""

from __future__ import annotations

import sys
import warnings
from dataclasses import dataclass
from functools import partial

import numpy as np
from sklearn.exceptions import ConvergenceWarning
from sklearn.linear_model import LogisticRegression
from sklearn.metrics import roc_auc_score

from rpil import Settings
from rpil.data.demonstrations import Demonstrations
from rpil.estimators.rpil import RPIL
from rpil.numerics import blocks as passes
from rpil.numerics.types import Array
from rpil.policies.features import FeatureMap, FeatureSettings, ridge_of
from speed_common import Measured, Planted, in_turns, lander, one_core, softmax_expert

_ROWS = 1 << 16
_STARTS = 20
ENOUGH = 2.0
"""Norms that differ by less than this factor count as the same."""


def plain(size: dict[str, int], repeats: int) -> Measured:
    """A: a whole fit, features given, over one plain logistic regression on all steps, both to one gradient norm."""
    data = softmax_expert(size["steps"], size["features"], size["actions"])
    return _over_scikit_learn(data, "raw", repeats, ("lbfgs",))


def ill_conditioned(size: dict[str, int], repeats: int) -> Measured:
    """B: Nystroem's features of LunarLander, half of the demonstrations corrupted; scikit-learn gets the same."""
    data = lander(size["demonstrations"] // 2, size["demonstrations"] // 2)
    return _over_scikit_learn(data, "nystroem", repeats, ("lbfgs", "newton-cg"))


def _over_scikit_learn(data: Planted, kind: str, repeats: int, solvers: tuple[str, ...]) -> Measured:
    """Whole fits of ours over plain ones on the same columns, which go on until the gradient is what ours left.

    Single precision may be too coarse for that. Then the ratio is over the fit in double precision, and the one over
    the fit that stopped short is among the details.
    """
    demonstrations = data.demonstrations
    codes = np.unique(demonstrations.actions, return_inverse=True)[1]
    single = demonstrations.observations.dtype == np.float32
    features = FeatureMap.fit(kind, demonstrations.observations, settings=FeatureSettings())
    double = features.design(demonstrations.observations)
    with one_core():
        seconds, models = in_turns(repeats, ours=lambda: _given(kind).fit(demonstrations))
        model = models["ours"]
        goal = final_norm(model, demonstrations, codes)
        ridge = ridge_of(features, None, len(codes), model.space_)
        runs = {solver: partial(plain_fit, double, codes, ridge, goal, solver) for solver in solvers}
        if single:
            runs = {  # newton-cg of scikit-learn 1.6 takes no single precision
                f"{solver}, single precision": partial(plain_fit, double.astype(np.float32), codes, ridge, goal, solver)
                for solver in solvers
                if solver != "newton-cg"
            } | runs
        theirs, plain = in_turns(repeats, **runs)
    seconds |= theirs
    reached = {name: fit.norm <= ENOUGH * goal for name, fit in plain.items()}
    over = {name: seconds["ours"] / seconds[name] for name in plain}
    best = {}
    for solver in solvers:  # the faster of those that reached it
        arrived = [name for name in plain if name.startswith(solver) and reached[name]]
        best[solver] = min(arrived, key=lambda name: seconds[name], default=solver)
    letter = "A" if kind == "raw" else "B"
    values = {letter if solver == "lbfgs" else f"{letter}_newton_cg": over[best[solver]] for solver in solvers}
    details = {
        "seconds": seconds,
        "over": over,
        "gradient_norms": {"ours": goal} | {name: fit.norm for name, fit in plain.items()},
        "compared_with": best,
        "same_norm": all(reached[name] for name in best.values()),
        "auroc": auroc(model, data),
        "iterations": {"rounds of the judge": model.n_iter_} | {name: fit.iterations for name, fit in plain.items()},
        "shape": [*double.shape, len(model.classes_)],
    }
    if not details["same_norm"]:
        print(f"  {letter}: not the same norm, {details['gradient_norms']}", file=sys.stderr)
    return Measured(values, details)


@dataclass(frozen=True)
class Plain:
    """Where scikit-learn stopped: gradient norm, and iterations of all its starts."""

    norm: float
    iterations: int


def plain_fit(design: Array, codes: Array, ridge: Array, goal: float, solver: str) -> Plain:
    """scikit-learn on the same columns with the same ridge, until the gradient norm is `goal` or nothing is gained.

    Its lbfgs also stops where one iteration gains next to nothing, long before the gradient is small if the columns are
    ill-conditioned; so it starts again from where it stopped as long as that helps.
    """
    model = LogisticRegression(C=1 / ridge[0], solver=solver, tol=goal, max_iter=10_000, warm_start=True)
    norm, before, iterations = np.inf, np.inf, 0
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", ConvergenceWarning)
        warnings.filterwarnings("ignore", "(?i).*line search")  # where single precision has no more digits
        for _ in range(_STARTS):
            model.fit(design[:, :-1], codes)
            weights = np.vstack([model.coef_.T, model.intercept_])
            norm = gradient_norm(design, codes, np.ones(len(codes)), ridge, weights)
            iterations += int(model.n_iter_.max())
            if norm <= ENOUGH * goal or norm > 0.9 * before:
                break
            before = norm
    return Plain(norm, iterations)


def _given(kind: str) -> RPIL:
    return RPIL(features=kind, settings=Settings(judge_features=kind))


def auroc(model: RPIL, data: Planted) -> float:
    """How well log-odds tell good demonstrations from bad ones."""
    return float(roc_auc_score(data.is_good, model.audit_.log_odds))


def final_norm(model: RPIL, demonstrations: Demonstrations, codes: Array) -> float:
    """The gradient norm at the policy that a fit returns, for the weights of steps that it was refitted with."""
    weight = model.audit_.step_weight
    ridge = ridge_of(model.features_, model.C, weight.sum(), model.space_)
    design = model.features_.design(demonstrations.observations)
    return gradient_norm(design, codes, weight, ridge, model.policy_.weights)


def gradient_norm(design: Array, codes: Array, weight: Array, ridge: Array, weights: Array) -> float:
    """Largest entry of the gradient of the penalised loss, over the total weight, in double precision.

    The loss is -sum_n weight_n log softmax(x_n W)[code_n] + 1/2 sum_d ridge_d |W_d|^2; nothing of ours computes it.
    """
    total = ridge[:, None] * weights
    for start in range(0, len(codes), _ROWS):
        rows = slice(start, start + _ROWS)
        x = design[rows].astype(float)
        logits = x @ weights
        residual = np.exp(logits - logits.max(axis=1, keepdims=True))
        residual /= residual.sum(axis=1, keepdims=True)
        residual[np.arange(len(x)), codes[rows]] -= 1.0
        total = total + x.T @ (weight[rows, None] * residual)
    return float(np.abs(total).max() / weight.sum())


def one_pass(size: dict[str, int], repeats: int) -> Measured:
    """D: objective, gradient and log-likelihood of each demonstration over the two matrix products they need."""
    data = softmax_expert(size["steps"], size["features"], size["actions"]).demonstrations
    design = FeatureMap.fit("raw", data.observations, settings=FeatureSettings()).design(data.observations, single=True)
    rng = np.random.default_rng(0)
    weights = rng.normal(size=(design.shape[1], size["actions"])) / np.sqrt(design.shape[1])
    weight = rng.random(len(data.actions))
    targets = np.zeros((len(data.actions), size["actions"]))
    np.put_along_axis(targets, data.actions[:, None], weight[:, None], axis=1)
    single, residual = weights.astype(np.float32), targets.astype(np.float32)

    def ours() -> tuple[float, Array, Array]:
        taken, slope = passes.softmax_pass(design, weights, data.actions, weight)
        return float(weight @ taken), slope, np.add.reduceat(taken, data.offsets[:-1])

    with one_core():
        seconds, _ = in_turns(repeats + 2, ours=ours, bare=lambda: (design @ single, design.T @ residual))
    return Measured({"D": seconds["ours"] / seconds["bare"]}, {"seconds": seconds, "shape": list(design.shape)})
