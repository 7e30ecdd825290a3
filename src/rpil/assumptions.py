"""What an audit took for granted, in words."""

from __future__ import annotations

from typing import Any

from rpil.priors import ByLength
from rpil.problem import Problem

_TOLD = 0.05
"""Nats, for a standard deviation of log length, from which it is said that length counts."""


def assumptions(model: Any, problem: Problem) -> list[str]:
    """What was taken for granted, one sentence each."""
    labelled = int((problem.labels != 0).sum())
    said = [
        "Experts agree with one another: in similar states they act alike.",
        f"Steps that follow one another tell the same in part: {model.belief_.power:.2f} of each counts.",
        f"P(nobody is an adversary, or nothing tells who) is {model.belief_.alike:.2f}; beforehand it was one half.",
        f"The policy is linear in {model.features_.kind} features."
        if model.policy is None
        else f"The policy is a {type(model.policy).__name__}; each demonstration was judged by one fitted to others.",
        "The order of demonstrations and any reward were not used.",
    ]
    if model.level == "demonstration":
        said.append("A demonstration is good or bad as a whole.")
    if isinstance(model.prior, float):
        said.append(f"The share of experts was given as {model.prior}.")
    prior = model.belief_.prior
    if isinstance(prior, ByLength) and abs(prior.slope) >= _TOLD:
        more = "more" if prior.slope > 0 else "less"
        nats = f"{abs(prior.slope):.1f} nats for each standard deviation of the logarithm of their length"
        said.append(f"Longer demonstrations are trusted {more} than short ones, by {nats}: learned from the others.")
    if labelled:
        said.append(f"{labelled} labels were taken as certain.")
    if problem.company.said:
        said.append(problem.company.said)
    return said
