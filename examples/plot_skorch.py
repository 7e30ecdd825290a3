"""
Trust around a network of skorch
================================

`skorch <https://skorch.readthedocs.io>`_ makes a network a scikit-learn estimator, and so a policy. The judge fits
copies of it to parts of the demonstrations, so that no network scores a demonstration that it has memorised. A policy
gets its weights as `sample_weight`, which skorch lacks: `Network` adds it in six lines. Here 60 % of the demonstrations
are random.
"""

from __future__ import annotations

import matplotlib.pyplot as plt
import numpy as np
import torch
from sklearn.base import clone
from sklearn.pipeline import make_pipeline
from sklearn.preprocessing import StandardScaler
from skorch import NeuralNetClassifier
from torch import nn

from rpil import RPIL, Demonstrations

torch.set_num_threads(1)

# %%
# Demonstrations of a rule that no linear policy knows: go where both coordinates agree, else wait.


def rule(x: np.ndarray) -> np.ndarray:
    return np.where(x[:, 0] * x[:, 1] > 0, np.where(x[:, 0] > 0, 2, 0), 1)


N_DEMONSTRATIONS, N_STEPS = 30, 40
rng = np.random.default_rng(0)
observations = rng.normal(size=(N_DEMONSTRATIONS * N_STEPS, 2))
actions = rule(observations)
is_good = np.arange(N_DEMONSTRATIONS) >= 18
bad_steps = ~np.repeat(is_good, N_STEPS)
actions[bad_steps] = rng.integers(3, size=bad_steps.sum())
demonstrations = Demonstrations(observations, actions, np.arange(N_DEMONSTRATIONS + 1) * N_STEPS)


# %%
# The weights of the steps travel with the observations, past the module, to the loss.
class Network(NeuralNetClassifier):
    def fit(self, X, y, sample_weight):
        return super().fit({"X": X, "weight": sample_weight}, y)

    def infer(self, x, **_):
        return super().infer((x["X"] if isinstance(x, dict) else x).float())

    def get_loss(self, y_pred, y_true, X, **_):
        return (super().get_loss(y_pred, y_true) * X["weight"].to(y_pred)).mean()


# %%
# A few steps of LBFGS on all of the data are quicker than epochs of small batches: the judge fits some dozens of
# networks. Each begins with new layers, therefore skorch gets the function. `classes` says which action each output is.
def layers() -> nn.Module:
    torch.manual_seed(0)
    return nn.Sequential(nn.Linear(2, 64), nn.ReLU(), nn.Linear(64, 64), nn.ReLU(), nn.Linear(64, 3))


network = Network(
    layers,
    classes=range(3),
    criterion=nn.CrossEntropyLoss,
    criterion__reduction="none",
    optimizer=torch.optim.LBFGS,
    optimizer__max_iter=30,
    optimizer__line_search_fn="strong_wolfe",
    lr=1.0,
    max_epochs=1,
    batch_size=-1,
    train_split=None,
    verbose=0,
)
policy = make_pipeline(StandardScaler(), network)

# %%
# Once trusting all demonstrations alike, and once with trust.
naive = clone(policy).fit(observations, actions, network__sample_weight=np.ones(len(actions)))
model = RPIL(policy=policy).fit(demonstrations)
for was_good in (True, False):
    verdicts = [v for v, good in zip(model.audit_.verdicts, is_good, strict=True) if good == was_good]
    words = ", ".join(f"{verdicts.count(v)} {v}" for v in ("open", "outlier"))
    print(f"{'good' if was_good else 'random'} demonstrations: {words}")
new = np.random.default_rng(1).normal(size=(2000, 2))
alike, trusting = ((each.predict(new) == rule(new)).mean() for each in (naive, model))
print(f"right actions: {alike:.3f} trusting all, {trusting:.3f} trusting the trustworthy")

# %%
# The log-odds of each demonstration.
order = model.audit_.ranking()
plt.figure(figsize=(6, 3))
plt.bar(range(len(order)), model.audit_.log_odds[order], color=np.where(is_good[order], "tab:green", "tab:red"))
plt.xlabel("demonstrations, the most trusted first (red: random)")
plt.ylabel("score (log-odds)")
plt.tight_layout()
plt.show()
