"""What an audit took for granted, in words."""

from __future__ import annotations

from typing import Any

from rpil.problem import Problem


def assumptions(model: Any, problem: Problem) -> list[str]:
    """What was taken for granted, one sentence each."""
    labelled = int((problem.labels != 0).sum())
    said = [
        "Experts agree with one another: in similar states they act alike.",
        f"The policy is linear in {model.features_.kind} features."
        if model.policy is None
        else f"The policy is a {type(model.policy).__name__}; each demonstration was judged by one fitted to others.",
        "The order of demonstrations and any reward were not used.",
    ]
    if model.level == "demonstration":
        said.append("A demonstration is good or bad as a whole.")
    if isinstance(model.prior, float):
        said.append(f"The share of experts was given as {model.prior}.")
    if labelled:
        said.append(f"{labelled} labels were taken as certain.")
    if problem.company.said:
        said.append(problem.company.said)
    return said
