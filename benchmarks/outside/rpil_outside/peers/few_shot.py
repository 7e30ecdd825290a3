"""Few-shot regression: a logistic regression from eight random answers on components of simple facts.

The facts are those of the isolation forest and the length. This is what anyone writes who has a few labels.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING

import numpy as np
from sklearn.decomposition import PCA
from sklearn.linear_model import LogisticRegression

from .common import scaled, told
from .forest import summaries

if TYPE_CHECKING:
    from ..world import Made

N_ANSWERS, COMPONENTS = 8, 8


def score(made: Made, answers: Mapping[str, bool], seed: int) -> np.ndarray:
    facts = np.column_stack([summaries(made.demonstrations), scaled(np.log(made.demonstrations.lengths)[:, None])])
    parts = PCA(min(COMPONENTS, *facts.shape), random_state=0).fit_transform(facts)
    parts = parts / parts[:, :1].std()
    at, good = told(made, answers)
    if len(set(good.tolist())) < 2:  # all answers alike: nearness to their mean, for or against it
        near = -np.linalg.norm(parts - parts[at].mean(axis=0), axis=1) if len(at) else np.zeros(len(parts))
        return near if good.all() else -near
    return np.asarray(LogisticRegression().fit(parts[at], good).decision_function(parts))
