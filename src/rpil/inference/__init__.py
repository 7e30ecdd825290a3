"""Inference: which demonstrations to trust.

    held_out         log pi(a|s) of every step under policies fitted to the other demonstrations
    trimming         the training group: the demonstrations that are explained best
    effective_steps  how many independent steps the steps of a demonstration are worth
    groups           one group of scores, or two
    scores           scores of demonstrations, their variances and their groups
    rivals           whether the lower scores have a policy of their own
    claims           what the scores support without answers, and what speaks against it
    channels         numbers that describe a demonstration, from which answers learn
    answers          Bayesian logistic regression of "good" on channels
    answered         P(good), words, contradictions and what to ask next
    findings         the results of an audit, each in a sentence
    parts            the parts of an action that are judged
    step_trust       which steps of a demonstration are an expert's
    trust            the judge: all of the above in order
    fitted_judge     judges demonstrations that were not fitted
    search           the paper's mixture, by EM from several starts
    settings         every constant of the judge

docs/model.md has the formulas.
"""
