"""The assumptions of an audit, one sentence each."""

from __future__ import annotations

from rpil.inference.findings import FINDINGS
from rpil.results.answering import NOT_USED, sentence_of
from rpil.results.record import Audit

IN_SAMPLE_POLICY = (
    "The policy was scored on the steps that it was trained on; this assumes that it cannot memorise actions."
)


def assumption_sentences(
    audit: Audit,
    policy: str = "",
    *,
    p_two_groups: float | None = None,
    expert_share: float | None = None,
    demonstrators: str = "",
) -> tuple[str, ...]:
    """The finding, the meaning of the probability, and all that an audit assumed, as sentences for `Audit.assumptions`.

    `policy` and `demonstrators` are sentences about these. `p_two_groups` is the judge's probability that there are two
    groups of scores; `expert_share` is the prior probability of an expert, where the user fixed it.
    """
    sentences = (
        FINDINGS[audit.finding],
        audit.words.explanation,
        "" if p_two_groups is None else f"P(two groups of scores) is {p_two_groups:.2f}.",
        policy,
        *audit.doubts,
        *audit.notes,
        sentence_of(audit, audit.answers) if audit.anchor == "answers" else NOT_USED,
        "A demonstration is good or bad as a whole." if audit.anchor == "named adversary" else "",
        "" if expert_share is None else f"The share of experts was fixed at {expert_share}.",
        f"{len(audit.labelled)} labels were taken as certain."
        if audit.labelled and audit.anchor == "named adversary"
        else "",
        demonstrators,
    )
    return tuple(filter(None, sentences))
