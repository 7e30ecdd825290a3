"""The probability that an audit shows: none that claims more than its words."""

from __future__ import annotations

import numpy as np
from scipy.special import expit

from rpil.inference.findings import DECIDED
from rpil.numerics.types import Array, Float, Int


def shown_proba(
    log_odds: Float[Array, " M"], words: Int[Array, " M"], finding: str, min_proba: float
) -> Float[Array, " M"]:
    """P of each demonstration: 1/2 where the `finding` gives no words; where the demonstration has none (0), P of its
    log-odds, but strictly between 1 - `min_proba` and `min_proba`, from which words are given."""
    if finding not in DECIDED:
        return np.full(len(log_odds), 0.5)
    proba = expit(log_odds)
    bounded = np.clip(proba, np.nextafter(1 - min_proba, 1), np.nextafter(min_proba, 0))
    return np.where(words == 0, bounded, proba)
