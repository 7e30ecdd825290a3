"""
Sessions, and rankings compared
===============================

Somebody recalibrated the zero of a joint on the second of three days. All demonstrations of that day differ from the
others, and nobody is to blame. `audit.plot.sessions()` shows it. Judging within each day finds the demonstrations that
are really bad. The truth is known here, so the area under the ROC curve says how well.
"""

from __future__ import annotations

import matplotlib.pyplot as plt
import numpy as np
import pyarrow as pa
from sklearn.metrics import roc_auc_score

import rpil

# %%
# Sixty demonstrations of one joint that moves towards its target; on Tuesday its commands are shifted. Every sixth
# demonstration is bad: its commands are random.
N_DEMONSTRATIONS, N_STEPS = 60, 50
DAYS = ("Monday", "Tuesday", "Wednesday")
rng = np.random.default_rng(0)
number = np.repeat(np.arange(N_DEMONSTRATIONS), N_STEPS)
day = number // 20
is_good = np.arange(N_DEMONSTRATIONS) % 6 != 5
distance, speed = rng.normal(size=(2, len(number)))
command = distance - 0.5 * speed + 0.2 * rng.normal(size=len(number)) + 1.5 * (day == 1)
command = np.where(is_good[number], command, rng.normal(size=len(number)) + 1.5 * (day == 1))
table = pa.table(
    {"distance": distance, "speed": speed, "action": command, "episode": number, "day": np.take(DAYS, day)}
)

# %%
# Judged together, and judged within each day. `exclude` leaves the day out: it is then no observation.
together = rpil.audit(table, exclude="day")
within = rpil.audit(table, session="day")
for name, audit in (("together", together), ("within each day", within)):
    print(f"{name}: {audit.finding}; {audit.verdict_counts()}")

# %%
# Above: judged together, Tuesday and the bad ones are the lower of two groups. Below: within each day the bad ones are
# outliers.
figure, axes = plt.subplots(2, 1, figsize=(9, 6), layout="constrained")
together.plot.sessions(ax=axes[0])
within.plot.sessions(ax=axes[1])
plt.show()

# %%
# Rankings compared on the demonstrations of one day, with the truth, which no method sees.
monday = rpil.read(table.filter(pa.array(day == 0)), exclude="day")
scores = {
    "RPIL": rpil.RPIL().fit(monday).audit_.log_odds,
    "RM-ENT, given how many": rpil.RMEnt(17).fit(monday).log_likelihood_,
}
for name, score in scores.items():
    print(f"{name:22} AUROC {roc_auc_score(is_good[:20], score):.2f}")
