"""The soundness of an audit from a file, which another person may have written."""

from __future__ import annotations

from dataclasses import fields

import numpy as np

from rpil.inference.findings import FINDINGS
from rpil.numerics.types import Array
from rpil.results.choice import KEEP_RULES
from rpil.results.judged import SHARE, Judged


def check_sound(audit: Judged) -> None:
    """A `ValueError` or other error where values of an audit from a file do not belong together."""
    n, known = len(audit.ids), audit.answers
    sizes = {"M": n, "N": int(audit.offsets[-1])}
    sound = len({*audit.ids}) == n > 0 and audit.offsets[0] == 0 and bool((audit.lengths > 0).all())
    for field in (one for one in fields(audit) if "axis" in one.metadata):
        column, limits = getattr(audit, field.name), field.metadata.get("limits")
        is_known = isinstance(column, np.ndarray) or bool(column)
        sound &= not is_known or len(column) == sizes[field.metadata["axis"]]
        sound &= not is_known or limits is None or _are_within(column, *limits)
    sound &= len(audit.verdicts) == len(known.labels) == len(audit.copy_of) == n
    sound &= audit.finding in FINDINGS and {*known.labels.tolist(), *audit.claimed.tolist()} <= {-1, 0, 1}
    sound &= {*audit.rejected_by} <= {"", *KEEP_RULES} and bool(np.isfinite(audit.step_weight).all())
    sound &= _are_within(np.concatenate([audit.copy_of, known.compared.ravel()]), 0, n - 1)
    sound &= _are_within(np.array([audit.prior.mean, audit.prior.low, audit.prior.high]), *SHARE)
    sound &= audit.fps is None or 0 < audit.fps < np.inf
    sound &= audit.order is None or bool(np.isfinite(audit.order).all())
    steps = dict(zip(audit.ids, audit.lengths.tolist(), strict=True))
    sound &= all(traces.fits(steps[name]) for name, traces in audit.traces.items())
    sound &= len({who.trust is None for who in audit.demonstrators}) <= 1
    groups = (*audit.competing, *(who.demonstrations for who in audit.demonstrators))
    named = {*audit.contradicting, *audit.pair, *(name for group in groups for name in group)}
    if not sound or not named <= {*audit.ids}:
        raise ValueError("values out of range")


def _are_within(values: Array, low: float, high: float) -> bool:
    """Whether all values are between two limits, as no NaN is."""
    return bool(((values >= low) & (values <= high)).all())
