"""
Does choosing demonstrations make a better policy?
==================================================

Train on all demonstrations and on those that an audit keeps, play both policies from the same starts, and let
`rpil.compare` say whether the difference is more than chance. Here the simulator is Acrobot; for your own robot
replace `train` and `evaluate`.
"""

from __future__ import annotations

import numpy as np

import rpil

ENV = "Acrobot-v1"

# %%
# Eight demonstrations of an expert, and twelve with random actions in their place.
made = rpil.simulate(ENV, "corrupted", n_good=8, n_bad=12, seed=0)
demonstrations = rpil.Demonstrations.from_episodes(made.episodes, source=ENV)

# %%
# An audit calls some outliers; all others are kept.
audit = rpil.RPIL().fit(demonstrations).audit_
kept = [m for m, verdict in enumerate(audit.verdicts) if verdict != "outlier"]
print(f"kept {len(kept)} of {len(demonstrations)} demonstrations, {int(made.is_good[kept].sum())} of 8 good ones")


# %%
# How a policy is trained and played: both are yours.
def train(choice: rpil.Demonstrations, seed: int) -> rpil.BehavioralCloning:
    """A linear policy of drawn demonstrations, because nothing is random in its training."""
    drawn = np.random.default_rng(seed).choice(len(choice), size=len(choice))
    return rpil.BehavioralCloning(features="nystroem").fit(choice.select(np.unique(drawn)))


def evaluate(policy: rpil.BehavioralCloning, seed: int) -> np.ndarray:
    """The return of each episode; an environment that knows success has it in ``rollout(...).success``."""
    return rpil.rollout(policy, ENV, n_episodes=20, seed=seed).returns


# %%
# Five seeds: a policy that is trained again is better or worse by chance alone.
print(rpil.compare({"all": demonstrations, "kept": demonstrations.select(kept)}, train, evaluate, seeds=5))
