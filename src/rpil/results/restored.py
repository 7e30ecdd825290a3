"""Audits as plain values of JSON, and back; what is read is checked, as another program may have written it."""

from __future__ import annotations

import json
from collections.abc import Mapping
from typing import TypeVar

import numpy as np

from rpil.data.archive import CLASSES, check_shape
from rpil.data.errors import DataError
from rpil.data.guard import guarded
from rpil.data.plain import from_plain
from rpil.inference.findings import FINDINGS
from rpil.results.result import AuditResult
from rpil.results.words import SIDES, WORDS

AUDIT_KEY = "audit"
"""Key of all fields of an audit, in its dict with arrays."""

A = TypeVar("A", bound=AuditResult)


def restored(found: Mapping[str, object], kind: type[A]) -> A:
    """The audit of a dict with arrays; a `DataError` where it has none, or its parts do not belong together."""
    if not isinstance(found, Mapping) or AUDIT_KEY not in found:
        raise DataError("This dict has no arrays of an audit; make it with to_dict(arrays=True).")
    with guarded("The dict of the audit", "its parts do not belong together", "make it again with this rpil"):
        audit: A = from_plain(found[AUDIT_KEY], kind)
        check_sound(audit)
        repr(audit), audit.suggest_labels()  # what cannot be shown or asked fails here and not later
    return audit


def check_sound(audit: AuditResult) -> None:
    """A `ValueError`, `KeyError` or other error where the parts of an audit do not belong together."""
    sizes: dict[str, int] = {}
    for part, name in ((audit, "Audit"), (audit.answers, "Answers")):
        for field, axes in CLASSES[name].axes.items():
            check_shape(getattr(part, field), axes, sizes, missing=field == "outcome")
    n, known = len(audit.ids), audit.answers
    of_each = (audit.verdicts, audit.log_odds, audit.copy_of, known.labels)
    at_most = (audit.deviations, audit.sessions, audit.own_reasons, () if audit.order is None else audit.order)
    sound = all(len(values) == n for values in of_each) and all(len(values) in (0, n) for values in at_most)
    sound &= len({*audit.ids}) == n > 0
    sound &= audit.offsets[[0, -1]].tolist() == [0, len(audit.step_weight)] and {*audit.claimed.tolist()} <= {-1, 0, 1}
    sound &= len(audit.step_weight) == len(audit.step_share) == len(audit.step_log_ratio)
    sound &= bool((audit.lengths > 0).all()) and {*audit.verdicts} <= SIDES.keys()
    sound &= audit.finding in FINDINGS and audit.anchor in WORDS and {*known.labels.tolist()} <= {-1, 0, 1}
    sound &= audit.columns_within.shape[1] in (0, audit.columns.shape[1] + 1)
    numbers = np.concatenate([audit.copy_of, known.compared.ravel()])
    sound &= bool(((numbers >= 0) & (numbers < n)).all())
    prior = np.array([audit.prior.mean, audit.prior.low, audit.prior.high])
    of_demonstrations = (audit.expert_proba, audit.reliability, audit.reliability_interval)
    for share in (*of_demonstrations, audit.step_share, audit.step_weight / 2, prior):
        sound &= bool(((share >= 0) & (share <= 1)).all())  # NaN is neither
    sound &= audit.order is None or bool(np.isfinite(audit.order).all())
    steps = dict(zip(audit.ids, audit.lengths.tolist(), strict=True))
    sound &= all(traces.fits(steps[name]) for name, traces in audit.traces.items())
    names = {*audit.contradicting, *audit.pair, *(m for group in audit.competing for m in group)}
    if not sound or not names <= {*audit.ids}:
        raise ValueError("values out of range")
    json.dumps(audit.to_dict())
