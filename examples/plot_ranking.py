"""
A ranking of real people
========================

Thirty-two people cooked onion soup in a game, Overcooked. Nobody says who played well. An audit ranks each person by
how well a policy of the others predicts the person's actions. Afterwards we compare the ranking with the number of
soups.
"""

from __future__ import annotations

from importlib.resources import as_file, files

import matplotlib.pyplot as plt
import numpy as np
from scipy.stats import spearmanr

import rpil

# %%
# The recordings come with rpil. The file also holds a score of each, which `rpil.read` never looks at.
with as_file(files("rpil.cli") / "bundled" / "overcooked_cramped_room.npz") as path:
    demonstrations = rpil.read(path)
    with np.load(path) as stored:
        score = stored["episode_quality"]
print(demonstrations)

# %%
# One call judges. The finding here is "no outliers": all are open, and the audit ranks them.
audit = rpil.audit(demonstrations)
print(audit)

# %%
# The log-odds grow where a demonstration belongs with those that agree best. They agree with the score, though the
# audit did not see it.
print(f"Spearman's correlation with the score: {spearmanr(audit.log_odds, score).statistic:.2f}")

# %%
# Left: the ranking, as `audit.plot.ranking()` draws it. Right: the score against it.
figure, (left, right) = plt.subplots(1, 2, figsize=(10, 6), layout="constrained")
audit.plot.ranking(ax=left)
right.plot(score, audit.log_odds, "o")
right.set(xlabel="score that the audit did not see", ylabel="log-odds: higher is more like the others")
right.spines[["top", "right"]].set_visible(False)
plt.show()
