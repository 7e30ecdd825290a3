"""EM with a policy that is dear to fit, from what the search found with a linear one.

The linear policy proposes, the given one decides. Its likelihoods are cross-fitted over demonstrations, so that the
objective is one of held-out data: it need not rise at every step, and the best state seen is kept.
"""

from __future__ import annotations

import numpy as np

from rpil.adversaries import adversary
from rpil.em import Result, State, run
from rpil.policies import Policy
from rpil.problem import Problem
from rpil.search import Progress, Setting

_MAX_ITER = 10


def refine(
    problem: Problem, setting: Setting, policy: Policy, found: Result, progress: Progress = lambda _: None
) -> Result:
    """The better of two EM runs with `policy`: from the trust in `found`, and from trusting everybody.

    Parameters
    ----------
    problem : Problem
        With the features that `policy` reads.
    setting : Setting
        Of the search, for the prior and the reliabilities to begin with.
    policy : Policy
        Before it has seen data; its `learn` gives cross-fitted outputs.
    found : Result
        Of the search.
    """

    def begin(name: str, expert_steps: np.ndarray) -> Result:
        progress(f"policy: {name}")
        learned, outputs = policy.learn(problem, expert_steps)
        bad = 1.0 - found.posterior.step
        own = adversary(found.state.adversary.name, problem.space, policy).fit(problem, outputs, bad)
        state = State(learned, own, found.state.prior, found.state.reliability)
        return run(problem, state, mode="expert_only", outputs=outputs, max_iter=_MAX_ITER, tol=setting.tol)

    everyone = (problem.labels >= 0).astype(float)
    runs = [
        begin("from the linear one's trust", found.posterior.step),
        begin("from trusting all", problem.spread(everyone)),
    ]
    return max(runs, key=lambda result: result.objective)
