"""Inference: which demonstrations to trust.

    held_out         log pi(a|s) of every step under policies fitted to the other demonstrations
    trimming         the training group: the demonstrations that are explained best
    effective_steps  how many independent steps the steps of a demonstration are worth
    groups           one group of scores, or two
    scores           scores of demonstrations, their variances and their groups
    rivals           a second group of demonstrations with a policy of its own
    labels           which of two groups is the expert's
    step_trust       which steps of a demonstration are an expert's
    trust            the judge: all of the above in order
    fitted_judge     judges demonstrations that were not fitted
    search           the paper's mixture, by EM from several starts
    settings         every constant of the judge

docs/model.md has the formulas.
"""
