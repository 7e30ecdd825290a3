"""Weights of steps for training a policy: those for any training, and those of the learner, `RPIL`.

For any training they are 1 until two answers contrast, one good or better and one bad or worse; then P(good) of the
demonstration, times what makes their mean over all steps 1. With a named adversary they are P(expert). Those of the
learner, 1 or 0, say who is of the part that it trusts (`rpil.inference.two_parts`), also where labels and pairs call
one part good and the other bad; where answers predict others in another way, they are P(good). A label, or a flag of 0,
decides about its own demonstration.
"""

from __future__ import annotations

import numpy as np

from rpil.numerics.types import Array, Float
from rpil.results.judged import Judged


def weights_of(audit: Judged) -> Float[Array, " N"]:
    """The weights of the steps of an audit; empty where steps are not kept."""
    if not len(audit.step_log_ratio):
        return audit.step_log_ratio
    return np.repeat(of_demonstrations(audit), audit.lengths)


def of_demonstrations(audit: Judged) -> Float[Array, " M"]:
    """The weight W_m of each demonstration."""
    proba, once = audit.expert_proba, audit.answers.once(audit.copy_of)
    if audit.anchor == "named adversary":
        return proba
    if not audit.settings.weighs_for_learner:
        acts = audit.anchor == "answers" and once.contrast
        return proba / np.average(proba, weights=audit.lengths) if acts else np.ones(len(proba))
    said, verdicts = audit.answers.shared(audit.copy_of).said, np.array(audit.verdicts)
    side = side_of_answers(audit)
    if not side and once.contrast and np.isin(verdicts[said == 0], ["good", "bad"]).any():
        return proba
    trusted = audit.part * side > 0 if side else audit.part > -1
    weight = np.where(said == 0, trusted, said > 0).astype(float)
    return weight if weight.any() else proba


def side_of_answers(audit: Judged) -> int:
    """1 where labels and pairs call the part good that the learner trusts without them, -1 where they call the other
    one good; 0 where they divide the demonstrations in another way, or do not contrast. Each task has parts of its own.
    """
    known = audit.answers
    better, worse = known.pairs.T
    good, bad = np.append(np.flatnonzero(known.labels > 0), better), np.append(np.flatnonzero(known.labels < 0), worse)
    if audit.within or not (len(good) and len(bad) and known.once(audit.copy_of).contrast):
        return 0
    votes = {*np.sign(audit.part[good]).tolist(), *np.sign(-audit.part[bad]).tolist()}
    return int(votes.pop()) if len(votes) == 1 else 0
