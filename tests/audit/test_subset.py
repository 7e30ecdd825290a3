"""The audit of some of the demonstrations says of each what the audit of all says."""

from __future__ import annotations

import numpy as np

from audits import make_audit
from rpil.audit.subset import select


def test_each_demonstration_keeps_what_was_found_among_all():
    audit = make_audit()
    chosen = [5, 0, 7]
    part = select(audit, chosen, ["a", "b", "c"])
    assert part.ids == ("a", "b", "c")
    assert part.finding == audit.finding
    assert part.reasons == tuple(audit.reasons[m] for m in chosen)
    assert part.verdicts == tuple(audit.verdicts[m] for m in chosen)
    for name in ("log_odds", "from_actions", "expert_proba", "reliability", "reliability_interval"):
        np.testing.assert_array_equal(getattr(part, name), getattr(audit, name)[chosen])
    for k, m in enumerate(chosen):
        np.testing.assert_array_equal(part.step_weight[part.steps(k)], audit.step_weight[audit.steps(m)])
        assert part.worst_steps(k) == audit.worst_steps(m)
    assert {row["id"] for row in part.to_dict()["demonstrations"]} == {"a", "b", "c"}


def test_names_of_demonstrations_that_are_left_out_are_left_out():
    audit = make_audit()
    audit = type(audit)(**{**vars(audit), "labelled": audit.ids[:3], "to_label": audit.ids[1:3]})
    part = select(audit, [2, 3])
    assert part.ids == audit.ids[2:4]
    assert part.labelled == part.to_label == (audit.ids[2],)
