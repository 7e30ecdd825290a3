"""Inference: whom to trust.

    held_out         log pi(a|s) of every step under policies fitted to the other demonstrations
    teachers         the demonstrations that fit the policy: those explained best, by trimmed likelihood
    effective_steps  the number of independent steps that a demonstration is worth
    groups           one group of scores, or two
    rivals           a second group of demonstrations with a policy of its own
    judgement        whom to trust: all of the above in order
    search           the paper's mixture, by EM from several starts

docs/model.md has the formulas.
"""
