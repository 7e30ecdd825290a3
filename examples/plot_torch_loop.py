"""
Trust around a training loop of one's own
=========================================

A plain torch loop trusts all demonstrations equally. Cut two functions out of it: one returns the log-probability of
actions, the other trains for one weighted epoch. `rpil.reweight` then runs the same loop, and learns which
demonstrations to trust. Here 60 % of them are random.
"""

from __future__ import annotations

import matplotlib.pyplot as plt
import numpy as np
import torch

from rpil import Demonstrations, reweight

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
# The policy and its optimiser belong together, so that copies of them can be trained side by side: each demonstration
# is judged by a copy that did not see it.
class Learner:
    def __init__(self) -> None:
        torch.manual_seed(0)
        self.net = torch.nn.Sequential(
            torch.nn.Linear(2, 64), torch.nn.ReLU(), torch.nn.Linear(64, 64), torch.nn.ReLU(), torch.nn.Linear(64, 3)
        )
        self.optimizer = torch.optim.Adam(self.net.parameters(), lr=3e-3)
        self.shuffle = torch.Generator().manual_seed(0)

    def accuracy(self) -> float:
        x = np.random.default_rng(1).normal(size=(2000, 2))
        with torch.no_grad():
            acts = self.net(torch.as_tensor(x, dtype=torch.float32)).argmax(dim=1).numpy()
        return float((acts == rule(x)).mean())


def log_prob(learner: Learner, observations: np.ndarray, actions: np.ndarray) -> torch.Tensor:
    with torch.no_grad():
        logits = learner.net(torch.as_tensor(observations, dtype=torch.float32))
    return torch.log_softmax(logits, dim=1)[torch.arange(len(actions)), torch.as_tensor(actions)]


def one_epoch(learner: Learner, observations: np.ndarray, actions: np.ndarray, weights: np.ndarray) -> None:
    x, a = torch.as_tensor(observations, dtype=torch.float32), torch.as_tensor(actions)
    w = torch.as_tensor(weights, dtype=torch.float32)
    for batch in torch.randperm(len(a), generator=learner.shuffle).split(64):
        learner.optimizer.zero_grad()
        loss = torch.nn.functional.cross_entropy(learner.net(x[batch]), a[batch], reduction="none")
        (w[batch] * loss).mean().backward()
        learner.optimizer.step()


# %%
# The loop as it was, and the loop with trust.
naive = Learner()
for _ in range(30):
    one_epoch(naive, observations, actions, np.ones(len(actions)))

found = reweight(Learner(), demonstrations, log_prob=log_prob, train=one_epoch)
for was_good in (True, False):
    verdicts = [v for v, good in zip(found.audit.verdicts, is_good, strict=True) if good == was_good]
    words = ", ".join(f"{verdicts.count(v)} {v}" for v in ("open", "outlier"))
    print(f"{'good' if was_good else 'random'} demonstrations: {words}")
print(f"right actions: {naive.accuracy():.3f} trusting all, {found.policy.accuracy():.3f} trusting the trustworthy")

# %%
# The log-odds of each demonstration.
order = found.audit.ranking()
plt.figure(figsize=(6, 3))
plt.bar(range(len(order)), found.audit.log_odds[order], color=np.where(is_good[order], "tab:green", "tab:red"))
plt.xlabel("demonstrations, the most trusted first (red: random)")
plt.ylabel("score (log-odds)")
plt.tight_layout()
plt.show()
