"""Small made-up audits: what the pictures and the report are tried on."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from rpil.inference.answers import Answers
from rpil.results.answering import rejecting_rules
from rpil.results.judged import AuditSettings, Interval
from rpil.results.record import Audit
from rpil.results.vocabulary import SIDES, Verdict


def make_audit(
    verdicts: Sequence[Verdict] = ("open",) * 6 + ("outlier",) * 4,
    *,
    ids: Sequence[Any] | None = None,
    lengths: Sequence[int] | None = None,
    seed: int = 0,
    labels: dict[Any, int] | None = None,
    **changes: Any,
) -> Audit:
    """An audit with one demonstration for each verdict; those below go wrong in the middle half of their steps.

    `labels` of ids are 1 good or -1 bad.
    """
    rng = np.random.default_rng(seed)
    size = len(verdicts)
    lengths = rng.integers(30, 200, size) if lengths is None else np.asarray(lengths)
    offsets = np.concatenate([[0], np.cumsum(lengths)])
    ratios, reliability = [], np.empty(size)
    for m, (verdict, length) in enumerate(zip(verdicts, lengths, strict=True)):
        middle = np.abs(np.arange(length) - length / 2) < length / 4
        bad = 0.5 if SIDES[verdict] == "lower" else 0.02
        wrong = rng.random(length) < np.where(middle, min(2 * bad, 1), bad / 10)
        ratios.append(np.where(wrong, -rng.exponential(3.0, length), rng.uniform(0.1, np.log(3), length)))
        reliability[m] = 1 - wrong.mean()
    sign = np.array([{"upper": 1.0, "open": 0.0, "lower": -1.0}[SIDES[verdict]] for verdict in verdicts])
    log_odds = sign * (3 + 0.4 * lengths * rng.random(size)) + rng.normal(0, 0.5, size)
    steps = np.concatenate(ratios)
    fields: dict[str, Any] = {
        "ids": tuple(range(size)) if ids is None else tuple(ids),
        "offsets": offsets.astype(np.int64),
        "finding": "outliers",
        "log_odds": log_odds,
        "expert_proba": 1 / (1 + np.exp(-log_odds)),
        "reliability": reliability,
        "verdicts": tuple(verdicts),
        "step_log_ratio": steps,
        "step_weight": (steps > 0).astype(float),
        "prior": Interval(0.55, 0.31, 0.77),
        "identifiable": True,
        "competing": (),
        "pair": (),
        "answers": Answers.of_labels(np.zeros(size, dtype=np.int64)),
        "columns": np.empty((size, 0)),
        "claimed": np.zeros(size, dtype=np.int64),
        "part": np.zeros(size),
        "copy_of": np.arange(size),
        "adversary": "uniform",
        "settings": AuditSettings(),
        "method": ("Those who agree follow one policy.", "Nobody acts at random."),
    }
    fields |= changes
    for name, label in (labels or {}).items():
        fields["answers"].labels[fields["ids"].index(name)] = label
    audit = Audit(**({"from_actions": fields["log_odds"], "from_label": np.zeros(size)} | fields))
    return audit if "rejected_by" in fields else replace(audit, rejected_by=rejecting_rules(audit))
