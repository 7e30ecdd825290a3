"""Inference: which demonstrations differ from the others, and, by answers, which are good.

    held_out         log pi(a|s) of every step under policies fitted to the other demonstrations
    groups           one group of scores, or two
    scores           the training group, and scores of demonstrations with their variances and groups
    parts            the parts of a continuous action that are judged, and their scales
    outliers         outliers, a group apart or two groups by the scores, and the pair of the question
    two_parts        the part of the demonstrations that a learner trusts
    channels         numbers that describe a demonstration, from which answers learn
    answers          what labels, pairs and outcomes say: a Bayesian logistic regression
    answered         P(good), verdicts and contradicting labels by answers, and what to ask next
    findings         the answer of an audit as a whole, each in a sentence
    trust            the judge: all of the above in order
    fitted_judge     policies that judge demonstrations that were not fitted
    settings         every constant of the judge

docs/model.md has the formulas.
"""
