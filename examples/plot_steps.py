"""
Which steps went wrong
======================

A demonstration need not be good or bad as a whole. Here some are good except for a stretch in which the hand slipped.
An audit gives every step a log-ratio: how much better a policy of the others predicts the action than the frequencies
of the actions do. The report and the page of `rpil review` draw the trust in each step, which comes from the
log-ratios.
"""

from __future__ import annotations

import matplotlib.pyplot as plt
import numpy as np

import rpil

# %%
# Twenty demonstrations of one key: press it where position and speed are together above 0. Six have a stretch of
# forty-five random steps.
N_DEMONSTRATIONS, N_STEPS, N_SLIPS = 20, 120, 45
rng = np.random.default_rng(0)
state = rng.normal(size=(N_DEMONSTRATIONS * N_STEPS, 2))
action = (state.sum(axis=1) + 0.3 * rng.normal(size=len(state)) > 0).astype(int)
slip = np.zeros((N_DEMONSTRATIONS, N_STEPS), dtype=bool)
for m, first in enumerate(rng.integers(0, N_STEPS - N_SLIPS, size=6)):
    slip[m, first : first + N_SLIPS] = True
action[slip.ravel()] = rng.integers(0, 2, size=slip.sum())
demonstrations = rpil.Demonstrations.from_groups(
    state, action, np.repeat(np.arange(N_DEMONSTRATIONS), N_STEPS), observation_names=["position", "speed"]
)

# %%
# The trust in a step is small where it does not follow the policy of the others. It changes no weight: a training
# weight is that of the whole demonstration.
audit = rpil.audit(demonstrations)
trust = np.stack([audit.step_trust(m) for m in range(N_DEMONSTRATIONS)])
print(f"mean trust: {trust[slip].mean():.2f} in slips, {trust[~slip].mean():.2f} in all other steps")

# %%
# The steps of one of the six. Above: the log-ratio of each step, its running mean, and the worst five with their
# numbers. Below: the trust. The bar marks where the hand really slipped.
figure, (above, below) = plt.subplots(2, 1, figsize=(9, 5), sharex=True, layout="constrained")
audit.plot.steps(0, ax=above)
below.step(np.arange(N_STEPS), trust[0], where="mid")
where = np.flatnonzero(slip[0])
below.hlines(1.05, where[0], where[-1], linewidth=6, label="slipped")
below.set(xlabel="Step", ylabel="Trust", ylim=(0, 1.1))
below.legend(loc="lower left")
plt.show()
