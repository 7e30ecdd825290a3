"""What an audit assumed, in words."""

from __future__ import annotations

import warnings
from dataclasses import replace
from typing import Any

from sklearn.exceptions import ConvergenceWarning

from rpil.audit.label_choice import P_EXPERT
from rpil.data.errors import AmbiguousWarning
from rpil.data.fit_data import FitData
from rpil.inference.judgement import FINDINGS


def assumptions(model: Any, data: FitData) -> list[str]:
    """What was found and what was assumed, one sentence each."""
    labelled = int((data.labels != 0).sum())
    said = [FINDINGS[model.audit_.finding], P_EXPERT]
    if model.judge_ is not None:
        said.append(f"P(two groups of scores) is {model.judge_.groups.p_two:.2f}.")
    said.append(
        f"The policy is linear in {model.features_.kind} features."
        if model.policy is None
        else f"The policy is a {type(model.policy).__name__}; each demonstration was judged by one fitted to others."
    )
    said.append("The order of demonstrations, their lengths and any reward were not used.")
    if model.state_ is not None:
        said.append("A demonstration is good or bad as a whole.")
    if isinstance(model.prior, float):
        said.append(f"The share of experts was given as {model.prior}.")
    if labelled:
        said.append(f"{labelled} labels were taken as certain.")
    if data.demonstrators.note:
        said.append(data.demonstrators.note)
    return said


def tell(model: Any, data: FitData, source: str) -> None:
    """Put the assumptions into the audit of `model`, and warn of what the user should know before using it."""
    model.audit_ = replace(model.audit_, assumptions=tuple(assumptions(model, data)))
    if not model.converged_:
        warnings.warn("EM stopped at max_iter; raise max_iter or tol.", ConvergenceWarning, stacklevel=5)
    if not model.audit_.identifiable:
        which = " or ".join(repr(m) for m in model.audit_.to_label)
        warnings.warn(
            f"{source}: two groups of demonstrations each act alike, differently, in the same states, and nothing "
            f"says which is the expert; label one demonstration, say {which}.",
            AmbiguousWarning,
            stacklevel=5,
        )
