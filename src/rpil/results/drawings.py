"""The steps of a demonstration as drawings: binned, and packed as small integers, so that a page stays small."""

from __future__ import annotations

import base64
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from rpil.numerics.types import Array, Float, Int
from rpil.results.reasons import MAX_LOG_RATIO
from rpil.results.result import AuditResult

MAX_BINS = 200
"""Bins of a drawing; a demonstration with fewer steps has one for each."""

LEVELS = 254
"""Between the lowest and the highest value of a curve; a byte has one more, which stands for no value."""

NO_VALUE = 255


@dataclass(frozen=True, eq=False)
class Trace:
    """A part of the action by step, and the band from 5 to 95 % of what is typical in the same states."""

    name: str
    share: float
    """Of the evidence about the demonstration."""
    value: Float[Array, " n"]
    low: Float[Array, " n"]
    high: Float[Array, " n"]


def drawing(audit: AuditResult, m: int, traces: Sequence[Trace]) -> dict[str, object]:
    """The drawing of demonstration `m`; see `rpil.results.view`."""
    steps = audit.steps(m)
    ratio = np.clip(audit.step_log_ratio[steps], -MAX_LOG_RATIO, MAX_LOG_RATIO).astype(float)
    starts = bin_starts(len(ratio))
    extremes = {"min": np.minimum.reduceat(ratio, starts), "max": np.maximum.reduceat(ratio, starts)}
    trust = _means(np.asarray(audit.step_weight[steps], dtype=float), starts)
    return {
        "bins": len(starts),
        "ratio": packed({**extremes, "mean": _means(ratio, starts)}),
        "trust": packed({"mean": trust}, (0.0, 1.0)),
        "parts": [
            {"name": part.name, "share": round(part.share, 4)}
            | packed({name: _means(getattr(part, name), starts) for name in ("value", "low", "high")})
            for part in traces
        ],
    }


def bin_starts(n_steps: int) -> Int[Array, " B"]:
    """The first step of each of at most `MAX_BINS` bins of nearly equal length."""
    n_bins = min(n_steps, MAX_BINS)
    return np.asarray(np.arange(n_bins) * n_steps // n_bins)


def _means(values: Float[Array, " n"], starts: Int[Array, " B"]) -> Float[Array, " B"]:
    return np.asarray(np.add.reduceat(values, starts) / np.diff(np.append(starts, len(values))))


def packed(curves: dict[str, Array], limits: tuple[float, float] | None = None) -> dict[str, object]:
    """Curves on one scale: each as base64 of bytes, where 0 is "from" and 254 is "to"; 255 is no value."""
    values = np.array([*curves.values()], dtype=float)
    known = values[np.isfinite(values)]
    low, high = limits or ((float(known.min()), float(known.max())) if known.size else (0.0, 0.0))
    scaled = LEVELS * (values - low) / (high - low or 1.0)
    codes = np.where(np.isfinite(values), np.clip(np.nan_to_num(scaled), 0, LEVELS).round(), NO_VALUE).astype(np.uint8)
    texts = {name: base64.b64encode(row.tobytes()).decode() for name, row in zip(curves, codes, strict=True)}
    return {"from": _short(low), "to": _short(high), **texts}


def _short(value: float) -> float:
    return float(f"{value:.6g}")
