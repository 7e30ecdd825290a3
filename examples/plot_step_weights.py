"""
A policy from step weights
==========================

An expert steers a point to a goal. In half of the demonstrations a gust drives the point off course for a while. A
policy that learns from all of them goes off course, too. The same learner with the weights of `RPIL` seldom does.
"""

from __future__ import annotations

import matplotlib.pyplot as plt
import numpy as np
from sklearn.ensemble import ExtraTreesRegressor

import rpil

N_STEPS, REACHED = 40, 0.1


# %%
# The expert steers in a spiral to the goal at (0, 0). In every second demonstration a gust takes the hand to one side,
# each time to another one, for half of the time.
def expert(place: np.ndarray) -> np.ndarray:
    turn = np.array([[-0.12, 0.08], [-0.08, -0.12]])
    return place @ turn.T


rng = np.random.default_rng(0)
states, actions, blown = [], [], []
for m in range(30):
    place = rng.uniform(-1, 1, size=2)
    first, side = rng.integers(0, N_STEPS // 2), rng.uniform(0, 2 * np.pi)
    gust = 0.1 * np.array([np.cos(side), np.sin(side)])
    for step in range(N_STEPS):
        is_blown = m % 2 == 1 and first <= step < first + N_STEPS // 2
        action = expert(place) + 0.01 * rng.normal(size=2) + is_blown * gust
        states.append(place)
        actions.append(action)
        blown.append(is_blown)
        place = place + action
states, actions, blown = np.array(states), np.array(actions), np.array(blown)
demonstrations = rpil.Demonstrations.from_groups(states, actions, np.repeat(np.arange(30), N_STEPS))

# %%
# `RPIL` knows nothing of the gust. It trusts the larger part of the demonstrations that agree: every step of these
# weighs 1, and every step of the others 0. The weights of `rpil.audit` are all 1 until you answer.
weight = rpil.RPIL().fit(demonstrations).audit_.step_weight
print(f"mean weight: {weight[blown].mean():.2f} in a gust, {weight[~blown].mean():.2f} else")


# %%
# Any learner that takes `sample_weight` can use the weights.
def drive(policy: ExtraTreesRegressor) -> np.ndarray:
    """Places (steps, starts, 2) from thirty starts."""
    path = [np.random.default_rng(1).uniform(-1, 1, size=(30, 2))]
    for _ in range(N_STEPS):
        path.append(path[-1] + policy.predict(path[-1]))
    return np.array(path)


figure, axes = plt.subplots(1, 2, figsize=(9, 4.5), sharex=True, sharey=True, layout="constrained")
for ax, name, weights in zip(axes, ("all steps alike", "step weights"), (None, weight), strict=True):
    learner = ExtraTreesRegressor(min_samples_leaf=10, random_state=0)
    path = drive(learner.fit(states, actions, sample_weight=weights))
    reached = np.hypot(*path[-1].T) < REACHED
    print(f"{name}: {reached.sum()} of {len(reached)} reach the goal")
    ax.plot(*path[:, reached].T, color="tab:blue", linewidth=0.8)
    ax.plot(*path[:, ~reached].T, color="tab:orange", linewidth=0.8)
    ax.add_patch(plt.Circle((0, 0), REACHED, fill=False))
    ax.set(title=f"{name}: {reached.sum()} of {len(reached)} reach the goal", xlim=(-1.2, 1.6), aspect="equal")
plt.show()
