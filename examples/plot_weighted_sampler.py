"""
Trust as a sampler
==================

If a training loop takes no weights, give the weights of an audit to torch's `WeightedRandomSampler`. The loop stays as
it is.
"""

from __future__ import annotations

import matplotlib.pyplot as plt
import numpy as np
import torch
from torch.utils.data import DataLoader, TensorDataset, WeightedRandomSampler

from rpil import RPIL, Demonstrations

torch.set_num_threads(1)

# %%
# Thirty demonstrations of how to keep within a ring; every second one is random.


def expert(x: np.ndarray) -> np.ndarray:
    radius = np.hypot(x[:, 0], x[:, 1])
    return np.where(radius < 0.8, 0, np.where(radius > 1.5, 2, 1))


N_DEMONSTRATIONS, N_STEPS = 30, 50
rng = np.random.default_rng(0)
observations = rng.normal(size=(N_DEMONSTRATIONS * N_STEPS, 2))
actions = expert(observations)
is_good = np.arange(N_DEMONSTRATIONS) % 2 == 0
random_steps = ~np.repeat(is_good, N_STEPS)
actions[random_steps] = rng.integers(3, size=random_steps.sum())
demonstrations = Demonstrations(observations, actions, np.arange(N_DEMONSTRATIONS + 1) * N_STEPS)

# %%
# A policy on a few simple features suffices to find the demonstrations to trust.
audit = RPIL(features="nystroem").fit(demonstrations).audit_
trusted = audit.step_weight
print(f"trusted: {trusted[~random_steps].mean():.2f} of good steps, {trusted[random_steps].mean():.2f} of random ones")

# %%
# The loop knows nothing of trust. It draws trusted steps more often.
x, a = torch.as_tensor(observations, dtype=torch.float32), torch.as_tensor(actions)


def accuracy_by_epoch(weights: np.ndarray) -> list[float]:
    torch.manual_seed(0)
    net = torch.nn.Sequential(torch.nn.Linear(2, 64), torch.nn.ReLU(), torch.nn.Linear(64, 3))
    optimizer = torch.optim.Adam(net.parameters(), lr=3e-3)
    sampler = WeightedRandomSampler(weights.tolist(), num_samples=len(a), generator=torch.Generator().manual_seed(0))
    test = np.random.default_rng(1).normal(size=(2000, 2))
    accuracy = []
    for _ in range(20):
        for observation, action in DataLoader(TensorDataset(x, a), batch_size=64, sampler=sampler):
            optimizer.zero_grad()
            torch.nn.functional.cross_entropy(net(observation), action).backward()
            optimizer.step()
        with torch.no_grad():
            acts = net(torch.as_tensor(test, dtype=torch.float32)).argmax(dim=1).numpy()
        accuracy.append(float((acts == expert(test)).mean()))
    return accuracy


curves = {"all alike": accuracy_by_epoch(np.ones(len(a))), "as trusted": accuracy_by_epoch(trusted)}
for name, curve in curves.items():
    print(f"right actions after training on steps sampled {name}: {curve[-1]:.3f}")

# %%
plt.figure(figsize=(6, 3))
for name, curve in curves.items():
    plt.plot(range(1, 21), curve, label=name)
plt.xlabel("epoch")
plt.ylabel("share of right actions")
plt.legend(title="steps sampled")
plt.tight_layout()
plt.show()
