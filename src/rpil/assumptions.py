"""What an audit assumed, in words."""

from __future__ import annotations

from typing import Any

from rpil.judge import FINDINGS
from rpil.problem import Problem
from rpil.suggestions import P_EXPERT


def assumptions(model: Any, problem: Problem) -> list[str]:
    """What was found and what was assumed, one sentence each."""
    labelled = int((problem.labels != 0).sum())
    said = [
        FINDINGS[model.audit_.finding],
        P_EXPERT,
    ]
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
    if problem.company.said:
        said.append(problem.company.said)
    return said
