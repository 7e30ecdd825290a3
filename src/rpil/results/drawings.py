"""The steps of a demonstration as drawings: binned, and packed as small integers, so that a page stays small."""

from __future__ import annotations

import base64
from collections import Counter
from collections.abc import Sequence

import numpy as np

from rpil.inference.step_trust import step_proba
from rpil.numerics.types import Array, Float, Int
from rpil.results.result import AuditResult
from rpil.results.traces import bin_means, bin_starts

LEVELS = 254
"""Between the lowest and the highest value of a curve; a byte has one more, which stands for no value."""

NO_VALUE = 255


def drawings(audit: AuditResult, members: Sequence[int]) -> dict[str, dict[str, object]]:
    """The drawings of some demonstrations by their numbers, see `rpil.results.view`; trust is `Audit.step_trust`."""
    if not members:
        return {}
    chosen = list(members)
    ratios = [audit.log_ratio(m) for m in chosen]
    lengths = audit.lengths[chosen]
    # At once for all: a pass goes from step to step.
    trust = step_proba(audit.reliability[chosen], np.concatenate(ratios), lengths, audit.settings.judge.steps)
    parts = zip(chosen, ratios, np.split(trust, np.cumsum(lengths)[:-1]), strict=True)
    return {str(m): _drawn(audit, m, ratio, own) for m, ratio, own in parts}


def _drawn(audit: AuditResult, m: int, ratio: Float[Array, " n"], trust: Float[Array, " n"]) -> dict[str, object]:
    starts = bin_starts(len(ratio))
    extremes = {"min": np.minimum.reduceat(ratio, starts), "max": np.maximum.reduceat(ratio, starts)}
    traces = audit.traces.get(audit.ids[m])
    taken = traces.taken if traces else ()
    names = sorted(name for name, _ in Counter(taken).most_common(NO_VALUE))  # a byte tells no more apart
    codes = dict(zip(names, range(len(names)), strict=True))
    return {
        "ratio": packed({**extremes, "mean": bin_means(ratio)}),
        "trust": packed({"mean": bin_means(trust)}, (0.0, 1.0)),
        "compared_with": traces.compared_with if traces else "typical",
        "taken": {"names": names, "codes": _as_text(np.array([codes.get(one, NO_VALUE) for one in taken]))},
        "parts": [
            {"name": part.name, "share": round(part.share, 4), "nats": significant(part.nats)}
            | packed({"value": part.value, "low": part.low, "high": part.high})
            for part in (traces.parts if traces else ())
        ],
    }


def packed(curves: dict[str, Array], limits: tuple[float, float] | None = None) -> dict[str, object]:
    """Curves on one scale: each as base64 of bytes, where 0 is "from" and 254 is "to"; 255 is no value."""
    values = np.array([*curves.values()], dtype=float)
    known = values[np.isfinite(values)]
    low, high = limits or ((float(known.min()), float(known.max())) if known.size else (0.0, 0.0))
    scaled = LEVELS * (values - low) / (high - low or 1.0)
    codes = np.where(np.isfinite(values), np.clip(np.nan_to_num(scaled), 0, LEVELS).round(), NO_VALUE)
    return {"from": significant(low), "to": significant(high), **dict(zip(curves, map(_as_text, codes), strict=True))}


def _as_text(codes: Int[Array, " P"]) -> str:
    """Base64 of bytes."""
    return base64.b64encode(codes.astype(np.uint8).tobytes()).decode()


def significant(value: float) -> float:
    """A number with six significant digits."""
    return float(f"{value:.6g}")
